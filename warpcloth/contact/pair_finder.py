"""Finds the pairs that may meet on a way, from what is known of earlier ways."""

import numpy as np
import warp as wp

from ..launching import fill, launch, only_if
from ..model import Model
from ..surface import Surface
from .fans import fans_of
from .pair_list import PairList, loop_width
from .trees import BinaryTree, WideTree

ROOM = 0.05  # of an edge's length: how far a triangle may stray before its neighbours are looked up again
LEEWAY = 0.25  # of the motion within a pair that counts where it is only foreseen
AHEAD = 0.3  # of an edge's length: how far ahead of a slow triangle they are looked up


class PairFinder:
    """Lists pairs of points and triangles, and of edges, that can come near each other between two sets of positions.

    Args:
        model, surface: whose. threads: how many of the CPU step it.

    Attributes:
        flat: a mask of fans, shape [particle_count].
        everything: a mask of all particles of the surface.
        width: threads of kernels that share a list; see :func:`~warpcloth.contact.pair_list.loop_width`.
    """

    def __init__(self, model: Model, surface: Surface, threads: int = 1):
        self.model, self.surface, self.kernels = model, surface, model.kernels
        tris, n, device = surface.tri_count, model.particle_count, model.device
        ways = self.kernels.contact_ways
        self.way, self.known_way = (wp.zeros(tris, dtype=ways.Way, device=device) for _ in range(2))
        self.moved, self.tri_active = (wp.zeros(tris, dtype=wp.int32, device=device) for _ in range(2))
        self.any_moved, self.anew, self.peak = (wp.zeros(1, dtype=wp.int32, device=device) for _ in range(3))
        self.everything = wp.ones(surface.particle_count, dtype=wp.int32, device=device)
        self.drift = wp.zeros(model.world_count, dtype=wp.vec3d, device=device)
        self.room, self.ahead = ROOM * surface.edge, AHEAD * surface.edge
        self.width = loop_width(device, threads)
        self._allocate(4 * tris)
        self._tree = self._grow_tree()
        self.forget()
        self.relative = surface.positions()
        sizes = np.bincount(model.particle_world.numpy(), minlength=model.world_count)
        self.share = model.array(1.0 / np.maximum(sizes, 1), wp.float64)
        fans = fans_of(model.tri_indices.numpy(), n)
        self.fan_start, self.fan_turns = model.array(fans.start, wp.int32), model.array(fans.turns, wp.int32)
        self.fan_ring = model.array(fans.ring, wp.int32)
        self.corners = [model.particle_corner_start, model.particle_corner_ids]
        self.flat = wp.zeros(n, dtype=wp.int32, device=device)

    def find(
        self, target: PairList, start: wp.array, end: wp.array, active: wp.array, margin: float, flat: wp.array,
        foreseen: bool = False, radii: float = 0.0,
    ) -> None:  # fmt: skip
        """Fills ``target`` with the pairs that can come within ``margin`` [m] and so many of their ``radii`` on the
        way from start to end.

        All move at the same time, so that only relative motion counts; :meth:`measure_drift` comes first.

        Args:
            start, end: positions of all particles of the surface [m].
            active: mask of particles; pairs of two triangles without any are left out.
            flat: which fans need not be looked at; see :meth:`look_at_fans`.
            foreseen: the end is only foreseen: of the motion within a pair, beside that of its closest points, no more
                than :data:`LEEWAY` counts, which leaves out pairs that could meet, but hardly will.
        """
        surface = self.surface
        end = self._without_drift(end)
        leeway, stray = (LEEWAY, LEEWAY) if foreseen else (1.0, 0.0)
        self._bound(start, end, active, 0.5 * margin, stray, radii)
        only_if(self.any_moved, self._renew_known)
        fill(target.pairs.count)
        mesh = [surface.tri_indices, surface.tri_owned, surface.body, surface.radius, surface.rest]
        others = [self.tri_active, margin, radii, surface.cloth_particles, leeway]
        self._launch(
            self.kernels.contact_pairs.find_pairs, self.width,
            [*mesh, self.width, self.known, start, end, self.way, *others],
            [target.pairs],
        )  # fmt: skip
        self._launch(
            self.kernels.contact_pairs.find_fan_pairs, self.width,
            [*mesh, *self.corners, self.width, flat, start, end, *others],
            [target.pairs],
        )  # fmt: skip
        self._launch(self.kernels.contact_candidates.note_peak, 1, [target.pairs.count], [target.pairs.peak])

    def measure_drift(self, start: wp.array, end: wp.array) -> None:
        """Notes the mean motion of each world; cloth that falls as a whole does not sweep what it falls through."""
        fill(self.drift)
        surface = self.surface
        inputs = [surface.world, self.share, start, end]
        self._launch(self.kernels.contact_ways.sum_drift, surface.cloth_particles, inputs, [self.drift])

    def _without_drift(self, end: wp.array) -> wp.array:
        surface = self.surface
        inputs = [surface.world, end, self.drift]
        self._launch(self.kernels.contact_ways.remove_drift, surface.particle_count, inputs, [self.relative])
        return self.relative

    def look_at_fans(self, start: wp.array, end: wp.array, active: wp.array) -> None:
        """Notes in ``flat`` which fans with an active particle are flat all the way between two sets of positions.

        One set given twice is looked at once.
        """
        inputs = [self.fan_start, self.fan_ring, self.fan_turns, start, end, active, int(end is not start)]
        self._launch(self.kernels.contact_fans.find_flat_fans, self.model.particle_count, inputs, [self.flat])

    def grow(self) -> bool:
        """Makes room for a quarter more than there was ever need of; False if there was room enough."""
        peak = int(self.peak.numpy()[0])
        fill(self.peak)
        if peak <= self.capacity:
            return False
        self._allocate(peak + peak // 4)
        return True

    def forget(self) -> None:
        """Nothing is known of any triangle any more."""
        self._launch(self.kernels.contact_ways.forget_ways, self.surface.tri_count, [], [self.known_way])
        fill(self.known.count)
        fill(self.known.holes)

    def _allocate(self, capacity: int) -> None:
        def numbers(length: int, dtype: type = wp.int32) -> wp.array:
            return wp.zeros(length, dtype=dtype, device=self.model.device)

        self.capacity = capacity
        self.known = self.kernels.contact_candidates.TrianglePairs()
        self.known.pair, self.known.hole = numbers(capacity, wp.vec2i), numbers(capacity // 2 + 1)
        self.known.count, self.known.holes, self.known.added = numbers(1), numbers(1), numbers(1)
        self.known.peak = self.peak
        self.forget()

    def _grow_tree(self) -> BinaryTree | WideTree:
        """A tree of the triangles at rest."""
        surface = self.surface
        self._bound(surface.rest, surface.rest, self.everything, 0.0)
        if self.model.device.is_cpu:
            return WideTree(self.model, surface)
        return BinaryTree(self.model, surface, self.known_way)

    def _bound(
        self, start: wp.array, end: wp.array, active: wp.array, margin: float, foreseen: float = 0.0, radii: float = 0.0
    ) -> None:  # fmt: skip
        fill(self.any_moved)
        surface = self.surface
        self._launch(
            self.kernels.contact_ways.swept_bounds, surface.tri_count,
            [
                surface.tri_indices, surface.world, surface.radius, start, end, self.drift, active, margin, radii,
                foreseen, LEEWAY, self.room, self.ahead,
            ],
            [self.way, self.known_way, self.moved, self.any_moved, self.tri_active],
        )  # fmt: skip

    def _renew_known(self) -> None:
        """Looks up the pairs of triangles that have left their known ways."""
        kernels, known = self.kernels.contact_candidates, self.known
        self._launch(kernels.drop_pairs, self.width, [self.width, self.moved], [known])
        self._launch(kernels.begin_adding, 1, [], [known, self.anew])
        self._tree.find(self.moved, self.anew, self.known_way, LEEWAY, known)
        self._launch(kernels.end_adding, 1, [], [known])

    def _launch(self, kernel: wp.Kernel, dim: int, inputs: list, outputs: list) -> None:
        launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=self.model.device)
