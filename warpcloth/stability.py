"""How large a step may be: the fastest frequency of a spring network, and the steps that follow from it.

A network near equilibrium moves as M x″ + C x′ + K x = 0. Its fastest frequency is ω² = λ_max(M⁻¹K), its strongest
damping γ = λ_max(M⁻¹C). Both are found by power iteration on the host, once per model.

K depends on where the springs point. But every spring obeys K_e ⪯ (k_s/r) I whatever its direction and tension, so the
network in which all springs act in all directions (the weighted graph Laplacian) bounds every configuration: that is
what automatic substeps use, and why they hold when cloth crumples. On square grids it costs about a quarter more
substeps than the flat rest pose would need.

Bending of cloth that is flat at rest acts in all directions by itself, with the same K in every configuration. Where
the rest shape is curved, and for hysteresis, what depends on how the surface's tangents turn is left out: it is small
where the mesh resolves the curvature. Its step falls with the square of the cells, and with damping the fourth power;
schemes that solve for springs alone smooth it instead (``kernels/bending_filter.py``). Pressure and air, which depend
on more than the network, are looked at where the simulation begins (``load_rates.py``).
"""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .errors import SimulationError
from .load_rates import breathing_modes, load_rates, present_rates

if TYPE_CHECKING:
    from .air import Air
    from .integrators import Integrator
    from .model import Model

MAX_SUBSTEPS = 100_000  # per frame, automatic or not
MAX_ITERATIONS = 300
TOLERANCE = 1e-5
# Cloth crushed through zero spring length, where the force jumps, gains energy when it steps at the linear limit:
# without damping a network with random jolts of one cell doubled its energy many times over in 80 frames at 0.95 of the
# limit, and kept it within 15 % at a quarter of it. With the default damping 0.7 is enough.
SAFETY = 0.7
EARTH = 10.0  # [m/s²], more than its gravity
WARNING_ITERATIONS = 60  # within about 1 % of the step
YARNS = np.array([[1.0, 0.0], [0.0, 1.0], [np.sqrt(0.5), np.sqrt(0.5)], [np.sqrt(0.5), -np.sqrt(0.5)]])

Strengths = tuple[np.ndarray, np.ndarray, np.ndarray]


class Pace(NamedTuple):
    """The largest step [s] that is stable and no larger than a scheme advises, and how many times as many steps than on
    earth gravity asks for, as all times that it makes go with 1/√g; at least 1."""

    step: float
    haste: float


class _Bending:
    """Bending elements as they resist in every direction, on the host."""

    def __init__(self, model: "Model"):
        elements = model.bending
        start = elements.start.numpy()
        self.element = np.repeat(np.arange(model.bend_count), np.diff(start))
        self.particle, self.weight = elements.particle.numpy(), elements.weight.numpy().astype(np.float64)
        self.stiffness = elements.law.numpy()[:, 0] + elements.friction.numpy()[:, 0].astype(np.float64)
        self.damping = elements.law.numpy()[:, 1].astype(np.float64)

    def apply(self, strength: np.ndarray, x: np.ndarray) -> np.ndarray:
        """K x of elements of ``strength`` [N m³ or N m³ s]."""
        columns = []
        for column in x.T:
            d = np.bincount(self.element, self.weight * column[self.particle], len(strength))
            columns.append(np.bincount(self.particle, self.weight * (strength * d)[self.element], len(x)))
        return np.stack(columns, axis=1)

    def row_sums(self, strength: np.ndarray, count: int) -> np.ndarray:
        """No less than the sum of |K_ij| over each row."""
        size = np.abs(self.weight)
        total = strength * np.bincount(self.element, size, len(strength))
        return np.bincount(self.particle, size * total[self.element], count)


