"""The surface that takes part in contact: all cloths, then obstacles with edges, or that fit between particles.

Obstacle vertices are particles without inverse mass, whose places are prescribed. So the edges and corners of an
obstacle meet cloth just as cloth does, and cannot poke through between its particles.
"""

import numpy as np
import warp as wp

from .facets import Facets, faceted
from .launching import copy, launch
from .model import Model
from .obstacles import MeshObstacle


class Surface:
    """Particles and triangles of cloth, then of boxes, meshes, and what else fits between particles.

    Attributes:
        particle_count, cloth_particles, tri_count, cloth_tris: numbers of all, and of those of cloth.
        inv_mass [1/kg], radius [m], friction, world, body, rest [m]: of all particles; ``body`` numbers
            cloths and obstacles.
        point_shape: which of the model's shapes each obstacle vertex, after the cloths' particles, belongs to.
        tri_indices, tri_owned: corners of each triangle, and which vertices and edges it answers for.
        edge: median edge of the cloths [m]; 0 in a network.
    """

    def __init__(self, model: Model):
        self.model = model
        self.cloth_particles, self.cloth_tris = model.particle_count, model.tri_count
        solids = faceted(model.shapes.obstacles, longest_edges(model))
        self._sizes = [len(solid.local) for solid in solids]
        self._deforming = self._find_deforming(solids)

        def joined(cloth: wp.array, values: list[float], dtype: type) -> wp.array:
            return model.array(np.concatenate([cloth.numpy(), np.repeat(np.array(values, float), self._sizes)]), dtype)

        self.inv_mass = joined(model.particle_inv_mass, [0.0 for _ in solids], model.real)
        self.radius = joined(model.particle_radius, [solid.obstacle.thickness for solid in solids], model.real)
        self.friction = joined(model.particle_friction, [solid.obstacle.friction for solid in solids], model.real)
        self.world = joined(model.particle_world, [solid.world for solid in solids], wp.int32)
        self.point_shape = model.array(np.repeat(np.array([s.shape for s in solids], np.int32), self._sizes), wp.int32)
        self._local = model.array(np.concatenate([np.zeros((0, 3)), *(s.local for s in solids)]), wp.vec3)
        self.rest = model.array(np.concatenate([model.particle_q.numpy(), *(s.rest for s in solids)]), model.vec3)
        sizes = [*(cloth.stop - cloth.start for cloth in model.cloths), *self._sizes]
        self.body = model.array(np.repeat(np.arange(len(sizes)), sizes), wp.int32)
        self._join_triangles(solids)
        self.edge = median_edge(model.particle_q.numpy(), model.tri_indices.numpy())

    def _join_triangles(self, solids: list[Facets]) -> None:
        firsts = self.cloth_particles + np.cumsum([0, *self._sizes])
        parts = [solid.triangles + first for solid, first in zip(solids, firsts[:-1], strict=True)]
        corners = np.concatenate([self.model.tri_indices.numpy(), *parts])
        self.tri_indices = self.model.array(corners, wp.int32) if solids else self.model.tri_indices
        self.tri_owned = self.model.array(owned_features(corners), wp.int32)
        self.particle_count, self.tri_count = int(firsts[-1]), len(corners)

    def _find_deforming(self, solids: list[Facets]) -> list[tuple[wp.Mesh, int]]:
        """Meshes whose own points change, and where theirs begin among all obstacle points."""
        firsts = np.cumsum([0, *self._sizes])
        moving = iter(self.model.shapes.deforming)
        return [
            (next(moving).mesh, int(first))
            for solid, first in zip(solids, firsts[:-1], strict=True)
            if isinstance(solid.obstacle, MeshObstacle) and solid.obstacle.sample_times is not None
        ]

    def positions(self) -> wp.array:
        """A new array for the positions of all particles [m], at rest."""
        return wp.clone(self.rest)

    def place(self, particle_q: wp.array, placements: wp.array, out: wp.array) -> None:
        """Writes the positions of all particles: cloth from ``particle_q``, obstacles from ``placements``."""
        copy(out, particle_q, count=self.cloth_particles)
        extra = self.particle_count - self.cloth_particles
        if extra == 0:
            return
        for mesh, first in self._deforming:
            copy(self._local[first : first + len(mesh.points)], mesh.points)
        launch(
            self.model.kernels.contact_pairs.place_points,
            dim=extra,
            inputs=[self.cloth_particles, self.point_shape, self._local, placements],
            outputs=[out],
            device=self.model.device,
        )


def triangle_worlds(tri_indices: wp.array, particle_world: wp.array) -> wp.array:
    """World of each triangle, int32, for trees with a part for each world: all worlds are in one and the same place."""
    worlds = particle_world.numpy()[tri_indices.numpy().reshape(-1, 3)[:, 0]]
    return wp.array(worlds, dtype=wp.int32, device=tri_indices.device)


def median_edge(points: np.ndarray, triangles: np.ndarray) -> float:
    """Median length [m] of the edges of triangles, shape [m, 3], over points, shape [n, 3]; 0 where there are none."""
    return float(np.median(edge_lengths(points, triangles))) if len(triangles) else 0.0


def edge_lengths(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Lengths [m] of the edges of triangles, shape [m, 3], over points, shape [n, 3]."""
    return np.asarray(np.linalg.norm(points[triangles] - points[np.roll(triangles, 1, axis=1)], axis=2))


def longest_edges(model: Model) -> dict[int, float]:
    """Of each world with cloth: its longest edge [m]."""
    points, triangles = model.particle_q.numpy(), model.tri_indices.numpy()
    edges: dict[int, float] = {}
    for cloth in model.cloths:
        lengths = edge_lengths(points, triangles[cloth.tri_start : cloth.tri_stop])
        edges[cloth.world] = max(float(lengths.max(initial=0.0)), edges.get(cloth.world, 0.0))
    return edges


def world_edges(model: Model) -> dict[int, float]:
    """Of each world with cloth: the shortest of its cloths' median edges [m]."""
    points, triangles = model.particle_q.numpy(), model.tri_indices.numpy()
    edges: dict[int, float] = {}
    for cloth in model.cloths:
        if cloth.tri_start == cloth.tri_stop:
            continue
        own = median_edge(points, triangles[cloth.tri_start : cloth.tri_stop])
        edges[cloth.world] = min(own, edges.get(cloth.world, own))
    return edges


def owned_features(triangles: np.ndarray) -> np.ndarray:
    """Which vertices (bits 0 to 2) and edges k, k + 1 (bits 3 to 5) belong to each triangle, the first that has them.

    Args:
        triangles: corners, shape [m, 3].

    Returns:
        int32, shape [m]; every vertex and every edge of the mesh has exactly one owner.
    """
    owned = np.zeros(len(triangles), np.int32)
    edges = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    for features, lowest_bit in ((triangles.reshape(-1, 1), 1), (edges, 8)):
        _, first = np.unique(features, axis=0, return_index=True)
        np.bitwise_or.at(owned, first // 3, (lowest_bit << (first % 3)).astype(np.int32))
    return owned
