"""Bringing a specimen to rest."""

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from ..errors import ConvergenceWarning
from ..fabric import STANDARD_GRAVITY
from ..integrators import INTEGRATORS, Integrator, option_names
from ..model import Model
from ..simulation import Simulation
from ..stability import fastest_rates
from .setup import Setup

LONG_STEP, SHORT_STEP = 5.0, 0.1  # [swings] of schemes that take any step, and of others
RESOLVED = 2.0  # ω h to which schemes that sweep over springs converge in a sweep, if they start from the last forces
MAX_FRAMES = 3000
STILL = 1e-6  # of its length, by which a specimen at rest moves in a swing
STILL_FRAMES = 10


def damping_time(length: float) -> float:
    """Damping time of fabric [s] that takes the ringing of springs out of a specimen of that length [m]."""
    return 3e-3 * math.sqrt(length / STANDARD_GRAVITY)


@dataclass(frozen=True, eq=False)
class Settled:
    """A specimen at rest: positions [m], shape [n, 3]; what forces are left over its weight; whether that is little."""

    positions: np.ndarray
    residual: float
    settled: bool


def settle(
    model: Model,
    setup: Setup,
    length: float,
    *,
    gravity: tuple[float, float, float] = (0.0, 0.0, -STANDARD_GRAVITY),
    tolerance: float = 1e-5,
    frames: int = MAX_FRAMES,
) -> Settled:
    """Runs until the specimen is in equilibrium, its weight and forces balanced to ``tolerance``, or stands still.

    Position-based schemes balance forces at rest only if each step begins with all of the forces of the step before and
    resolves the fastest swing of the springs; those that have the choice do so here.

    Schemes without a stability limit take steps of several swings, whose numerical damping is what is wanted here; the
    others take small ones; all relax dynamically, which changes the way to the equilibrium but not where it is.

    Args:
        model: what rests.
        setup: the scheme.
        length: of the specimen [m]; √(length/g) is the time of its swings.
        gravity: [m/s²]; where there is none, times and forces are measured by the standard one.
        tolerance: of the root mean square force over the mean weight of a particle.
        frames: after which it counts as not settled.
    """
    strength = float(np.linalg.norm(gravity)) or STANDARD_GRAVITY
    swing = math.sqrt(length / strength)
    large = takes_any_step(INTEGRATORS[setup.integrator](model))
    dt = LONG_STEP * swing if large else SHORT_STEP * swing
    sim = Simulation(model, setup.integrator, gravity, contact="none", **balanced(model, setup.integrator, dt))
    relaxation = Relaxation(sim)
    free = model.particle_inv_mass.numpy() > 0.0
    scale = float(np.mean(model.particle_mass.numpy())) * strength
    residual, quiet, settled = math.inf, 0, False
    for _ in range(frames):
        start = sim.state.particle_q.numpy().copy()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # on the way; the end is judged by its forces
            sim.step(dt)
        way = float(np.sqrt(np.mean((sim.state.particle_q.numpy() - start) ** 2)))
        quiet = quiet + 1 if way < STILL * length * dt / swing else 0
        relaxation.calm()
        residual = _residual(sim, free, scale)
        settled = residual < tolerance or quiet >= STILL_FRAMES
        if settled:
            break
    return Settled(sim.state.particle_q.numpy().astype(np.float64), residual, settled)


class Relaxation:
    """Dynamic relaxation: all velocities are set to zero whenever kinetic energy has passed a maximum (Day 1965)."""

    def __init__(self, sim: Simulation):
        self.sim, self._before = sim, math.inf
        self._still = np.zeros((sim.model.particle_count, 3))

    def calm(self) -> None:
        """After a step."""
        kinetic = self.sim.energy()["kinetic"]
        if kinetic < self._before:
            self.sim.state.particle_qd.assign(self._still)
            kinetic = 0.0
        self._before = kinetic


def balanced(model: Model, integrator: str, dt: float) -> dict[str, Any]:
    """Options of a simulation whose rest shape is an equilibrium, for frames of dt [s]."""
    if "warm_start" not in option_names(INTEGRATORS[integrator]):
        return {}
    substeps = max(1, math.ceil(dt * fastest_rates(model)[0] / RESOLVED))
    return {"substeps": substeps, "integrator_options": {"warm_start": 1.0}}


def takes_any_step(scheme: Integrator) -> bool:
    """Whether steps much longer than a swing are stable and damped."""
    unlimited = math.isinf(scheme.stable_step(1.0, 0.0)) and math.isinf(scheme.advised_step())
    return scheme.implicit and scheme.order == 1 and unlimited


def _residual(sim: Simulation, free: np.ndarray, scale: float) -> float:
    """Root mean square force on the free particles at rest, over ``scale``."""
    state = sim.state.twin()
    state.particle_qd.zero_()
    sim.forces.evaluate(state)
    wp.synchronize_device(sim.model.device)
    force = state.particle_f.numpy()[free]
    return float(np.sqrt(np.mean(np.sum(force**2, axis=1)))) / scale
