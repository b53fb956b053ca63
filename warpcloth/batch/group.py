"""Samples stepped together as worlds of one model, each until it has had its frames or rests."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import warp as wp

from .. import diagnostics
from ..errors import SimulationError
from ..program import default_threads
from ..scenes.built import by_cloth, make_model, make_simulation
from ..simulation import Simulation
from .prepared import Prepared
from .recorder import Recorder

CROWD = 0.75  # share of worlds still at work below which the others are taken out of the model


@dataclass(eq=False)
class Member:
    """A sample in a group: where it is written to, what it has cost so far [s]."""

    prepared: Prepared
    recorder: Recorder
    seconds: float = field(default=0.0)


class Group:
    """Members that share a model; see :attr:`Prepared.companions`.

    Args:
        members: the samples.
        stop_at_rest: whether a sample may end before its last frame.
        seconds: most wall time a sample may take.
        threads: cores of the CPU that are there for it; small groups use fewer.
        on_frame: called after each frame.
        on_end: called with each member whose folder is complete.
    """

    def __init__(
        self,
        members: Sequence[Member],
        *,
        stop_at_rest: bool,
        seconds: float | None,
        threads: int,
        on_frame: Callable[[], None],
        on_end: Callable[[Member], None],
    ):
        self.stop_at_rest, self.seconds, self.threads = stop_at_rest, seconds, threads
        self.on_frame, self.on_end = on_frame, on_end
        self.members = list(members)  # one for each world of the model
        self.working = set(range(len(self.members)))
        self.frame = 0
        self._lap = time.perf_counter()
        self.simulation = self._start(self.members)

    def run(self) -> None:
        """Steps all worlds to their ends.

        Raises:
            WarpclothError: one of them cannot go on; ``worlds`` of a SimulationError are numbers in ``members``.
        """
        self._record()
        while self.working:
            self.simulation.step(1.0 / self.members[0].prepared.scene.fps)
            self.frame += 1
            self._record()
            self._charge()
            self.on_frame()
            ended = sorted(w for w in self.working if self._ends(w))
            if ended:
                self._finish(ended)
                self._thin_out()

    def _start(self, members: Sequence[Member]) -> Simulation:
        self.scenes = [member.prepared.built for member in members]
        model = make_model(self.scenes)
        return make_simulation(self.scenes, model, threads=min(self.threads, default_threads(model.particle_count)))

    def _ends(self, world: int) -> bool:
        prepared, simulation = self.members[world].prepared, self.simulation
        rests = self.stop_at_rest and simulation.time >= prepared.last_motion and simulation.settled_worlds()[world]
        return bool(rests) or self.frame >= prepared.scene.frames

    def _charge(self) -> None:
        """Shares the time of the frame among those at work."""
        wp.synchronize_device(self.simulation.model.device)
        now = time.perf_counter()
        share = (now - self._lap) / len(self.working)
        self._lap = now
        for w in self.working:
            self.members[w].seconds += share
        slow = [w for w in sorted(self.working) if self.seconds is not None and self.members[w].seconds > self.seconds]
        if slow:
            raise SimulationError(f"It took longer than {self.seconds:g} s.", tuple(slow))

    def _record(self) -> None:
        recording = [w for w in sorted(self.working) if self.members[w].recorder.wants_frames]
        if recording:
            points, velocities = self._arrays()
            for w in recording:
                self.members[w].recorder.frame(self.frame, points[w], velocities[w], self._facts())

    def _arrays(self) -> list[list[dict[str, np.ndarray]]]:
        state, model = self.simulation.state, self.simulation.model
        return [by_cloth(self.scenes, model, values.numpy()) for values in (state.particle_q, state.particle_qd)]

    def _facts(self) -> dict[str, int | str]:
        return {"substeps": self.simulation.substeps, "device": str(self.simulation.model.device)}

    def _finish(self, ended: Sequence[int]) -> None:
        """Completes the folders of worlds that have ended."""
        simulation = self.simulation
        model, state = simulation.model, simulation.state
        points, velocities = self._arrays()
        measures = diagnostics.measure_worlds(model, state, simulation.time)
        strain, particle, _ = diagnostics.every_strain(model, state)
        spring_world = model.particle_world.numpy()[particle]
        settled = simulation.settled_worlds()
        for w in ended:
            own = strain[spring_world == w]
            sizes = {"particles": sum(map(len, points[w].values())), "springs": len(own)}
            metrics = {"frames": self.frame, **sizes, **self._facts(), **measures[w], "settled": bool(settled[w])}
            member = self.members[w]
            try:
                member.recorder.finish(self.frame, points[w], velocities[w], self._facts(), metrics, own)
            except SimulationError as error:
                error.worlds = (w,)
                raise
            self.working.discard(w)
            self.on_end(member)

    def _thin_out(self) -> None:
        """Goes on without the worlds that have ended, once they are many."""
        if not self.working or len(self.working) > CROWD * len(self.members):
            return
        kept = sorted(self.working)
        before = self.simulation
        self.members = [self.members[w] for w in kept]
        self.simulation = self._start(self.members)
        self.simulation.continue_from(before, kept)
        self.working = set(range(len(kept)))
