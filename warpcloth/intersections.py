"""Counts triangles that intersect, exactly; see ``kernels/intersections.py``."""

from typing import Any

import numpy as np
import warp as wp

from .kernels import KernelSet
from .model import Model
from .state import State
from .surface import Surface


def intersections(model: Model, state: State) -> np.ndarray:
    """Pairs of triangles that meet, touching included, apart from vertices that they have in common.

    Returns:
        per world the pairs of two of cloth, and those of one of cloth and one of a box or mesh; shape [world_count, 2].
    """
    if model.tri_count == 0:
        return np.zeros((model.world_count, 2), np.int32)
    surface = Surface(model)
    model.shapes.place(model.tracks, state.world_time, 0.0)
    points = surface.positions()
    surface.place(state.particle_q, model.shapes.end, points)
    return _count(
        model.kernels, points, surface.tri_indices, surface.world, surface.cloth_tris, model.world_count, model.device
    )


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
    lower, upper = (wp.zeros(tris, dtype=wp.vec3, device=device) for _ in range(2))
    bounds = kernels.intersections.triangle_bounds
    wp.launch(bounds, dim=tris, inputs=[tri_indices, points], outputs=[lower, upper], device=device)
    bvh = wp.Bvh(lower, upper)
    wp.launch(
        kernels.intersections.count_intersections,
        dim=tris,
        inputs=[tri_indices, world, cloth_tris, points, lower, upper, bvh.id],
        outputs=[count],
        device=device,
    )
    return count.numpy()
