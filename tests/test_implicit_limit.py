"""XPBD, vertex block descent and projective dynamics all end at the solution of the implicit Euler step.

The truth is a dense Newton method in numpy, written here from the law of the design and nothing else.
"""

import numpy as np
import pytest

import warpcloth as wc
from warpcloth.integrators.blocks import SpringBlocks
from warpcloth.integrators.colouring import SpringColours
from warpcloth.integrators.sweep_tiles import TileSweep
from warpcloth.integrators.vbd import chebyshev_weights

GRAVITY = np.array([0.0, 0.0, -9.81])


class ImplicitStep:
    """m (δ − δ̂)/h² − f(x₀ + δ, δ/h) = 0 for the free particles of a model, from its initial state."""

    def __init__(self, model: wc.Model, h: float):
        self.h = h
        self.m, self.free = model.particle_mass.numpy(), model.particle_inv_mass.numpy() > 0.0
        self.p, self.q = model.spring_indices.numpy().T
        self.r, self.k_s = model.spring_rest_length.numpy(), model.spring_stiffness.numpy()
        self.k_d = model.spring_damping.numpy()
        self.begin(model.particle_q.numpy(), model.particle_qd.numpy())

    def begin(self, x: np.ndarray, v: np.ndarray) -> None:
        """Another start of the step, positions [m] and velocities [m/s]."""
        self.x0 = x
        self.inertial = np.where(self.free[:, None], self.h * v + self.h * self.h * GRAVITY, 0.0)

    def springs(self, delta: np.ndarray):
        u = delta[self.q] - delta[self.p]
        d = self.x0[self.q] - self.x0[self.p] + u
        length = np.linalg.norm(d, axis=1)
        n = d / length[:, None]
        pull = self.k_s * (length / self.r - 1.0) + self.k_d * np.sum(u * n, axis=1) / (self.r * self.h)
        return u, n, length, pull

    def residual(self, delta: np.ndarray) -> np.ndarray:
        _, n, _, pull = self.springs(delta)
        total = self.m[:, None] * (delta - self.inertial) / self.h**2
        np.subtract.at(total, self.p, pull[:, None] * n)
        np.add.at(total, self.q, pull[:, None] * n)
        return np.where(self.free[:, None], total, 0.0)

    def jacobian(self, delta: np.ndarray) -> np.ndarray:
        u, n, length, pull = self.springs(delta)
        along = np.einsum("si,sj->sij", n, n)
        across = np.eye(3) - along
        viscous = self.k_d / (self.r * self.h)
        blocks = (self.k_s / self.r + viscous)[:, None, None] * along + (pull / length)[:, None, None] * across
        turning = np.einsum("sij,sj->si", across, u) * (viscous / length)[:, None]
        blocks += np.einsum("si,sj->sij", n, turning)
        count = len(self.m)
        matrix = np.zeros((count, 3, count, 3))
        particles = np.arange(count)
        matrix[particles, :, particles, :] = self.m[:, None, None] * np.eye(3) / self.h**2
        for p, q, block in zip(self.p, self.q, blocks, strict=True):
            matrix[p, :, p, :] += block
            matrix[q, :, q, :] += block
            matrix[p, :, q, :] -= block
            matrix[q, :, p, :] -= block
        return matrix.reshape(3 * count, 3 * count)

    def solve(self) -> np.ndarray:
        """Newton's method with halved steps where the residual would grow."""
        delta, unknown = self.inertial.copy(), np.repeat(self.free, 3)
        for _ in range(50):
            residual = self.residual(delta)
            step = np.zeros(unknown.shape)
            step[unknown] = np.linalg.solve(self.jacobian(delta)[np.ix_(unknown, unknown)], -residual.ravel()[unknown])
            share = 1.0
            while share > 1e-6 and np.linalg.norm(self.residual(delta + share * step.reshape(-1, 3))) > np.linalg.norm(
                residual
            ):
                share *= 0.5
            delta = delta + share * step.reshape(-1, 3)
            if np.abs(step).max() < 1e-15:
                break
        return delta


@pytest.fixture(scope="module")
def crumpled() -> wc.Model:
    """A stretched, crumpled, moving cloth, a long step away from equilibrium."""
    model = wc.Model.build(wc.Cloth.grid(size=(0.3, 0.3), resolution=(8, 8), pins="left"), precision="float64")
    rng = np.random.default_rng(0)
    free = model.particle_inv_mass.numpy() > 0.0
    q, qd = model.particle_q.numpy().copy(), model.particle_qd.numpy().copy()
    q[free] = 1.05 * q[free] + 0.004 * rng.normal(size=(free.sum(), 3))
    qd[free] = 0.3 * rng.normal(size=(free.sum(), 3))
    model.particle_q.assign(q)
    model.particle_qd.assign(qd)
    return model


