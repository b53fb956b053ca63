"""The largest stable step, found by bisection on motion about a stable rest, against the theory of ``stable_step``."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcloth import Cloth, Fabric, Model, Simulation, stability

from .runs import beyond_limits, try_step

STEPS, FRAMES = 32, 40  # steps per frame; frames of a trial
FEW_STEPS, FEW_FRAMES = 4, 16  # the same for schemes that theory gives no limit, which are slow to step
GROWTH = 1.01  # of the second half's largest amplitude over the first half's
NEAR, CLIMB = 0.03, 1.6  # where the search begins, times 2/ω, and by how much it climbs
FAR = 50.0  # times 2/ω: a scheme stable there has no limit that matters
PRECISION = 1e-3
BLOWN_UP = 1e3  # times the first amplitude


@dataclass(frozen=True)
class Limit:
    """Largest stable steps [s]; infinite (``measured``: none up to 50 · 2/ω) where there is no limit."""

    measured: float
    theory: float
    omega: float

    @property
    def ratio(self) -> float | None:
        """Measured over theory, where both are finite and not zero."""
        finite = math.isfinite(self.measured) and math.isfinite(self.theory) and self.theory > 0.0
        return self.measured / self.theory if finite else None


def spring(damping: float = 0.05) -> Model:
    """One spring with damping ratio ζ: ω = 40/s."""
    k_d = 2.0 * damping * math.sqrt(20.0 * 0.05 * 0.25)
    return Model.from_springs(
        [[0, 0, 0], [0, 0, -0.25]], [1.0, 0.05], [[0, 1]], 0.25, 20.0, k_d, [0], precision="float64", device="cpu"
    )


def sheet() -> Model:
    """Cotton of 0.5 m × 0.5 m, 9 × 9 vertices, flat, one edge held."""
    cloth = Cloth.grid((0.5, 0.5), (9, 9), Fabric(), "left")
    return Model.build(cloth, precision="float64", device="cpu")


SYSTEMS: dict[str, Callable[[], Model]] = {"spring": spring, "sheet": sheet}


def limit(system: str, integrator: str) -> Limit:
    """Measured and theoretical limit of a scheme on one of :data:`SYSTEMS`."""
    model = SYSTEMS[system]()
    omega, gamma = stability.fastest_rates(model, model.particle_q.numpy())
    with beyond_limits():
        sim = Simulation(model, integrator, gravity=(0, 0, 0), substeps=1, contact="none", check=False)
        theory = sim.integrator.stable_step(omega, gamma)
        trial = (STEPS, FRAMES) if math.isfinite(theory) else (FEW_STEPS, FEW_FRAMES)
        climb = _climb(2.0 / omega, theory)
        measured = _bisect(lambda step: _stable(model, integrator, step, omega, *trial), climb)
    return Limit(measured, theory, omega)


def _climb(scale: float, theory: float) -> list[float]:
    """Steps to try in turn: a geometric row from ``NEAR`` to ``FAR`` times ``scale``, and one just above ``theory``."""
    count = math.ceil(math.log(FAR / NEAR, CLIMB))
    row = [NEAR * scale * (FAR / NEAR) ** (k / count) for k in range(count + 1)]
    return sorted([*row, 1.03 * theory]) if math.isfinite(theory) else row


def _bisect(stable: Callable[[float], bool], climb: Sequence[float]) -> float:
    """End of the first interval of stable steps; infinite when it reaches beyond ``climb``, 0 when it ends before.

    Some schemes are stable again beyond an interval in which they are not, so the search climbs from below.
    """
    low, high = 0.0, climb[0]
    for high in climb:
        if not stable(high):
            break
        low = high
    if low == high:
        return math.inf
    while low > 0.0 and high - low > PRECISION * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def _stable(model: Model, integrator: str, step: float, omega: float, steps: int, frames: int) -> bool:
    """Whether small motion about rest does not grow over so many frames of so many steps."""
    sim = Simulation(model, integrator, gravity=(0, 0, 0), substeps=steps, contact="none", check=False)
    start = model.particle_q.numpy()
    free = (model.particle_inv_mass.numpy() > 0.0)[:, None]
    sim.state.particle_q.assign(start + 1e-7 * free * _in_plane(model))
    first, amplitudes = _amplitude(sim, start, omega), []
    for _ in range(frames):
        if not try_step(sim, steps * step):
            return False
        amplitudes.append(_amplitude(sim, start, omega))
        if not amplitudes[-1] < BLOWN_UP * first:
            return False
    return max(amplitudes[frames // 2 :]) <= GROWTH * max(amplitudes[: frames // 2])


def _in_plane(model: Model) -> np.ndarray:
    """Where springs resist: random in the sheet's plane, along the single spring."""
    noise = np.random.default_rng(1).standard_normal((model.particle_count, 3))
    noise *= [1.0, 1.0, 0.0] if model.particle_count > 2 else [0.0, 0.0, 1.0]
    return noise


def _amplitude(sim: Simulation, rest: np.ndarray, omega: float) -> float:
    x, v = sim.state.particle_q.numpy() - rest, sim.state.particle_qd.numpy() / omega
    return float(np.sqrt(np.sum(x * x) + np.sum(v * v)))


def as_row(result: Limit) -> dict[str, Any]:
    """For JSON; infinite becomes null there."""
    return {**result.__dict__, "omega_dt": result.omega * result.measured, "ratio": result.ratio}
