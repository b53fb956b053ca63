"""Finds the pairs that may meet on a way, from what is known of earlier ways."""

from typing import Any

import numpy as np
import warp as wp

from ..launching import copy, fill, launch, only_if, refit
from ..model import Model
from ..surface import Surface, triangle_worlds
from .fans import fans_of
from .pair_list import PairList, loop_width

ROOM = 0.05  # of an edge's length: how far a triangle may stray before its neighbours are looked up again


class PairFinder:
    """Lists pairs of points and triangles, and of edges, that can come near each other between two sets of positions.

    Attributes:
        flat: a mask of fans, shape [particle_count].
        everything: a mask of all particles of the surface.
    """

    def __init__(self, model: Model, surface: Surface):
        self.model, self.surface, self.kernels = model, surface, model.kernels
        tris, n, device = surface.tri_count, model.particle_count, model.device
        self.lower, self.upper, self.known_lower, self.known_upper = (
            wp.zeros(tris, dtype=wp.vec3, device=device) for _ in range(4)
        )
        self.moved, self.tri_active = (wp.zeros(tris, dtype=wp.int32, device=device) for _ in range(2))
        self.any_moved, self.peak = (wp.zeros(1, dtype=wp.int32, device=device) for _ in range(2))
        self.everything = wp.ones(surface.particle_count, dtype=wp.int32, device=device)
        self.room, self.width = ROOM * surface.edge, loop_width(model.device)
        self.forget()
        self._bound(surface.rest, surface.rest, self.everything, 0.0)
        self.bvh = wp.Bvh(
            self.known_lower, self.known_upper, groups=triangle_worlds(surface.tri_indices, surface.world)
        )
        self._allocate(4 * tris)
        self.relative = surface.positions()
        sizes = np.bincount(model.particle_world.numpy(), minlength=model.world_count)
        self.share = model.array(1.0 / np.maximum(sizes, 1), wp.float64)
        self.drift = wp.zeros(model.world_count, dtype=wp.vec3d, device=device)
        fans = fans_of(model.tri_indices.numpy(), n)
        self.fan_start, self.fan_turns = model.array(fans.start, wp.int32), model.array(fans.turns, wp.int32)
        self.fan_spokes = model.array(fans.spokes, wp.vec2i)
        self.shared = model.array(fans.shared, wp.vec4i)
        self.flat = wp.zeros(n, dtype=wp.int32, device=device)

    def find(
        self, target: PairList, start: wp.array, end: wp.array, active: wp.array, margin: float, flat: wp.array,
        leeway: float = 1.0,
    ) -> None:  # fmt: skip
        """Fills ``target`` with the pairs that can come within ``margin`` [m] on the way from start to end.

        All move at the same time, so that only relative motion counts; :meth:`measure_drift` comes first.

        Args:
            start, end: positions of all particles of the surface [m].
            active: mask of particles; pairs of two triangles without any are left out.
            flat: which fans need not be looked at; see :meth:`look_at_fans`.
            leeway: how much of the motion within a pair counts beside that of its closest points: less than all of it
                leaves out pairs that could meet, but hardly will.
        """
        surface = self.surface
        end = self._without_drift(end)
        self._bound(start, end, active, 0.5 * margin)
        only_if(self.any_moved, self._renew_known, self._reuse_known)
        self._launch(self.kernels.contact_fans.add_fan_pairs, len(self.shared), [self.shared, flat], [self.found])
        fill(target.pairs.count)
        self._launch(
            self.kernels.contact_pairs.find_pairs, self.width,
            [
                surface.tri_indices, surface.tri_owned, surface.body, surface.radius, surface.rest, self.width,
                self.found, start, end, self.lower, self.upper, self.tri_active, margin, surface.cloth_particles,
                leeway,
            ],
            [target.pairs],
        )  # fmt: skip
        for pairs in (self.found, target.pairs):
            self._launch(self.kernels.contact_candidates.note_peak, 1, [pairs.count], [pairs.peak])

    def measure_drift(self, start: wp.array, end: wp.array) -> None:
        """Notes the mean motion of each world; cloth that falls as a whole does not sweep what it falls through."""
        fill(self.drift)
        surface = self.surface
        inputs = [surface.world, self.share, start, end]
        self._launch(self.kernels.contact_candidates.sum_drift, surface.cloth_particles, inputs, [self.drift])

    def _without_drift(self, end: wp.array) -> wp.array:
        surface = self.surface
        inputs = [surface.world, end, self.drift]
        self._launch(self.kernels.contact_candidates.remove_drift, surface.particle_count, inputs, [self.relative])
        return self.relative

    def look_at_fans(self, start: wp.array, end: wp.array, active: wp.array) -> None:
        """Notes in ``flat`` which fans with an active particle are flat all the way between two sets of positions."""
        inputs = [self.fan_start, self.fan_spokes, self.fan_turns, start, end, active]
        self._launch(self.kernels.contact_fans.find_flat_fans, self.model.particle_count, inputs, [self.flat])

    def grow(self) -> bool:
        """Makes room for half as much again as there was ever need of; False if there was room enough."""
        peak = int(self.peak.numpy()[0])
        fill(self.peak)
        if peak <= self.capacity:
            return False
        self._allocate(peak + peak // 2)
        return True

    def forget(self) -> None:
        """Nothing is known of any triangle any more."""
        fill(self.known_lower, wp.vec3(1.0e30))
        fill(self.known_upper, wp.vec3(-1.0e30))

    def _allocate(self, capacity: int) -> None:
        self.capacity = capacity
        self.known, self.found = self._triangle_pairs(), self._triangle_pairs()
        self.forget()

    def _triangle_pairs(self) -> Any:
        pairs = self.kernels.contact_candidates.TrianglePairs()
        pairs.count = wp.zeros(1, dtype=wp.int32, device=self.model.device)
        pairs.peak = self.peak
        pairs.pair = wp.zeros(self.capacity, dtype=wp.vec2i, device=self.model.device)
        return pairs

    def _bound(self, start: wp.array, end: wp.array, active: wp.array, margin: float) -> None:
        fill(self.any_moved)
        self._launch(
            self.kernels.contact_candidates.swept_bounds, self.surface.tri_count,
            [self.surface.tri_indices, start, end, active, margin, self.room],
            [
                self.lower, self.upper, self.known_lower, self.known_upper, self.moved, self.any_moved,
                self.tri_active,
            ],
        )  # fmt: skip

    def _reuse_known(self) -> None:
        """``found`` begins with a copy of ``known`` since that was last renewed."""
        copy(self.found.count, self.known.count)

    def _renew_known(self) -> None:
        """Looks up the pairs of triangles that have left their known boxes; ``found`` is a copy of ``known`` then."""
        surface, kernels, found = self.surface, self.kernels.contact_candidates, self.found
        fill(found.count)
        self._launch(kernels.keep_pairs, self.width, [self.width, self.known, self.moved], [found])
        refit(self.bvh)
        self._launch(
            kernels.find_triangle_pairs, surface.tri_count,
            [
                surface.tri_indices, surface.world, surface.cloth_tris, self.moved, self.known_lower,
                self.known_upper, self.bvh.id,
            ],
            [found],
        )  # fmt: skip
        copy(self.known.pair, found.pair)
        copy(self.known.count, found.count)

    def _launch(self, kernel: wp.Kernel, dim: int, inputs: list, outputs: list) -> None:
        launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=self.model.device)