STEP = 1.0 / 240.0


@pytest.fixture(scope="module")
def newton(crumpled) -> np.ndarray:
    problem = ImplicitStep(crumpled, STEP)
    delta = problem.solve()
    assert np.abs(problem.residual(delta)).max() < 1e-12 * np.abs(problem.residual(problem.inertial)).max()
    slope = problem.jacobian(delta)
    direction = np.random.default_rng(1).normal(size=delta.shape)
    difference = problem.residual(delta + 1e-7 * direction) - problem.residual(delta - 1e-7 * direction)
    expected = np.where(problem.free[:, None], (slope @ direction.ravel()).reshape(-1, 3), 0.0)
    assert np.abs(difference / 2e-7 - expected).max() < 1e-5 * np.abs(expected).max()
    return delta


def error(model: wc.Model, newton: np.ndarray, name: str, options: dict) -> float:
    """Largest error after one step, relative to the largest displacement."""
    sim = wc.Simulation(model, name, GRAVITY, substeps=1, integrator_options=options, graph=False)
    start = sim.state.particle_q.numpy().copy()
    sim.step(STEP)
    return float(np.abs(sim.state.particle_q.numpy() - start - newton).max() / np.abs(newton).max())


@pytest.mark.parametrize(
    ("name", "options", "sweeps"),
    [
        ("xpbd", {}, (30, 100, 170)),
        ("vbd", {}, (50, 170, 290)),
        ("vbd", {"acceleration": 0.8}, (20, 80, 140)),
        ("projective_dynamics", {"solver": "jacobi"}, (50, 350, 650)),
        ("projective_dynamics", {"solver": "cg"}, (50, 300, 550)),
    ],
)
def test_errors_fall_geometrically(crumpled, newton, name, options, sweeps):
    """Equal numbers of further sweeps divide the error by equal factors: a straight line in a semi-log plot."""
    errors = [error(crumpled, newton, name, {**options, "iterations": k}) for k in sweeps]
    gains = [errors[0] / errors[1], errors[1] / errors[2]]
    assert errors[0] < 0.2
    assert min(gains) > 8.0
    assert np.log(gains[1]) == pytest.approx(np.log(gains[0]), rel=0.5)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("xpbd", {"iterations": 500}),
        ("vbd", {"iterations": 300, "acceleration": 0.95}),
        ("projective_dynamics", {"iterations": 500}),
        ("implicit_euler", {"tolerance": 1e-12}),
    ],
)
def test_all_end_at_newtons_solution(crumpled, newton, name, options):
    assert error(crumpled, newton, name, options) < 1e-11


def test_accelerated_sweeps_extrapolate_from_the_last_but_one(crumpled):
    """x ← ω (x̂ − x″) + x″ with ω = 1, 2/(2 − ρ²), 4/(4 − ρ² ω)…: each sweep from plain ones, the rest in numpy."""
    radius, count = 0.8, 5
    options = {"acceleration": radius, "iterations": count}
    sim = wc.Simulation(crumpled, "vbd", GRAVITY, substeps=1, integrator_options=options, graph=False)
    plain = wc.Simulation(crumpled, "vbd", GRAVITY, substeps=1, integrator_options={"iterations": 1}, graph=False)
    start = sim.state.particle_q.numpy().copy()
    sim.step(STEP)
    sweeper, weights = plain.integrator, [1.0, 2.0 / (2.0 - radius**2)]
    sweeper.prepare()
    sweeper.inertial.assign(sim.integrator.inertial)
    iterates = [sim.integrator.inertial.numpy()]
    for k in range(count):
        sweeper.displacement.assign(iterates[-1])
        sweeper._sweep(crumpled, plain.state, STEP)
        swept, before = sweeper.displacement.numpy(), iterates[max(k - 1, 0)]
        iterates.append(weights[k] * (swept - before) + before)
        weights.append(4.0 / (4.0 - radius**2 * weights[-1]))
    moved = sim.state.particle_q.numpy() - start
    assert np.abs(iterates[-1] - iterates[-2]).max() > 1e-3 * np.abs(moved).max()
    assert np.abs(moved - iterates[-1]).max() < 1e-12


