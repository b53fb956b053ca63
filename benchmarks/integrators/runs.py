"""One scheme on one problem with one step: what it costs and how far off it ends."""

import math
import statistics
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcloth import Model, Simulation, State, diagnostics
from warpcloth.errors import SimulationError

from .problems import Problem, Solution

LARGEST_FRAME = 16  # steps that share a graph; more make capturing slow and replay hardly faster
LEAST_TIME = 10.0  # [s] that what a table cannot do without may take, however small the budget
REPEAT_BELOW = 0.15  # [s] shorter runs are timed three times, unless they fail
HOPELESS = 1e3  # relative error of a run that has diverged


@dataclass(frozen=True)
class Run:
    """Outcome of one run.

    Attributes:
        steps: integrator steps taken, by adaptive schemes those they accepted. step: their length [s].
        evaluations: force evaluations. iterations: of a scheme's linear solver, each about as much work as one of them.
        unconverged: steps whose solver gave up.
        wall_s: median wall time [s], compilation and graph capture excluded. repeats: how many were timed.
        cpu_s: median processor time of this process [s], which other programs on the machine hardly change.
        position_error, velocity_error: relative to the way and to the speed of the reference; infinite if diverged.
        strain: mean |strain| of the springs at the end [-].
    """

    steps: int
    step: float
    evaluations: int
    iterations: int
    unconverged: int
    wall_s: float
    cpu_s: float
    repeats: int
    position_error: float
    velocity_error: float
    strain: float

    @property
    def work(self) -> int:
        """Force evaluations and solver iterations."""
        return self.evaluations + self.iterations

    @property
    def diverged(self) -> bool:
        """Whether it ended without finite numbers, or further off than the whole way."""
        return not self.position_error < HOPELESS


def split(steps: int) -> tuple[int, int]:
    """Frames, and steps per frame, that make ``steps`` steps."""
    substeps = max(n for n in range(1, min(steps, LARGEST_FRAME) + 1) if steps % n == 0)
    return steps // substeps, substeps


def compile_seconds(problem: Problem, integrator: str, options: dict | None = None) -> float:
    """Loads or compiles all kernels that a run needs, which later ones then find; the time that took [s]."""
    begun = time.perf_counter()
    with beyond_limits():
        try_step(problem.simulation(integrator, 1, options), 1e-6)
    wp.synchronize()
    return time.perf_counter() - begun