class _Woven:
    """Springs along the yarns of woven triangles on the host: four weighted sums of three corners in each.

    Args:
        model: the model.
        positions: the configuration [m]; None: yarns act in all directions.
    """

    def __init__(self, model: "Model", positions: np.ndarray | None):
        woven = model.woven
        self.corners = woven.corners.numpy().reshape(-1, 3)
        later = np.stack([woven.along.numpy(), woven.across.numpy()], axis=1).astype(np.float64)
        slopes = np.concatenate([-later.sum(axis=2, keepdims=True), later], axis=2)  # of warp and weft, by corner
        self.weights = np.einsum("ya,mac->myc", YARNS, slopes)
        self.stiffness = woven.stiffness.numpy()[:, [0, 1, 2, 2]].astype(np.float64)
        self.damping = self.stiffness * woven.law.numpy()[:, :1]
        self.stiffness[:, :2] *= 1.0 + woven.law.numpy()[:, 2:]
        self.directions = None
        if positions is not None:
            self.directions = _unit(np.einsum("myc,mcx->myx", self.weights, positions[self.corners]))

    def apply(self, strength: np.ndarray, x: np.ndarray) -> np.ndarray:
        """K x of yarns of ``strength`` [J or J s], shape [m, 4]."""
        d = np.einsum("myc,mcx->myx", self.weights, x[self.corners])
        if self.directions is not None:
            d = self.directions * np.sum(self.directions * d, axis=2, keepdims=True)
        f = np.einsum("my,myc,myx->mcx", strength, self.weights, d).reshape(-1, x.shape[1])
        return np.stack([np.bincount(self.corners.ravel(), column, len(x)) for column in f.T], axis=1)

    def row_sums(self, strength: np.ndarray, count: int) -> np.ndarray:
        """No less than the sum of |K_ij| over each row."""
        size = np.abs(self.weights)
        rows = np.einsum("my,myc->mc", strength * size.sum(axis=2), size)
        return np.bincount(self.corners.ravel(), rows.ravel(), count)


class _Network:
    """Host copy of what the eigenvalue problems need; strengths are those of springs, bending elements and yarns."""

    def __init__(self, model: "Model", positions: np.ndarray | None, without: Sequence[str] = ()):
        ends = model.spring_indices.numpy()
        self.p, self.q = ends[:, 0], ends[:, 1]
        self.inverse_mass = model.particle_inv_mass.numpy().astype(np.float64)
        self.bending, self.woven = _Bending(model), _Woven(model, positions)
        bends = float("bending" not in without)
        per_length = float("springs" not in without) / model.spring_rest_length.numpy().astype(np.float64)
        limited = model.spring_stiffness.numpy() + model.spring_limit_stiffness.numpy()
        yarns = float("woven" not in without)
        self.stiffness: Strengths = (limited * per_length, bends * self.bending.stiffness, yarns * self.woven.stiffness)
        damping = model.spring_damping.numpy() * per_length
        self.damping: Strengths = (damping, bends * self.bending.damping, yarns * self.woven.damping)
        self.directions = None if positions is None else _unit(positions[self.q] - positions[self.p])

    def apply(self, strength: Strengths, x: np.ndarray) -> np.ndarray:
        """M^(−1/2) K M^(−1/2) x; springs [N/m or N s/m], elements [N m³ or N m³ s] and yarns [J or J s] so strong."""
        y = x * np.sqrt(self.inverse_mass)[:, None]
        d = y[self.q] - y[self.p]
        if self.directions is not None:
            d = self.directions * np.sum(self.directions * d, axis=1, keepdims=True)
        f = strength[0][:, None] * d
        n = len(x)
        total = np.stack([np.bincount(self.q, c, n) - np.bincount(self.p, c, n) for c in f.T], axis=1)
        if len(strength[1]) > 0:
            total = total + self.bending.apply(strength[1], y)
        if len(strength[2]) > 0:
            total = total + self.woven.apply(strength[2], y)
        return total * np.sqrt(self.inverse_mass)[:, None]

    def bound(self, strength: Strengths) -> float:
        """No less than the largest eigenvalue, by Gershgorin's theorem."""
        n = len(self.inverse_mass)
        total = 2.0 * np.bincount(np.concatenate([self.p, self.q]), np.tile(strength[0], 2), n)
        total = total + self.bending.row_sums(strength[1], n) + self.woven.row_sums(strength[2], n)
        return float(np.max(total * self.inverse_mass, initial=0.0))

    def largest_eigenvalue(self, strength: Strengths, iterations: int = MAX_ITERATIONS) -> float:
        """By power iteration; 0 for a network without free ends."""
        width = 1 if self.directions is None else 3
        x = np.random.default_rng(0).standard_normal((len(self.inverse_mass), width))
        x[self.inverse_mass == 0.0] = 0.0
        value = 0.0
        for _ in range(iterations):
            norm = np.linalg.norm(x)
            if norm == 0.0:
                return 0.0
            x = self.apply(strength, x / norm)
            previous, value = value, float(np.linalg.norm(x))
            if abs(value - previous) <= TOLERANCE * value:
                break
        return value


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0))


