"""Energy drift: total energy of undamped motion over a long time, every scheme with the same step."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcloth import Simulation
from warpcloth.integrators import INTEGRATORS

from .problems import Problem
from .runs import beyond_limits, try_step

SAMPLES = 240
BLOWN_UP = 1e3


@dataclass(frozen=True, eq=False)
class Drift:
    """Energy of one scheme.

    Attributes:
        times: [s], shape [k]. energy: change of the total since the start over the problem's energy scale, shape [k].
        complete: whether the run reached its end; it stops when it blows up or has used its time.
    """

    times: np.ndarray
    energy: np.ndarray
    complete: bool

    @property
    def largest(self) -> float:
        """Largest change, relative; infinite once something is not finite."""
        return float(np.abs(self.energy).max()) if np.isfinite(self.energy).all() else float("inf")

    @property
    def trend(self) -> float:
        """Mean change in the last tenth of the run, relative: what is left when oscillation averages out."""
        return float(self.energy[-max(1, len(self.energy) // 10) :].mean())


def _steps_as_given(integrator: str) -> dict[str, Any]:
    """Options that keep an adaptive scheme from choosing steps of its own."""
    cls = INTEGRATORS[integrator]
    return dict(cls.convergence_options) if cls.adaptive else {}


def drift(problem: Problem, integrator: str, budget: float, end: float | None = None) -> Drift:
    """Undamped motion for ``end`` [s] (by default the problem's ``drift_end``), or ``budget`` [s] of wall time."""
    end = problem.drift_end if end is None else end
    substeps = max(1, round(end / problem.drift_step / SAMPLES))
    count = max(1, round(end / problem.drift_step / substeps))
    dt = substeps * problem.drift_step
    with beyond_limits():
        model = problem.build(False)
        sim = Simulation(
            model, integrator, gravity=problem.gravity, substeps=substeps, contact="none", check=False,
            integrator_options=_steps_as_given(integrator),
        )  # fmt: skip
        start = sim.energy()["total"]
        energy = [0.0]
        begun = time.perf_counter()
        for _ in range(count):
            alive = try_step(sim, dt)
            energy.append((sim.energy()["total"] - start) / problem.energy_scale)
            if not alive or not abs(energy[-1]) < BLOWN_UP or time.perf_counter() - begun > budget:
                break
    return Drift(dt * np.arange(len(energy)), np.array(energy), len(energy) == count + 1 and alive)
