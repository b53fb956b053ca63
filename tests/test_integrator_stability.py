"""Limits of the step, growth and shadow energies: what theory says of each scheme on the oscillator and on a grid."""

import math

import numpy as np
import pytest
from integrator_problems import ALL, oscillator, phase, simulation

import warpcloth as wc
from warpcloth.errors import SimulationError, StabilityWarning
from warpcloth.integrators import INTEGRATORS
from warpcloth.stability import fastest_rates, largest_stable_step

FIXED_STEP = [cls.name for cls in ALL if not cls.adaptive]
DAMPING = (0.0, 0.05, 0.5, 1.5)  # ζ


def step_matrix(name: str, h: float, zeta: float = 0.0) -> np.ndarray:
    """What one step of h does to (x, v) of the oscillator with ω = 1, measured."""
    columns = []
    size = 0.25 if INTEGRATORS[name].implicit else 0.01  # [m], so small that no stage comes near zero length
    for x, v in ((size, 0.0), (0.0, size)):
        sim = simulation(oscillator(1.0, zeta, x, v), name, contact="none", check=False, graph=False)
        later = sim.state.twin()
        sim.integrator.step(sim.model, sim.state, later, sim.forces, h)
        end = np.array([later.particle_q.numpy()[1, 0] - 1.0, later.particle_qd.numpy()[1, 0]])
        columns.append(end / size)
    return np.array(columns).T


def spectral_radius(matrix: np.ndarray) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max())


@pytest.mark.parametrize("zeta", DAMPING)
@pytest.mark.parametrize("name", FIXED_STEP)
def test_limit_of_the_oscillator(name, zeta):
    limit = INTEGRATORS[name].stable_step(1.0, 2.0 * zeta)
    if math.isinf(limit):
        assert INTEGRATORS[name].implicit
        return
    if limit == 0.0:
        assert spectral_radius(step_matrix(name, 0.1, zeta)) > 1.0 + 1e-6
        return
    assert spectral_radius(step_matrix(name, 0.99 * limit, zeta)) <= 1.0 + 1e-9
    assert spectral_radius(step_matrix(name, 1.01 * limit, zeta)) > 1.0 + 1e-5


@pytest.mark.parametrize(
    ("name", "zeta", "limit"),
    [
        ("forward_euler", 0.05, 0.1), ("forward_euler", 0.5, 1.0), ("forward_euler", 0.0, 0.0),
        ("symplectic_euler", 0.0, 2.0), ("symplectic_euler", 0.3, 2.0 * (math.sqrt(1.09) - 0.3)),
        ("velocity_verlet", 0.0, 2.0), ("midpoint", 0.0, 0.0), ("trapezoidal", 0.0, 0.0),
        ("midpoint", 0.05, 0.8), ("trapezoidal", 0.05, 0.8), ("rk4", 0.0, 2.0 * math.sqrt(2.0)),
    ],
)  # fmt: skip
def test_limits_of_theory(name, zeta, limit):
    assert INTEGRATORS[name].stable_step(10.0, 20.0 * zeta) == pytest.approx(0.1 * limit, rel=1e-3, abs=1e-15)


@pytest.mark.parametrize("name", [n for n in FIXED_STEP if 0.0 < INTEGRATORS[n].stable_step(1.0, 0.0) < math.inf])
def test_limit_of_a_network(name):
    fabric = wc.Fabric(damping_time=0.0)
    model = wc.Model.build(wc.Cloth.grid((0.5, 0.5), (6, 6), fabric), precision="float64")
    rest = model.particle_q.numpy()
    model.particle_q.assign(rest + 1e-9 * np.random.default_rng(1).standard_normal(rest.shape))
    limit = INTEGRATORS[name].stable_step(*fastest_rates(model, rest))
    growth = {}
    for share in (0.99, 1.01):
        sim = simulation(model, name, substeps=1000, check=False)
        if share > 1.0:
            with pytest.warns(StabilityWarning, match=r"which takes 10[0-9]{2} substeps"):
                sim.step(1000 * share * limit)
        else:
            sim.step(1000 * share * limit)
        growth[share] = np.abs(phase(sim)[0] - rest).max() / 1e-9
    assert growth[0.99] < 1e3
    assert not growth[1.01] < 1e6


@pytest.mark.parametrize("name", ["forward_euler", "midpoint", "rk4"])
def test_automatic_substeps_bound_growth(name):
    """Undamped, these have no stable step or a small one: energy may grow by a few tenths per second, not more."""
    sim = simulation(oscillator(20.0, 0.0, 0.1), name, substeps="auto")
    before = sim.energy()["total"]
    sim.run(10, fps=10)
    assert sim.energy()["total"] < math.exp(0.2) * before
    with pytest.raises(SimulationError, match="would need more than 100000 substeps"):
        simulation(oscillator(1e6), "forward_euler", substeps="auto").step(1.0)