def test_later_iterations_of_projective_dynamics_have_chebyshevs_weights(crumpled):
    """The first third is plain; the others assume Gershgorin's radius, or 1/cosh(2/n) for n of them if that is less."""
    plain, count = 2, 6
    sim = wc.Simulation(
        crumpled, "projective_dynamics", GRAVITY, substeps=1, integrator_options={"iterations": count}, graph=False
    )
    sim.step(STEP)
    problem = ImplicitStep(crumpled, STEP)
    pull = (problem.k_s + problem.k_d / STEP) / problem.r
    stiffness = sum(np.bincount(ends, pull, len(problem.m)) for ends in (problem.p, problem.q))[:, None]
    inertia = problem.m[:, None] / STEP**2
    gershgorin = (stiffness / (inertia + stiffness))[problem.free].max()
    radius = min(gershgorin, 1.0 / np.cosh(2.0 / (count - plain)))
    weights = [*[1.0] * plain, *chebyshev_weights(radius, count - plain)]
    iterates = [problem.inertial]
    for k, weight in enumerate(weights):
        before, now = iterates[max(k - 1, 0)], iterates[-1]
        iterates.append(weight * (now - problem.residual(now) / (inertia + stiffness) - before) + before)
    moved = sim.state.particle_q.numpy() - problem.x0
    assert np.abs(iterates[-1] - iterates[-2]).max() > 1e-3 * np.abs(moved).max()
    assert np.abs(moved - iterates[-1]).max() < 1e-12


def test_chebyshev_beats_plain_iterations(crumpled, newton):
    plain, fast = (
        error(crumpled, newton, "projective_dynamics", {"solver": solver, "iterations": 60})
        for solver in ("jacobi", "chebyshev")
    )
    assert fast < 0.1 * plain


def ring(**options) -> wc.Model:
    """Springs of any order and length in a ring, damped, with no two alike."""
    rng, count = np.random.default_rng(3), 12
    angle = 2.0 * np.pi * np.arange(count) / count
    x = 0.2 * np.stack([np.cos(angle), np.sin(angle), 0.1 * rng.normal(size=count)], axis=1)
    springs = rng.permutation([(i, (i + k) % count) for k in (1, 2, 5) for i in range(count)])
    rest = np.linalg.norm(x[springs[:, 1]] - x[springs[:, 0]], axis=1) * rng.uniform(0.85, 1.0, len(springs))
    k_s, masses, v = rng.uniform(2.0, 20.0, len(springs)), rng.uniform(0.01, 0.03, count), rng.normal(size=(count, 3))
    options |= {"pinned": [0], "velocities": 0.3 * v, "precision": "float64"}
    return wc.Model.from_springs(x, masses, springs, rest, k_s, 0.01 * k_s, **options)


@pytest.mark.parametrize(
    ("build", "name", "options", "kernel"),
    [
        (lambda: None, "xpbd", {"iterations": 500}, TileSweep),
        (lambda: None, "xpbd", {"iterations": 500, "rows": False}, TileSweep),
        (ring, "xpbd", {"iterations": 300, "rows": False}, SpringBlocks),
        (lambda: ring(differentiable=True), "xpbd", {"iterations": 300}, SpringColours),
        (ring, "vbd", {"iterations": 300}, None),
        (ring, "projective_dynamics", {"iterations": 800}, None),
        (ring, "projective_dynamics", {"iterations": 150, "solver": "cg"}, None),
    ],
)
def test_steps_that_begin_with_former_forces_end_there_too(crumpled, build, name, options, kernel):
    """Whatever share of them, and with damping: each step is solved from where the one before has ended."""
    model = build() or crumpled
    options = {**options, "warm_start": 0.6}
    sim = wc.Simulation(model, name, GRAVITY, substeps=1, integrator_options=options, graph=False)
    if kernel is not None:
        sweep = sim.integrator.sweeps[0]
        assert isinstance(sweep, kernel) or isinstance(sweep.order, kernel)
    problem = ImplicitStep(model, STEP)
    for _ in range(3):
        start = sim.state.particle_q.numpy().copy()
        problem.begin(start, sim.state.particle_qd.numpy().copy())
        exact = problem.solve()
        sim.step(STEP)
        assert np.abs(sim.state.particle_q.numpy() - start - exact).max() < 1e-11 * np.abs(exact).max()


def test_no_more_is_asked_of_newton_than_positions_can_hold():
    """A kilometre away single precision knows places to 0.06 mm, and velocities to that in a step: 0.015 m/s."""
    cloth = wc.Cloth.grid((0.5, 0.5), (6, 6), pins="top", transform=(1000.0, 0.0, 0.0))
    sim = wc.Simulation(wc.Model.build(cloth), "implicit_euler", GRAVITY, substeps=1, contact="none")
    for _ in range(5):
        sim.step(1.0 / 240.0)
    metrics = sim.integrator.metrics()
    assert metrics["unconverged_steps"] == 0
    assert metrics["newton_iterations_total"] < 100
