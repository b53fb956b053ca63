"""One step of implicit Euler: how fast the iterative schemes approach Newton's solution of it.

Projective dynamics, vertex block descent and XPBD all solve, or approximate, the same nonlinear equation in each step.
Newton's method solves it to round-off; the others are stopped after 1, 2, 4, … iterations and compared.
"""

import statistics
import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import warpcloth as wc
from warpcloth.integrators import INTEGRATORS

from .problems import Problem, Solution
from .reference import finest_scheme
from .runs import beyond_limits, solution, try_step

TRUTH = "implicit_euler"
OPTION = "iterations"
STEP = 1 / 120  # [s]
REPEAT_BELOW = 0.05  # [s] shorter steps are timed five times
MOST = 4096


@dataclass(frozen=True)
class Row:
    """One step with so many iterations: relative error of its positions, and wall time [s]."""

    iterations: int
    error: float
    wall_s: float


def iterative_schemes(names: list[str]) -> list[str]:
    """Those whose number of iterations is an option."""
    known = wc.integrators()
    return [name for name in names if OPTION in known[name].options]


def moving_state(problem: Problem, time_s: float = 0.1) -> Solution:
    """Positions and velocities at ``time_s``, when springs are strained and particles move."""
    scheme = finest_scheme()
    sim = problem.simulation(scheme.name, "auto")
    sim.run(round(time_s * 60), 60.0)
    return solution(sim)


class OneStep:
    """A step of ``STEP`` from a state, by any scheme, and the distance of its end from Newton's.

    The distance is relative to what the spring forces do in the step: 1 is what inertia and gravity alone would give.
    """

    def __init__(self, problem: Problem):
        self.problem = problem
        self.start = moving_state(problem)
        self.truth, _ = self._end(TRUTH, dict(INTEGRATORS[TRUTH].convergence_options))
        free = self.start[0] + STEP * self.start[1] + STEP**2 * np.array(problem.gravity)
        moves = (problem.build(True).particle_inv_mass.numpy() > 0.0)[:, None]
        self.scale = float(np.linalg.norm((self.truth - free) * moves))

    def row(self, integrator: str, iterations: int) -> Row:
        """The step with so many iterations."""
        runs = [self._end(integrator, {OPTION: iterations})]
        while len(runs) < 5 and runs[0][1] < REPEAT_BELOW:
            runs.append(self._end(integrator, {OPTION: iterations}))
        wall = statistics.median(run[1] for run in runs)
        return Row(iterations, float(np.linalg.norm(runs[0][0] - self.truth) / self.scale), wall)

    def _end(self, integrator: str, options: dict[str, Any]) -> tuple[np.ndarray, float]:
        with beyond_limits():
            sim = self.problem.simulation(integrator, 1, options)
            sim.state.particle_q.assign(self.start[0])
            sim.state.particle_qd.assign(self.start[1])
            begun = time.perf_counter()
            try_step(sim, STEP)
            end = sim.state.particle_q.numpy()
        return end, time.perf_counter() - begun


def approach(step: OneStep, integrator: str, budget: float) -> list[Row]:
    """Rows with iterations doubled until round-off, 4096, or ``budget`` [s] of wall time."""
    step.row(integrator, 1)  # compiles
    rows: list[Row] = []
    while not rows or (rows[-1].error > 1e-12 and rows[-1].iterations < MOST and budget > 2.0 * rows[-1].wall_s):
        rows.append(step.row(integrator, 2 * rows[-1].iterations if rows else 1))
        budget -= rows[-1].wall_s
    return rows


def as_rows(rows: list[Row]) -> list[dict[str, Any]]:
    """For JSON."""
    return [asdict(row) for row in rows]
