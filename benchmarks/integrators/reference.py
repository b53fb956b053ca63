"""Reference solutions: in closed form, or by the most accurate scheme at steps so fine that finer ones agree."""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

import warpcloth as wc
from warpcloth import stability
from warpcloth.integrators import IntegratorInfo

from .problems import Problem, Solution
from .runs import beyond_limits, compile_seconds, solution, split

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

    Steps are halved, once at least, until two solutions agree to 1e-11 or another would exceed ``budget`` [s].
    """
    if problem.exact is not None:
        return Reference(problem.exact(), 0.0, "closed form")
    scheme = finest_scheme()
    sim = problem.simulation(scheme.name, 1)
    steps = 2 * int(np.ceil(problem.end / stability.largest_stable_step(sim.model, sim.integrator)))
    compile_seconds(problem, scheme.name)
    begun = time.perf_counter()
    found, gap = _solve(problem, scheme.name, steps), math.inf
    spent = time.perf_counter() - begun
    while gap > TARGET and (math.isinf(gap) or 3.0 * spent < budget):
        steps *= 2
        begun = time.perf_counter()
        coarser, found = found, _solve(problem, scheme.name, steps)
        spent = time.perf_counter() - begun
        budget -= spent
        gap = _gap(problem, coarser, found)
    return Reference(found, gap, f"{scheme.name}, {steps} steps of {problem.end / steps:.3g} s")


def _solve(problem: Problem, scheme: str, steps: int) -> Solution:
    frames, substeps = split(steps)
    with beyond_limits():
        sim = problem.simulation(scheme, substeps)
        for _ in range(frames):
            sim.step(problem.end / frames)
    return solution(sim)


def _gap(problem: Problem, coarse: Solution, fine: Solution) -> float:
    start = problem.build(True).particle_q.numpy()
    return float(np.linalg.norm(coarse[0] - fine[0]) / np.linalg.norm(fine[0] - start))
