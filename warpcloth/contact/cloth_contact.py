"""Cloth against cloth, itself included, and against mesh obstacles: detect, respond, guard.

The frame is cut into *intervals* of a few substeps. At the start of one, the pairs that are near are listed; after each
substep those closer than their contact distance are pushed apart, with friction; at its end the straight way of every
particle since its start is checked by continuous collision detection, and particles that would pass through cloth are
held back until none does. If the start is free of intersections, then so is the end: standing still always is.
"""

from typing import Any

import numpy as np
import warp as wp

from ..diagnostics import count_torn, torn_cloth
from ..launching import copy, fill, launch, only_if, repeat_while
from ..model import Model
from ..obstacles import Obstacle
from ..state import Memory, State
from ..surface import Surface, world_edges
from .clusters import Clusters
from .hold import Hold
from .intervals import intervals_needed
from .knots import Knots
from .pair_finder import PairFinder
from .pair_list import PairList

SEPARATION = 1e-6  # [m] that the guard keeps between any two; well above the rounding of float32 at a metre
REACH = 1.25  # pairs nearer than this many contact distances are listed
TORN = 10.0  # an edge this many times its length is near everything, and no guard can keep it from that
PASSES = 2  # of the response each substep. With one, creep on an incline and strain in piles are three times as large
ROUNDS = 100  # of parting what would meet, before the rest is held back; few scenes need more than 4
# Rounds over which the clearance grows; without that a spinning ball at 9 m/s took 300, with it 40. Tried besides: to
# part what is only near to what met, too. Heaps of folds were parted sooner, but that ball then held the curtains.
PATIENCE = 50
CLEARANCE = 0.3  # share of its contact distance at which a pair that would have met ends


