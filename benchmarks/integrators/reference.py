"""Reference solutions: in closed form, or by the most accurate scheme at steps so fine that finer ones agree."""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

import warpcloth as wc
from warpcloth import stability
from warpcloth.errors import InputError
from warpcloth.integrators import IntegratorInfo

from .problems import Problem, Solution
from .runs import LEAST_TIME, beyond_limits, compile_seconds, run_frames, solution, split

STIFF = "bdf2"  # of the schemes of order 2 without a stable step the one that damps what its steps do not resolve
TARGET = 1e-11  # relative difference of two references at which the finer one is good enough


@dataclass(frozen=True, eq=False)
class Reference:
    """Positions [m] and velocities [m/s] at a problem's end, and how well they are known.

    Attributes:
        uncertainty: relative difference between the two finest solutions; 0 in closed form.
        method: how it was found.
    """

    solution: Solution
    uncertainty: float
    method: str


def finest_scheme(schemes: Mapping[str, IntegratorInfo] | None = None) -> IntegratorInfo:
    """The explicit scheme of highest order among those with fixed steps; references come from it."""
    candidates = [
        info for info in (schemes or wc.integrators()).values() if info.capturable and not info.implicit
    ]  # fmt: skip
    return max(candidates, key=lambda info: (info.order, not info.symplectic))


def reference(problem: Problem, budget: float) -> Reference:
    """The truth that runs of ``problem`` are compared with.

    Steps are halved, once at least, until two solutions agree to 1e-11 or another would exceed ``budget`` [s]. Where
    stability alone asks for so many steps that the first two exceed it, and 10 s, the scheme is :data:`STIFF`, from
    the coarsest steps of the problem on.

    Raises:
        InputError: those of that scheme exceed it, too.
    """
    if problem.exact is not None:
        return Reference(problem.exact(), 0.0, "closed form")
    scheme = finest_scheme().name
    sim = problem.simulation(scheme, 1)
    stable = 2 * int(np.ceil(problem.end / stability.largest_stable_step(sim.model, sim.integrator)))
    coarse = max(1, round(problem.end / problem.first_step))
    most = max(budget, LEAST_TIME)
    for name, steps, time_left in ((scheme, stable, budget), (STIFF, coarse, most)):
        compile_seconds(problem, name)
        begun = time.perf_counter()
        first = _solve(problem, name, steps, most / 3.0)  # the second takes twice as long
        second = None if first is None else _solve(problem, name, 2 * steps, most - (time.perf_counter() - begun))
        if first is not None and second is not None:
            spent = time.perf_counter() - begun
            return _refined(problem, name, 2 * steps, (first, second), time_left - spent, 2.0 / 3.0 * spent)
    raise InputError(
        f"A reference solution of '{problem.name}' takes longer than {most:.3g} s, with {STIFF} as well; give a larger "
        "--budget, of which references get ten times as much, or fewer --frames of the scene."
    )


def _refined(
    problem: Problem, scheme: str, steps: int, pair: tuple[Solution, Solution], budget: float, spent: float
) -> Reference:
    """From a pair of solutions on, the finer one of ``steps`` steps, which took ``spent`` [s]."""
    found, gap = pair[1], _gap(problem, *pair)
    while gap > TARGET and 3.0 * spent < budget:
        begun = time.perf_counter()
        finer = _solve(problem, scheme, 2 * steps, math.inf)
        assert finer is not None  # it had all the time it wanted
        spent = time.perf_counter() - begun
        budget -= spent
        found, gap, steps = finer, _gap(problem, found, finer), 2 * steps
    return Reference(found, gap, f"{scheme}, {steps} steps of {problem.end / steps:.3g} s")


def _solve(problem: Problem, scheme: str, steps: int, most: float) -> Solution | None:
    """None: it takes longer than ``most`` [s]. Frames of one step, where steps are long, so that the clock is seen."""
    frames, substeps = (steps, 1) if scheme == STIFF else split(steps)
    with beyond_limits():
        sim = problem.simulation(scheme, substeps)
        return solution(sim) if run_frames(sim, frames, problem.end / frames, most) else None


def _gap(problem: Problem, coarse: Solution, fine: Solution) -> float:
    start = problem.build(True).particle_q.numpy()
    return float(np.linalg.norm(coarse[0] - fine[0]) / np.linalg.norm(fine[0] - start))
