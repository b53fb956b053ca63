"""The last resort among cloths: where parting does not end, particles are held back (``kernels/contact_guard.py``)."""

import numpy as np
import warp as wp

from ..launching import copy, fill, launch, repeat_while
from ..model import Model
from ..state import State
from ..surface import Surface
from .clusters import Clusters
from .pair_finder import PairFinder
from .pair_list import PairList


class Hold:
    """Holds back what would meet in an interval.

    Args:
        model: the model.
        surface: all that takes part in contact. finder, pairs: find and keep what may meet.
        clusters: in use within :meth:`run` only. separation: what is kept between any two [m].

    Attributes:
        open_worlds: 1 for worlds in which something was held back at last, else 0; int32, shape [world_count].
    """

    def __init__(
        self, model: Model, surface: Surface, finder: PairFinder, pairs: PairList, clusters: Clusters, separation: float
    ):
        self.model, self.surface, self.finder, self.pairs = model, surface, finder, pairs
        self.clusters, self.separation = clusters, separation
        n, device = surface.particle_count, model.device
        self._end = surface.positions()
        self._fraction, self._next_fraction = (wp.ones(n, dtype=wp.float64, device=device) for _ in range(2))
        self._carrier, self._next_carrier, self._active = (wp.zeros(n, dtype=wp.int32, device=device) for _ in range(3))
        self.open_worlds = wp.zeros(model.world_count, dtype=wp.int32, device=device)
        self._changed = wp.zeros(1, dtype=wp.int32, device=device)
        tracks, pins = np.unique(model.moving_pins.track.numpy(), return_index=True)
        self._group_pin = model.array(pins, wp.int32)
        self._own_carrier = model.array(self._own_carriers(tracks), wp.int32)
        rest = np.zeros(1 + model.shapes.count + len(pins), dtype=model.kernels.shapes.Placement.numpy_dtype())
        rest["rotation"] = np.eye(3)
        self._place_from, self._place_to = (
            wp.array(rest, dtype=model.kernels.shapes.Placement, device=device) for _ in range(2)
        )

    def begin(self, state: State) -> None:
        """Notes where carriers are at the start of an interval; obstacles have been placed."""
        self._place(state, self._place_from)

    def run(
        self, state: State, span: float, start: wp.array, now: wp.array, met: wp.array, counts: wp.array
    ) -> None:  # fmt: skip
        """Changes ``state``, the end of an interval of ``span`` [s], so that nothing meets.

        Args:
            state: the end. span: length of the interval [s].
            start, now: positions of the surface at both ends [m].
            met: particles that meet; only their worlds are looked at.
            counts: to which the numbers of particles held back and of pinched pairs are added.
        """
        model, surface, kernels = self.model, self.surface, self.model.kernels.contact_guard
        fill(self.open_worlds)
        self._launch(kernels.open_worlds, surface.particle_count, [surface.world, met], [self.open_worlds])
        self._launch(
            kernels.let_go, surface.particle_count,
            [surface.world, self._own_carrier, self.open_worlds],
            [self._active, self._fraction, self._carrier],
        )  # fmt: skip
        self.clusters.part()
        copy(self._next_fraction, self._fraction)
        copy(self._next_carrier, self._carrier)
        self._place(state, self._place_to)
        fill(self._changed, 1)
        repeat_while(self._changed, lambda: self._round(start, now, counts))
        self._launch(
            kernels.apply_limit, model.particle_count,
            [
                start, self._end, self._fraction, self._carrier, self.clusters.sums, self._place_from, self._place_to,
                span,
            ],
            [state.particle_q, state.particle_qd, counts],
        )  # fmt: skip

    def _round(self, start: wp.array, now: wp.array, counts: wp.array) -> None:
        """One round; it goes on while any particle had to be held back further, or was taken along."""
        model, surface, finder, kernels = self.model, self.surface, self.finder, self.model.kernels.contact_guard
        shapes = model.shapes
        self.clusters.find(start, now)
        self._launch(
            kernels.find_ends, surface.particle_count,
            [
                start, now, self._fraction, self._carrier, self.clusters.sums, self._place_from, self._place_to,
            ],
            [self._end],
        )  # fmt: skip
        finder.look_at_fans(start, self._end, self._active)
        finder.find(self.pairs, start, self._end, self._active, 2.0 * self.separation, finder.flat)
        fill(self._changed)
        self._launch(
            kernels.limit_motion, finder.width,
            [
                surface.inv_mass, self.pairs.pairs, self.separation, finder.width, start, self._end, self._fraction,
                self._carrier, self.clusters.sums,
            ],
            [self._next_fraction, self._next_carrier, self.clusters.next_parent, self._changed, counts],
        )  # fmt: skip
        self._launch(
            kernels.limit_by_shapes, model.particle_count,
            [
                surface.world, surface.radius, shapes.shapes, self._end, self._fraction, self._carrier, self._place_to,
            ],
            [self._next_fraction, self._next_carrier, self._changed],
        )  # fmt: skip
        copy(self._fraction, self._next_fraction)
        copy(self._carrier, self._next_carrier)

    def _own_carriers(self, tracks: np.ndarray) -> np.ndarray:
        """What each particle of the surface is part of: what rests, an obstacle that moves, pins that move, or −1."""
        model, surface = self.model, self.surface
        own = np.where(surface.inv_mass.numpy() > 0.0, -1, 0)
        shape = surface.point_shape.numpy()
        own[surface.cloth_particles :] = np.where(model.shapes.shapes.track.numpy()[shape] >= 0, 1 + shape, 0)
        pins = model.moving_pins
        own[pins.particle.numpy()] = 1 + model.shapes.count + np.searchsorted(tracks, pins.track.numpy())
        return own

    def _place(self, state: State, out: wp.array) -> None:
        """Where carriers are at the state's time; obstacles have been placed."""
        model, pins, count = self.model, self.model.moving_pins, self.model.shapes.count
        if count > 0:
            copy(out[1 : 1 + count], model.shapes.end)
        if len(self._group_pin) > 0:
            self._launch(
                self.model.kernels.contact_guard.place_pins, len(self._group_pin),
                [
                    model.particle_world, pins.particle, pins.track, pins.pivot, model.tracks, self._group_pin,
                    1 + count, state.world_time,
                ],
                [out],
            )  # fmt: skip

    def _launch(self, kernel: wp.Kernel, dim: int, inputs: list, outputs: list) -> None:
        launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=self.model.device)
