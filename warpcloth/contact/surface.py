"""The surface that takes part in contact: the triangles of all cloths, then those of all mesh obstacles.

Obstacle vertices are particles without inverse mass, whose places are prescribed. So the edges and corners of an
obstacle meet cloth just as cloth does, and cannot poke through between its particles.
"""

import numpy as np
import warp as wp

from ..model import Model
from ..obstacles import MeshObstacle
from .pair_list import owned_features


class Surface:
    """Particles and triangles of cloth and mesh obstacles, in this order.

    Attributes:
        particle_count, cloth_particles, tri_count, cloth_tris: numbers of all, and of those of cloth.
        inv_mass [1/kg], radius [m], friction, world, body, rest [m]: of all particles; ``body`` numbers
            cloths and meshes.
        tri_indices, tri_owned: corners of each triangle, and which vertices and edges it answers for.
        thickest: greatest sum of a cloth's and another body's radius [m].
    """

    def __init__(self, model: Model):
        self.model = model
        self.cloth_particles, self.cloth_tris = model.particle_count, model.tri_count
        rows = [(s, row[0], row[1]) for s, row in enumerate(model.shapes.obstacles) if isinstance(row[1], MeshObstacle)]
        sizes = np.array([len(obstacle.points) for _, _, obstacle in rows], int)
        self._firsts = np.concatenate([[0], np.cumsum(sizes)]).astype(int)

        def joined(cloth: wp.array, values: list, dtype: type) -> wp.array:
            return model.array(np.concatenate([cloth.numpy(), np.repeat(np.array(values, float), sizes)]), dtype)

        self.inv_mass = joined(model.particle_inv_mass, [0.0 for _ in rows], model.real)
        self.radius = joined(model.particle_radius, [obstacle.thickness for _, _, obstacle in rows], model.real)
        self.friction = joined(model.particle_friction, [obstacle.friction for _, _, obstacle in rows], model.real)
        self.world = joined(model.particle_world, [world for _, world, _ in rows], wp.int32)
        bodies = np.repeat(
            np.arange(len(model.cloths) + len(rows)), [*(c.stop - c.start for c in model.cloths), *sizes]
        )  # fmt: skip
        self.body = model.array(bodies, wp.int32)
        self.rest = model.array(np.concatenate([model.particle_q.numpy(), *(o.points for _, _, o in rows)]), model.vec3)
        self._place = wp.array(
            np.repeat([s for s, _, _ in rows], sizes).astype(np.int32), dtype=wp.int32, device=model.device
        )
        local = [o.points - o.centre for _, _, o in rows]
        self._local = model.array(np.concatenate([np.zeros((0, 3)), *local]), wp.vec3)
        starts = self.cloth_particles + self._firsts
        triangles = [
            model.tri_indices.numpy(),
            *(o.triangles + first for (_, _, o), first in zip(rows, starts, strict=False)),
        ]
        corners = np.concatenate(triangles)
        self.tri_indices = model.array(corners, wp.int32)
        self.tri_owned = model.array(owned_features(corners), wp.int32)
        self.particle_count, self.tri_count = len(bodies), len(corners)
        cloth = float(model.particle_radius.numpy().max())
        self.thickest = cloth + max([cloth, *(obstacle.thickness for _, _, obstacle in rows)])

    def positions(self) -> wp.array:
        """A new array for the positions of all particles [m], at rest."""
        return wp.clone(self.rest)

    def place(self, particle_q: wp.array, placements: wp.array, out: wp.array) -> None:
        """Writes the positions of all particles: cloth from ``particle_q``, obstacles from ``placements``."""
        wp.copy(out, particle_q, count=self.cloth_particles)
        extra = self.particle_count - self.cloth_particles
        if extra == 0:
            return
        for mesh, first in zip(self.model.shapes.meshes, self._firsts[:-1], strict=True):
            if any(item.mesh is mesh for item in self.model.shapes.deforming):
                wp.copy(self._local, mesh.points, dest_offset=int(first), count=len(mesh.points))
        wp.launch(
            self.model.kernels.cloth_contact.place_points,
            dim=extra,
            inputs=[self.cloth_particles, self._place, self._local, placements],
            outputs=[out],
            device=self.model.device,
        )