class ClothContact:
    """Contact among all cloths and mesh obstacles of each world.

    Args:
        model: the model.
        support: per particle normal and speed of an obstacle that held it up in the step before, or zero; the response
            of particles to obstacles keeps it.
        threads: of the CPU that step it.

    Attributes:
        pairs: those that are near, for the response; at the end of an interval those that may meet, for the guard.
        counts: how many particles the guard has held back, and how many pairs it could not keep apart as neither side
            was free to stop, or particles out of an obstacle; since the beginning.
    """

    def __init__(self, model: Model, support: wp.array, threads: int = 1):
        self.model, self._support = model, support
        self.kernels = model.kernels
        self.surface = surface = Surface(model)
        n, tris, device = surface.particle_count, surface.tri_count, model.device
        self._worlds = self._edges_and_obstacles()
        self.pairs = PairList(model, max(64, tris // 2))
        self.start, self.before, self.now, self.free = (self.surface.positions() for _ in range(4))
        self.move, self.kick = (wp.zeros((n, 3), dtype=wp.int64, device=device) for _ in range(2))
        self.share, self.lack = (wp.zeros(n, dtype=wp.int64, device=device) for _ in range(2))
        self._no_lack = wp.zeros(0, dtype=wp.int64, device=device)
        self._make_load(surface)
        self.torn = wp.zeros(model.world_count, dtype=wp.int32, device=device)
        self.impacts, self.remaining, self.rounds = (wp.zeros(1, dtype=wp.int32, device=device) for _ in range(3))
        self.counts, self.counts_before = (wp.zeros(4, dtype=wp.int32, device=device) for _ in range(2))
        self.finder = PairFinder(model, surface, threads)
        self.width = self.finder.width
        self.met = wp.zeros(n, dtype=wp.int32, device=device)
        clusters = Clusters(model, surface)
        self.knots = Knots(model, surface, self.pairs, clusters, self.width)
        self.hold = Hold(model, surface, self.finder, self.pairs, clusters, SEPARATION)

    def intervals(self, dt: float) -> int:
        """Intervals in a frame of dt [s]: as many as the world with the fastest obstacles and finest cloth needs."""
        return max(intervals_needed(edge, obstacles, dt) for edge, obstacles in self._worlds)

    def begin(self, state: State, span: float) -> None:
        """Starts an interval of ``span`` [s] at ``state``; lists what is near, or will be at the present velocities.

        Obstacles are where they are now, afterwards.
        """
        model, surface = self.model, self.surface
        model.shapes.place(model.tracks, state.world_time, span)
        surface.place(state.particle_q, model.shapes.end, self.before)
        self._launch(self.kernels.contact_pairs.foresee, model.particle_count, [state.particle_qd, span], [self.before])
        model.shapes.place(model.tracks, state.world_time, 0.0)
        surface.place(state.particle_q, model.shapes.end, self.now)
        copy(self.start, self.now)
        self.hold.begin(state)
        self.knots.begin()
        finder = self.finder
        finder.look_at_fans(self.start, self.start, finder.everything)
        finder.measure_drift(self.start, self.before)
        ways = (self.start, self.before, finder.everything)
        finder.find(self.pairs, *ways, 0.0, finder.flat, foreseen=True, radii=REACH)

    def resolve(self, state_in: State, state_out: State, dt: float) -> None:
        """Pushes apart what is too close at ``state_out``, dt [s] after ``state_in``; obstacles have been placed."""
        model, surface = self.model, self.surface
        copy(self.before, self.now)
        copy(self.before, state_in.particle_q, count=model.particle_count)
        surface.place(state_out.particle_q, model.shapes.end, self.now)
        copy(self.free, self.now)
        fill(self.further.number)
        fill(self.further.another)
        for number in range(PASSES):
            self.knots.forget()
            self._pass(state_in, state_out, dt, first=number == 0)
        repeat_while(self.further.another, lambda: self._further_pass(state_in, state_out, dt))
        self.knots.join(self.before, self.now, state_out)

    def memory(self) -> list[Memory]:
        """What is kept from step to step."""
        particles = np.arange(self.model.particle_count)
        lengths = [Memory(self.load.length, particles), Memory(self._support, particles)]
        return [*lengths, Memory(self.knots.wary, None)]

    def end(self, state: State, span: float) -> None:
        """Ends an interval of ``span`` [s] at ``state``: holds back what would have passed through cloth."""
        model = self.model
        count_torn(model, state, TORN, self.torn)
        copy(self.now, state.particle_q, count=model.particle_count)
        fill(self.rounds)
        fill(self.impacts, 1)
        fill(self.remaining)
        self._launch(self.kernels.contact_guard.give_up, model.world_count, [self.torn], [self.impacts])
        fill(self.met, 1)
        self.finder.measure_drift(self.start, self.now)
        repeat_while(self.impacts, lambda: self._part(state, span))
        only_if(self.remaining, lambda: self._hold(state, span))
        if model.shapes.count > 0:
            solids = [model.particle_inv_mass, model.particle_world, model.shapes.shapes]
            inputs = [*solids, state.particle_q, model.shapes.end]
            self._launch(self.kernels.contact_guard.count_pinched, model.particle_count, inputs, [self.counts])

    def remember(self) -> None:
        """Keeps what :meth:`recall` restores."""
        copy(self.counts_before, self.counts)

    def recall(self) -> None:
        """Counts nothing of what was since :meth:`remember`."""
        copy(self.counts, self.counts_before)

    def grow(self) -> bool:
        """Whether a list was too short; it is longer now, and all since :meth:`remember` must be done again.

        Raises:
            DivergedError: the integrator moved particles absurdly far. The guard would hold them, and hide that.
        """
        torn = self.torn.numpy().copy()
        if torn.any():
            fill(self.torn)  # worlds may be reset, and go on
            raise torn_cloth(torn, TORN)
        short = any([self.pairs.grow(), self.finder.grow()])
        if short:
            self.recall()
        return short

    def metrics(self) -> dict[str, Any]:
        """What the guard has done so far.

        ``contact_impacts``: pairs parted that would have met; ``contact_rounds``: most rounds this took at once;
        ``contact_held``: particles held back as parting had not been enough; ``contact_pinched``: pairs that meet as
        neither side was free to stop, and particles that are left in an obstacle.
        """
        names = ("contact_held", "contact_pinched", "contact_impacts", "contact_rounds")
        return dict(zip(names, self.counts.numpy().tolist(), strict=True))

    def _hold(self, state: State, span: float) -> None:
        self.hold.run(state, span, self.start, self.now, self.met, self.counts)
        self.knots.be_wary(self.hold.open_worlds)

    def _make_load(self, surface: Surface) -> None:
        """Memory for load, none at first, and for the passes that it earns (``kernels/contact_load.py``)."""

        def numbers(count: int, dtype: type = wp.int32) -> wp.array:
            return wp.zeros(count, dtype=dtype, device=self.model.device)

        self.load = self.kernels.contact_load.Load()
        self.load.length = numbers(surface.cloth_particles, self.model.real)
        self.load.radius, self.load.world = surface.radius, surface.world
        self.further = self.kernels.contact_load.FurtherPasses()
        self.further.number, self.further.another = numbers(1), numbers(1)
        self.further.world_now, self.further.world_next = (numbers(self.model.world_count) for _ in range(2))

    def _edges_and_obstacles(self) -> list[tuple[float, list[Obstacle]]]:
        """Of each world with cloth: the shortest of its cloths' median edges [m], and its obstacles."""
        obstacles = self.model.shapes.obstacles
        edges = world_edges(self.model)
        return [(edge, [row[1] for row in obstacles if row[0] == world]) for world, edge in edges.items()]

    def _part(self, state: State, span: float) -> None:
        """One round of impacts; it goes on while there are any, up to ``ROUNDS``.

        After the first, only what met in the round before can have changed, and is looked at.
        """
        found, surface, kernels = self.pairs, self.surface, self.kernels
        self.finder.look_at_fans(self.start, self.now, self.met)
        self.finder.find(found, self.start, self.now, self.met, 2.0 * SEPARATION, self.finder.flat)
        fill(self.impacts)
        fill(self.met)
        self._launch(
            kernels.contact_impact.find_impacts, self.width,
            [
                surface.inv_mass, found.pairs, SEPARATION, CLEARANCE, PATIENCE, self.width, self.start, self.now,
                self.rounds,
            ],
            [found.contacts, self.share, self.met, self.impacts, self.counts],
        )  # fmt: skip
        self._launch(
            kernels.contact_impact.count_round, 1, [ROUNDS], [self.impacts, self.remaining, self.rounds, self.counts]
        )
        self._launch(
            kernels.contact_impact.bounce, self.width,
            [
                surface.inv_mass, surface.friction, found.pairs, self.width, self.start, self.now, state.particle_qd,
                self.model.particle_count, span, found.contacts, self.share, self.impacts, self.rounds,
            ],
            [self.move, self.kick],
        )  # fmt: skip
        self._commit(state, span)
        self._launch(
            kernels.contact_impact.keep_out, self.model.particle_count,
            [surface.world, surface.radius, self.model.shapes.shapes, self.now, self.model.shapes.end],
            [state.particle_q],
        )  # fmt: skip
        copy(self.now, state.particle_q, count=self.model.particle_count)

    def _pass(self, state_in: State, state_out: State, dt: float, first: bool = False) -> None:
        """What all contacts at once ask for on the way of a step; the ``first`` looks what pairs lack at its start."""
        near, surface, kernels = self.pairs, self.surface, self.kernels.contact_response
        count = self.model.particle_count
        self._launch(
            kernels.stand, count,
            [dt, self._support, self.load, state_in.particle_q, state_out.particle_q],
            [self.now, self.free],
        )  # fmt: skip
        self._launch(
            kernels.find_contacts, self.width,
            [near.pairs, self.width, self.now, self.load],
            [near.contacts, self.share, self.further, self.knots.crossed],
        )  # fmt: skip
        lack = self.lack if first else self._no_lack
        self._launch(
            kernels.push_contacts, self.width,
            [
                surface.inv_mass, surface.friction, near.pairs, self.width, self.before, self.now, self.free, dt,
                near.contacts, self.share, self.load,
            ],
            [self.move, self.kick, lack],
        )  # fmt: skip
        if first:
            adapt = self.kernels.contact_load.adapt_load
            self._launch(adapt, count, [dt, self.share], [self.load, self.lack])
        self._commit(state_out, dt)

    def _further_pass(self, state_in: State, state_out: State, dt: float) -> None:
        """One more for worlds whose load has earned it; such passes go on while there are any."""
        outputs = [self.further, self.knots.crossed.world]
        self._launch(self.kernels.contact_load.begin_pass, self.model.world_count, [], outputs)
        self._pass(state_in, state_out, dt)

    def _commit(self, state: State, dt: float) -> None:
        self._launch(
            self.kernels.contact_response.commit_push, self.model.particle_count, [dt],
            [state.particle_q, state.particle_qd, self.move, self.kick, self.share, self.free],
        )  # fmt: skip

    def _launch(self, kernel: wp.Kernel, dim: int, inputs: list, outputs: list) -> None:
        launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=self.model.device)
