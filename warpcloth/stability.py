"""How large a step may be: the fastest frequency of a spring network, and the steps that follow from it.

A network near equilibrium moves as M x″ + C x′ + K x = 0. Its fastest frequency is ω² = λ_max(M⁻¹K), its strongest
damping γ = λ_max(M⁻¹C). Both are found by power iteration on the host, once per model.

K depends on where the springs point. But every spring obeys K_e ⪯ (k_s/r) I whatever its direction and tension, so the
network in which all springs act in all directions (the weighted graph Laplacian) bounds every configuration: that is
what automatic substeps use, and why they hold when cloth crumples. On square grids it costs about a quarter more
substeps than the flat rest pose would need.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from .errors import SimulationError

if TYPE_CHECKING:
    from .integrators import Integrator
    from .model import Model

MAX_ITERATIONS = 300
TOLERANCE = 1e-5
# Cloth crushed through zero spring length, where the force jumps, gains energy when it steps at the linear limit:
# without damping a network with random jolts of one cell doubled its energy many times over in 80 frames at 0.95 of the
# limit, and kept it within 15 % at a quarter of it. With the default damping 0.7 is enough.
SAFETY = 0.7
WARNING_ITERATIONS = 60  # within about 1 % of the step


class _Network:
    """Host copy of what the eigenvalue problems need."""

    def __init__(self, model: "Model", positions: np.ndarray | None):
        ends = model.spring_indices.numpy()
        self.p, self.q = ends[:, 0], ends[:, 1]
        self.inverse_mass = model.particle_inv_mass.numpy().astype(np.float64)
        self.per_length = 1.0 / model.spring_rest_length.numpy().astype(np.float64)
        self.directions = None
        if positions is not None:
            d = positions[self.q] - positions[self.p]
            length = np.linalg.norm(d, axis=1, keepdims=True)
            self.directions = np.divide(d, length, out=np.zeros_like(d), where=length > 0.0)

    def apply(self, weights: np.ndarray, x: np.ndarray) -> np.ndarray:
        """M^(−1/2) K M^(−1/2) x, of springs of ``weights`` [N/m or N s/m]."""
        y = x * np.sqrt(self.inverse_mass)[:, None]
        d = y[self.q] - y[self.p]
        if self.directions is not None:
            d = self.directions * np.sum(self.directions * d, axis=1, keepdims=True)
        f = weights[:, None] * d
        n = len(x)
        columns = [np.bincount(self.q, c, n) - np.bincount(self.p, c, n) for c in f.T]
        return np.stack(columns, axis=1) * np.sqrt(self.inverse_mass)[:, None]

    def largest_eigenvalue(self, weights: np.ndarray, iterations: int = MAX_ITERATIONS) -> float:
        """By power iteration; 0 for a network without free ends."""
        width = 1 if self.directions is None else 3
        x = np.random.default_rng(0).standard_normal((len(self.inverse_mass), width))
        x[self.inverse_mass == 0.0] = 0.0
        value = 0.0
        for _ in range(iterations):
            norm = np.linalg.norm(x)
            if norm == 0.0:
                return 0.0
            x = self.apply(weights, x / norm)
            previous, value = value, float(np.linalg.norm(x))
            if abs(value - previous) <= TOLERANCE * value:
                break
        return value


def rate_bounds(model: "Model") -> tuple[float, float]:
    """Upper bounds of ω [1/s] and γ [1/s] in any configuration, at the cost of one sum (Gershgorin's theorem)."""
    network = _Network(model, None)
    bounds = []
    for strength in (model.spring_stiffness, model.spring_damping):
        weights = strength.numpy() * network.per_length
        ends = np.concatenate([network.p, network.q])
        total = np.bincount(ends, np.tile(weights, 2), model.particle_count)
        bounds.append(2.0 * float(np.max(total * network.inverse_mass, initial=0.0)))
    return math.sqrt(bounds[0]), bounds[1]


def fastest_rates(
    model: "Model", positions: np.ndarray | None = None, iterations: int = MAX_ITERATIONS
) -> tuple[float, float]:
    """ω [1/s] and γ [1/s] of the stiffest undamped mode and of the most damped one.

    Args:
        model: whose springs and masses.
        positions: the configuration, shape [particle_count, 3] [m]; None bounds all configurations.
        iterations: most steps of the power iteration, which approaches the eigenvalues from below.
    """
    if model.spring_count == 0:
        return 0.0, 0.0
    network = _Network(model, positions)
    stiffness = model.spring_stiffness.numpy() * network.per_length
    damping = model.spring_damping.numpy() * network.per_length
    fastest = network.largest_eigenvalue(stiffness, iterations)
    return math.sqrt(fastest), network.largest_eigenvalue(damping, iterations)


def largest_stable_step(model: "Model", integrator: "Integrator") -> float:
    """Largest step [s] that ``integrator`` can safely take in any configuration; infinite if it has no limit."""
    if math.isinf(integrator.usable_step(*rate_bounds(model))):
        return math.inf
    return SAFETY * integrator.usable_step(*fastest_rates(model))


def substeps_for(model: "Model", integrator: "Integrator", dt: float, most: int) -> int:
    """Fewest equal steps that divide dt [s] into stable ones, no larger than the integrator advises.

    Raises:
        SimulationError: more than ``most`` would be needed.
    """
    step = min(largest_stable_step(model, integrator), integrator.advised_step())
    if dt > most * step:
        raise SimulationError(
            f"{integrator.name} would need more than {most} substeps per frame of {dt:g} s to be stable; use a softer "
            "or heavier fabric, more damping, a coarser mesh, or an implicit integrator."
        )
    return max(1, math.ceil(dt / step))


def warning_of_unstable_steps(
    model: "Model", integrator: "Integrator", positions: np.ndarray, dt: float, substeps: int
) -> str | None:
    """A sentence for the user if ``substeps`` steps in dt [s] are unstable at ``positions`` [m]; None if they are not.

    Unlike automatic substeps this is no bound for all configurations: what it warns of will go wrong.
    """
    step = dt / substeps
    if step <= integrator.usable_step(*rate_bounds(model)):
        return None
    limit = integrator.usable_step(*fastest_rates(model, positions, WARNING_ITERATIONS))
    if step <= limit:
        return None
    needed = f"{math.ceil(dt / limit)} substeps" if dt < 1e9 * limit else "another integrator"
    return (
        f"{integrator.name} is unstable with {substeps} substep{'s' * (substeps > 1)} per frame of {dt:.3g} s: its "
        f"largest stable step for this cloth is {limit:.3g} s, which takes {needed}; raise substeps or use 'auto'."
    )
