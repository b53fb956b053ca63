"""The largest stable step, found by bisection on motion about a stable rest, against the theory of ``stable_step``."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcloth import Cloth, Fabric, Model, Simulation, stability

from .runs import beyond_limits, try_step

STEPS = 32  # per frame
FRAMES = 80
GROWTH = 1.02  # of the second half's largest amplitude over the first half's
FAR = 100.0  # times 2/ω: a scheme stable there has no limit that matters
PRECISION = 1e-3
BLOWN_UP = 1e3  # times the first amplitude


@dataclass(frozen=True)
class Limit:
    """Largest stable steps [s]; infinite (``measured``: none up to 100 · 2/ω) where there is no limit."""

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
        sim = Simulation(model, integrator, gravity=(0, 0, 0), substeps=STEPS, contact=False, check=False)
        theory = sim.integrator.stable_step(omega, gamma)
        measured = _bisect(lambda step: _stable(model, integrator, step, omega), 2.0 / omega)
    return Limit(measured, theory, omega)


def _bisect(stable: Callable[[float], bool], scale: float) -> float:
    """Largest stable step near or above ``scale``/1000; infinite when ``FAR`` · ``scale`` is stable."""
    low, high = 0.0, scale
    if stable(high):
        if stable(FAR * scale):
            return math.inf
        while stable(2.0 * high):
            high *= 2.0
        low, high = high, 2.0 * high
    else:
        low = high
        while not stable(low):
            low *= 0.5
            if low < 1e-3 * scale:
                return 0.0
        high = 2.0 * low
    while high - low > PRECISION * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def _stable(model: Model, integrator: str, step: float, omega: float) -> bool:
    """Whether small motion about rest does not grow over 80 × 32 steps."""
    sim = Simulation(model, integrator, gravity=(0, 0, 0), substeps=STEPS, contact=False, check=False)
    start = model.particle_q.numpy()
    free = (model.particle_inv_mass.numpy() > 0.0)[:, None]
    sim.state.particle_q.assign(start + 1e-7 * free * _in_plane(model))
    first, amplitudes = _amplitude(sim, start, omega), []
    for _ in range(FRAMES):
        if not try_step(sim, STEPS * step):
            return False
        amplitudes.append(_amplitude(sim, start, omega))
        if not amplitudes[-1] < BLOWN_UP * first:
            return False
    half = FRAMES // 2
    return max(amplitudes[half:]) <= GROWTH * max(amplitudes[:half])


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