def test_what_is_proposed_where_damping_asks_for_too_many_substeps():
    """The shorter its time the longer are the steps, unless there is none: more damping would be bad advice."""
    steps = []
    for time in (1e-3, 1e-4, 1e-5):
        cloth = wc.Cloth.grid((0.02, 0.02), (6, 6), wc.Fabric(stretch_stiffness=1e4, damping_time=time), "left")
        model = wc.Model.build(cloth, device="cpu")
        steps.append(largest_stable_step(model, INTEGRATORS["velocity_verlet"](model)))
    assert steps[0] < 0.5 * steps[1] < 0.5 * steps[2]
    stiff = wc.Cloth.grid((0.02, 0.02), (6, 6), wc.Fabric(stretch_stiffness=1e4, damping_time=5e-3), "left")
    with pytest.raises(SimulationError, match="a shorter damping time"):
        wc.Simulation(wc.Model.build(stiff, device="cpu"), "velocity_verlet").step(1.0 / 60.0)


@pytest.mark.parametrize("name", [n for n in FIXED_STEP if not INTEGRATORS[n].implicit])
def test_usable_steps_hold_for_modes_of_less_damping(name):
    for zeta in (0.2, 0.5, 2.0):
        h = 0.99 * INTEGRATORS[name].usable_step(1.0, 2.0 * zeta)
        for s in (0.1, 0.3, 0.6, 1.0):  # frequency s, damping in proportion to stiffness
            assert spectral_radius(step_matrix(name, s * h, s * zeta)) <= math.exp(0.1 * h) + 1e-9


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("forward_euler", lambda t: 1.0 + t**2),
        ("midpoint", lambda t: 1.0 + t**4 / 4.0),
        ("trapezoidal", lambda t: 1.0 + t**4 / 4.0),
        ("rk4", lambda t: 1.0 - t**6 / 72.0 + t**8 / 576.0),
        ("implicit_euler", lambda t: 1.0 / (1.0 + t**2)),
        ("linear_implicit_euler", lambda t: 1.0 / (1.0 + t**2)),
        ("implicit_midpoint", lambda t: 1.0),
        ("implicit_trapezoid", lambda t: 1.0),
    ],
)
def test_energy_per_step(name, factor):
    """With ω = 1 energy is |(x, v)|²/2, and a step turns (x, v) by some angle and scales it."""
    for theta in (0.1, 0.5, 1.0):
        m = step_matrix(name, theta)
        np.testing.assert_allclose(m.T @ m, factor(theta) * np.eye(2), atol=1e-9)


def test_bdf2_loses_energy():
    """θ⁴/2 per step, over ten turns after ten more that forget the first step, which is of lower order."""
    steps = 60
    sim = simulation(oscillator(1.0, 0.0, 0.25), "bdf2", substeps=10 * steps)
    energies = []
    for _ in range(2):
        sim.step(20.0 * math.pi)
        energies.append(sim.energy()["total"])
    loss = 1.0 - (energies[1] / energies[0]) ** (0.1 / steps)
    assert loss == pytest.approx((2.0 * math.pi / steps) ** 4 / 2.0, rel=0.1)


@pytest.mark.parametrize(
    ("name", "shadow"),
    [
        ("symplectic_euler", lambda x, v, h: 0.5 * v * v + 0.5 * x * x - 0.5 * h * x * v),
        ("velocity_verlet", lambda x, v, h: 0.5 * v * v + 0.5 * x * x * (1.0 - h * h / 4.0)),
    ],
)
def test_shadow_energy(name, shadow):
    h = 0.3
    sim = simulation(oscillator(1.0, 0.0, 0.3, 0.1), name)
    energies = []
    for _ in range(500):
        energies.append(shadow(sim.state.particle_q.numpy()[1, 0] - 1.0, sim.state.particle_qd.numpy()[1, 0], h))
        sim.step(h)
    assert np.ptp(energies) < 1e-13
    assert energies[0] > 0.01


@pytest.mark.parametrize("name", [n for n in FIXED_STEP if INTEGRATORS[n].symplectic])
def test_symplectic_schemes_keep_area(name):
    limit = min(INTEGRATORS[name].stable_step(1.0, 0.0), 4.0)
    for h in (0.2 * limit, 0.9 * limit):
        assert np.linalg.det(step_matrix(name, h)) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("name", [n for n in FIXED_STEP if hasattr(INTEGRATORS[n], "propagator")])
def test_steps_are_what_their_propagator_says(name):
    for zeta in (0.0, 0.3):
        matrix = np.array([[p(0.7) for p in row] for row in INTEGRATORS[name].propagator(1.0, 2.0 * zeta)])
        np.testing.assert_allclose(step_matrix(name, 0.7, zeta), matrix, atol=1e-12)


def test_a_warning_gives_no_advice_that_is_refused():
    """With masses of 1e-20 kg "auto" says that there would be too many substeps, and more may not be given."""
    light = wc.Model.from_springs([(0, 0, 0), (0, 0, 0.1)], [1e-20] * 2, [(0, 1)], [0.1], [1.0], [0.0])
    sim = wc.Simulation(light, "symplectic_euler", substeps=8, check=False)
    with pytest.warns(StabilityWarning, match="which no substeps allow for; use another integrator") as said:
        sim.step(1.0 / 60.0)
    assert "auto" not in str(said[0].message)