def rate_bounds(model: "Model", *, without: Sequence[str] = ()) -> tuple[float, float]:
    """Upper bounds of ω [1/s] and γ [1/s] in any configuration, at the cost of one sum; ``without`` as below."""
    network = _Network(model, None, without)
    return math.sqrt(network.bound(network.stiffness)), network.bound(network.damping)


def bending_rates(model: "Model") -> np.ndarray:
    """Upper bounds of ω² [1/s²] and γ [1/s] by bending alone, in any configuration, shape [world_count, 2]."""
    bending, count = _Bending(model), model.particle_count
    rows = [bending.row_sums(strength, count) for strength in (bending.stiffness, bending.damping)]
    per_mass = np.stack(rows, axis=1) * model.particle_inv_mass.numpy().astype(np.float64)[:, None]
    first = np.searchsorted(model.particle_world.numpy(), np.arange(model.world_count))
    return np.asarray(np.maximum.reduceat(per_mass, first))


def fastest_rates(
    model: "Model",
    positions: np.ndarray | None = None,
    iterations: int = MAX_ITERATIONS,
    *,
    without: Sequence[str] = (),
) -> tuple[float, float]:
    """ω [1/s] and γ [1/s] of the stiffest undamped mode and of the most damped one.

    Args:
        model: whose springs, bending elements, woven triangles and masses.
        positions: the configuration, shape [particle_count, 3] [m]; None bounds all configurations.
        iterations: most steps of the power iteration, which approaches the eigenvalues from below.
        without: names of the force terms to leave out, "springs", "woven" or "bending".
    """
    network = _Network(model, positions, without)
    fastest = network.largest_eigenvalue(network.stiffness, iterations)
    return math.sqrt(fastest), network.largest_eigenvalue(network.damping, iterations)


def _usable_step(
    model: "Model",
    integrator: "Integrator",
    rates: Callable[..., tuple[float, float]],
    *arguments: Any,
    loads: tuple[float, float] = (0.0, 0.0),
) -> float:
    """Largest step [s] by ``rates``, for all forces and for those that the scheme does not solve for; ``loads`` as
    :func:`~warpcloth.load_rates.load_rates` has them."""

    def loaded(omega: float, gamma: float) -> tuple[float, float]:
        return math.sqrt(omega * omega + loads[0]), gamma + loads[1]

    step = integrator.usable_step(*loaded(*rates(model, *arguments)))
    if model.bend_count > 0 or model.woven_count > 0 or any(loads):
        without = (*integrator.solved_forces, *integrator.filtered_forces)
        step = min(step, integrator.explicit_step(*loaded(*rates(model, *arguments, without=without))))
    return step


def largest_stable_step(model: "Model", integrator: "Integrator", airs: "Sequence[Air]" = ()) -> float:
    """Largest step [s] that ``integrator`` can safely take in any configuration; infinite if it has no limit.

    Of pressure and of the air, one for each world, about the initial pose and speeds (``load_rates.py``).
    """
    step, loads = integrator.filtered_step(), load_rates(model, airs)
    if not math.isinf(_usable_step(model, integrator, rate_bounds, loads=loads)):
        step = min(
            step, _usable_step(model, integrator, fastest_rates, loads=loads), _breathing_step(model, integrator)
        )
    return SAFETY * step