@contextmanager
def beyond_limits() -> Iterator[None]:
    """Unstable steps and overflow are part of the experiment: no warnings about them."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


def measure(
    problem: Problem, integrator: str, steps: int, truth: Solution, options: dict | None = None, most: float = math.inf
) -> Run | None:
    """Runs ``problem`` to its end with ``steps`` steps; None: given up, as that takes longer than ``most`` [s]."""
    frames, substeps = split(steps)
    with beyond_limits():
        sim = problem.simulation(integrator, substeps, options)
        dt = problem.end / frames
        _warm_up(sim, dt)
        times: list[tuple[float, float]] = []
        errors = (0.0, 0.0)
        while not times or (len(times) < 3 and times[0][0] < REPEAT_BELOW and errors[0] < HOPELESS):
            sim.reset()
            before = Counts.of(sim)
            timed = _timed(sim, frames, dt, most)
            if timed is None:
                return None
            times.append(timed)
            counts = Counts.of(sim).since(before)
            errors = errors_of(sim, truth)
        strain = mean_strain(sim.model, sim.state.particle_q.numpy())
        evaluations = counts.evaluations
        if sim.graph:
            first = _count_frame(problem.simulation(integrator, substeps, options, graph=False), dt)
            evaluations = counts.all_evaluations(first, frames)
    taken = counts.accepted or frames * substeps
    work = (evaluations, counts.linear, counts.unconverged)
    wall, cpu = (statistics.median(column) for column in zip(*times, strict=True))
    return Run(taken, problem.end / taken, *work, wall, cpu, len(times), *errors, strain)


@dataclass(frozen=True)
class Counts:
    """What was done: force evaluations (those in graphs not counted), Newton and linear solver iterations, steps whose
    solver gave up, and steps that an adaptive scheme accepted."""

    evaluations: int
    newton: int
    linear: int
    unconverged: int
    accepted: int

    @classmethod
    def of(cls, sim: Simulation) -> "Counts":
        """Since ``sim`` was made."""
        said = sim.integrator.metrics()
        names = ("newton_iterations_total", "cg_iterations_total", "unconverged_steps", "accepted_steps")
        return cls(sim.forces.evaluations, *[int(said.get(name, 0)) for name in names])

    def since(self, before: "Counts") -> "Counts":
        """The difference to earlier counts."""
        return Counts(*[a - b for a, b in zip(astuple(self), astuple(before), strict=True)])

    def all_evaluations(self, first: "Counts", frames: int) -> int:
        """Evaluations in graphs: as many per frame, or per Newton iteration, as in the ``first`` frame."""
        if first.newton:
            return round(first.evaluations * self.newton / first.newton)
        return first.evaluations * frames


def _count_frame(sim: Simulation, dt: float) -> Counts:
    """What is counted in the first frame, launched one by one: recorded frames are loops, which count once."""
    try_step(sim, dt)
    return Counts.of(sim)


def _warm_up(sim: Simulation, dt: float) -> None:
    """Loads the kernels and captures the frame."""
    if sim.graph:
        try_step(sim, dt)
        sim.reset()
        try_step(sim, dt)


def try_step(sim: Simulation, dt: float) -> bool:
    """One frame; whether the scheme got through it."""
    try:
        sim.step(dt)
    except SimulationError:  # a solver gave up: as good as diverged
        sim.state.particle_q.fill_(math.nan)
        return False
    return True


def run_frames(sim: Simulation, frames: int, dt: float, most: float) -> bool:
    """So many frames, or those up to one that a scheme did not get through; False: after ``most`` [s] there were more.

    It is looked at the clock after each frame.
    """
    end = time.perf_counter() + most
    for number in range(1, frames + 1):
        if not try_step(sim, dt):
            break
        if number < frames and time.perf_counter() > end:
            return False
    return True


def _timed(sim: Simulation, frames: int, dt: float, most: float) -> tuple[float, float] | None:
    """Wall time and processor time [s] of a run; None: it would have taken longer than ``most`` [s]."""
    wp.synchronize_device(sim.model.device)
    begun, begun_cpu = time.perf_counter(), time.process_time()
    if not run_frames(sim, frames, dt, most):
        return None
    wp.synchronize_device(sim.model.device)
    return time.perf_counter() - begun, time.process_time() - begun_cpu


def solution(sim: Simulation) -> Solution:
    """Positions [m] and velocities [m/s] now."""
    return sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()


def errors_of(sim: Simulation, truth: Solution) -> tuple[float, float]:
    """Errors of position and velocity, relative to the way from the start and to the speed of ``truth``."""
    (x, v), start = solution(sim), sim.model.particle_q.numpy()
    with np.errstate(all="ignore"):
        scales = np.linalg.norm(truth[0] - start), np.linalg.norm(truth[1])
        errors = [float(np.linalg.norm(a - b) / c) for a, b, c in zip((x, v), truth, scales, strict=True)]
    return (errors[0], errors[1]) if all(math.isfinite(e) for e in errors) else (math.inf, math.inf)


def mean_strain(model: Model, points: np.ndarray) -> float:
    """Mean |strain| of all springs and yarns with ``points`` [m] where the particles are."""
    state = State.of(model)
    state.particle_q.assign(points)
    return float(np.abs(diagnostics.every_strain(model, state)[0]).mean())


def as_dict(run: Run) -> dict[str, Any]:
    """For JSON."""
    return {**run.__dict__, "work": run.work, "diverged": run.diverged}
