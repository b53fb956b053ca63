"""Counts triangles that intersect, exactly; see ``kernels/intersections.py``."""

from typing import Any

import numpy as np
import warp as wp

from .kernels import KernelSet
from .model import Model
from .state import State
from .surface import Surface, triangle_worlds


class Triangles:
    """All triangles of a model, those of obstacles with facets included, for counting and parting those that meet."""

    def __init__(self, model: Model):
        self.model, self.surface = model, Surface(model)
        self.points = self.surface.positions()
        self.device = model.device

    def count(self, state: State) -> np.ndarray:
        """See :func:`intersections`."""
        model, surface = self.model, self.surface
        self._place(state)
        mesh = (surface.tri_indices, surface.world, surface.cloth_tris)
        return _count(model.kernels, self.points, *mesh, model.world_count, model.device)

    def crossings(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Edges that pass through triangles, once for each triangle at the edge.

        Returns:
            the triangle with the edge, the triangle passed, and the two ends of the edge, int32, shape [n, 4]; and the
            direction in which the edge leaves soonest, shape [n, 3]; see ``kernels/untangle.py``.
        """
        kernels, surface = self.model.kernels.untangle, self.surface
        self._place(state)
        lower, upper, bvh = _boxes(self.model.kernels, self.points, surface.tri_indices, surface.world, self.device)
        found, room = kernels.Crossings(), 1024
        while True:
            found.count = wp.zeros(1, dtype=wp.int32, device=self.device)
            found.where = wp.zeros(room, dtype=wp.vec4i, device=self.device)
            found.way = wp.zeros(room, dtype=wp.vec3d, device=self.device)
            mesh = [surface.tri_indices, surface.world, surface.cloth_tris]
            inputs = [*mesh, self.points, lower, upper, bvh.id]
            wp.launch(kernels.find_crossings, dim=surface.tri_count, inputs=inputs, outputs=[found], device=self.device)
            count = int(found.count.numpy()[0])
            if count <= room:
                where, way = found.where.numpy()[:count], found.way.numpy()[:count]
                order = np.lexsort(where.T)  # whoever came first to the list
                return where[order], way[order]
            room = count

    def _place(self, state: State) -> None:
        shapes = self.model.shapes
        with shapes.turn:
            shapes.place(self.model.tracks, state.world_time, 0.0)
            self.surface.place(state.particle_q, shapes.end, self.points)


def intersections(model: Model, state: State) -> np.ndarray:
    """Pairs of triangles that meet, touching included, apart from vertices that they have in common.

    Returns:
        per world the pairs of two of cloth, and those of one of cloth and one of an obstacle that has facets
        (see :func:`~warpcloth.facets.faceted`); shape [world_count, 2].
    """
    if model.tri_count == 0:
        return np.zeros((model.world_count, 2), np.int32)
    return Triangles(model).count(state)


def count_intersections(points: Any, triangles: Any, cloth_tris: int | None = None) -> tuple[int, int]:
    """Pairs of triangles that meet, touching included, apart from vertices that they have in common.

    Args:
        points: shape [n, 3] [m]. triangles: shape [m, 3].
        cloth_tris: how many of the triangles, from the first, are of cloth; the others are of obstacles. All if None.

    Returns:
        the pairs of two of cloth, and those of one of cloth and one of an obstacle.
    """
    device = wp.get_device("cpu")
    q = wp.array(np.ascontiguousarray(points, np.float64), dtype=wp.vec3d, device=device)
    tri = wp.array(np.ascontiguousarray(triangles, np.int32).reshape(-1, 3), dtype=wp.int32, device=device)
    world = wp.zeros(len(q), dtype=wp.int32, device=device)
    among = len(tri) if cloth_tris is None else cloth_tris
    cloth, solid = _count(KernelSet("float64"), q, tri, world, among, 1, device)[0]
    return int(cloth), int(solid)


def _count(
    kernels: KernelSet,
    points: wp.array,
    tri_indices: wp.array,
    world: wp.array,
    cloth_tris: int,
    world_count: int,
    device: wp.Device,
) -> np.ndarray:
    count = wp.zeros((world_count, 2), dtype=wp.int32, device=device)
    tris = len(tri_indices)
    if tris == 0:
        return count.numpy()
    lower, upper, bvh = _boxes(kernels, points, tri_indices, world, device)
    wp.launch(
        kernels.intersections.count_intersections,
        dim=tris,
        inputs=[tri_indices, world, cloth_tris, points, lower, upper, bvh.id],
        outputs=[count],
        device=device,
    )
    return count.numpy()


def _boxes(
    kernels: KernelSet, points: wp.array, tri_indices: wp.array, world: wp.array, device: wp.Device
) -> tuple[wp.array, wp.array, wp.Bvh]:
    """The box of each triangle, and a tree of them for each world."""
    tris = len(tri_indices)
    lower, upper = (wp.zeros(tris, dtype=wp.vec3, device=device) for _ in range(2))
    bounds = kernels.intersections.triangle_bounds
    wp.launch(bounds, dim=tris, inputs=[tri_indices, points], outputs=[lower, upper], device=device)
    return lower, upper, wp.Bvh(lower, upper, groups=triangle_worlds(tri_indices, world))
