"""Work–precision: the error of each scheme against what it costs, over a range of steps."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from warpcloth import integrators, stability

from .problems import Problem
from .reference import Reference
from .runs import LEAST_TIME, Run, as_dict, measure

EXACT_ENOUGH = 1e-10
MOST = 40  # runs of a sweep
LOOSE = {
    "rtol": 1e-1,
    "position_tolerance": 1e-3,
    "velocity_tolerance": 1e-1,
}  # loosest tolerances; 10 times tighter each run
ASYMPTOTIC = 0.02  # relative error below which the leading term of the error rules


def sweep(problem: Problem, integrator: str, truth: Reference, budget: float, halvings: int) -> list[Run]:
    """Runs with steps halved, from the coarsest that can be stable; or with tolerances tightened, where the scheme
    chooses its own steps and no obstacle bounds them.

    The last is the one whose error is as small as the reference can show, or the last before ``budget`` [s] of wall
    time (four times that for the first three stable runs) or ``halvings`` of stable steps run out. There is none where
    the first takes longer than that and than 10 s.
    """
    runs: list[Run] = []
    stable, most = 0, 4.0 * budget
    floor = max(EXACT_ENOUGH, truth.uncertainty)
    for steps, options in _settings(problem, integrator):
        longest = max(most, LEAST_TIME) if not runs else most
        found = measure(problem, integrator, steps, truth.solution, options, longest)
        if found is None:
            break
        runs.append(found)
        spent = runs[-1].wall_s
        budget, most = budget - spent, most - spent
        stable += not runs[-1].diverged
        if runs[-1].position_error < floor or 2.0 * spent > (budget if stable >= 3 else most) or stable > halvings:
            break
    return runs


def _settings(problem: Problem, integrator: str) -> Iterator[tuple[int, dict[str, float]]]:
    """Numbers of steps and options, from coarse to fine."""
    if integrators()[integrator].adaptive and problem.contact == "none":
        for k in range(MOST):
            yield 1, {name: value * 0.1**k for name, value in LOOSE.items()}
        return
    steps = first_steps(problem, integrator)
    for k in range(MOST):
        yield steps * 2**k, {}


def first_steps(problem: Problem, integrator: str) -> int:
    """Steps of the coarsest run: of ``problem.first_step``, halved to at most twice what is known to be stable."""
    sim = problem.simulation(integrator, 1)
    longest = min(problem.first_step, 2.0 * stability.largest_stable_step(sim.model, sim.integrator))
    coarsest = max(1, round(problem.end / problem.first_step))
    return coarsest * 2 ** max(0, math.ceil(math.log2(problem.end / coarsest / longest) - 1e-9))


def observed_order(runs: Sequence[Run], truth: Reference) -> float | None:
    """Slope of the error between the two finest runs that the reference is at least 30 times better than; or None."""
    low = max(30.0 * truth.uncertainty, 30.0 * EXACT_ENOUGH)
    good = [run for run in runs if low < run.position_error < ASYMPTOTIC]
    if len(good) < 2:
        return None
    coarse, fine = good[-2:]
    return math.log(coarse.position_error / fine.position_error) / math.log(fine.steps / coarse.steps)


def cheapest(runs: Sequence[dict[str, Any]], error: float) -> dict[str, Any] | None:
    """The run of least wall time that is at least as accurate as ``error``, or None."""
    good = [run for run in runs if run["position_error"] is not None and run["position_error"] <= error]
    return min(good, key=lambda run: run["wall_s"]) if good else None


def as_rows(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """For JSON."""
    return [as_dict(run) for run in runs]