def _breathing_step(model: "Model", integrator: "Integrator") -> float:
    """Largest step [s] for how gases breathe: as fast as the fastest modes, but damped far less, as cloth that widens
    evenly is hardly deformed. Schemes that ask of each mode whether it is damped enough must know both."""
    modes = breathing_modes(model)
    if not modes:
        return math.inf
    network, step = _Network(model, model.particle_q.numpy().astype(np.float64)), math.inf
    for rate, mode in modes:
        stiffness, damping = (
            float(np.sum(mode * network.apply(strength, mode)) / np.sum(mode * mode))
            for strength in (network.stiffness, network.damping)
        )
        step = min(step, integrator.usable_step(math.sqrt(rate + stiffness), damping))
    return step


def pace(model: "Model", integrator: "Integrator", airs: "Sequence[Air]", gravity: Any) -> Pace:
    """The pace of a simulation.

    Args:
        model, integrator, airs: what is simulated, how, and in the air of each world.
        gravity: of all worlds or of each [m/s²], shape [3] or [world_count, 3].
    """
    strongest = float(np.linalg.norm(np.asarray(gravity, np.float64), axis=-1).max())
    haste = max(1.0, math.sqrt(strongest / EARTH))
    return Pace(min(largest_stable_step(model, integrator, airs), integrator.advised_step() / haste), haste)


def count_steps(integrator: "Integrator", step: float, dt: float, most: int) -> int:
    """Fewest equal steps, no longer than ``step`` [s], that make up dt [s].

    Raises:
        SimulationError: more than ``most`` would be needed.
    """
    if dt > most * step:
        raise SimulationError(
            f"{integrator.name} would need more than {most} substeps per frame of {dt:g} s to be stable; use a softer "
            "or heavier fabric, a shorter damping time (or some, where there is none), a coarser mesh, or an implicit "
            "integrator."
        )
    return max(1, math.ceil(dt / step))


def warning_of_unstable_steps(
    model: "Model",
    integrator: "Integrator",
    positions: np.ndarray,
    velocities: np.ndarray,
    dt: float,
    substeps: int,
    airs: "Sequence[Air]" = (),
) -> str | None:
    """A sentence for the user if ``substeps`` steps in dt [s] are unstable at ``positions`` [m] and ``velocities``
    [m/s], in the air of each world; None if they are not.

    Unlike automatic substeps this is no bound for all configurations: what it warns of will go wrong.
    """
    step = dt / substeps
    filtered = min(integrator.filtered_step(), _loaded_step(model, integrator, positions, velocities, airs))
    if step <= min(filtered, _usable_step(model, integrator, rate_bounds)):
        return None
    limit = min(filtered, _usable_step(model, integrator, fastest_rates, positions, WARNING_ITERATIONS))
    if step <= limit:
        return None
    advice = f"takes {math.ceil(dt / limit)} substeps; raise substeps or use 'auto'"
    if dt > MAX_SUBSTEPS * limit:
        advice = "no substeps allow for; use another integrator, or a softer or heavier material"
    return (
        f"{integrator.name} is unstable with {substeps} substep{'s' * (substeps > 1)} per frame of {dt:.3g} s: its "
        f"largest stable step here is {limit:.3g} s, which {advice}."
    )


def _loaded_step(
    model: "Model", integrator: "Integrator", positions: np.ndarray, velocities: np.ndarray, airs: "Sequence[Air]"
) -> float:
    """Largest step [s] by gases, damped as the network is, or not, and by the air, alone: what each of them needs."""
    breathing, slowing = present_rates(model, airs, positions, velocities)
    step = math.inf
    for rule in (integrator.usable_step, integrator.explicit_step):
        if breathing > 0.0:
            damping = rate_bounds(model)[1]
            step = min(step, max(rule(math.sqrt(breathing), gamma) for gamma in (0.0, damping)))
        if slowing > 0.0:
            step = min(step, rule(0.0, slowing))
    return step
