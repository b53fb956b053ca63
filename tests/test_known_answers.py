"""Problems with exact answers, met by symplectic Euler with the error that its order predicts."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import warpcloth as wc


def error_order(errors: list[float]) -> float:
    """Observed order from errors at steps halved each time, by the last pair."""
    return math.log2(errors[-2] / errors[-1])


def damped_spring(substeps: int) -> tuple[float, float]:
    model = wc.Model.from_springs(
        [[0, 0, 0], [0.30, 0, 0]], [1.0, 0.05], [[0, 1]], 0.25, 20.0, 0.05, [0], precision="float64"
    )
    sim = wc.Simulation(model, gravity=(9.81, 0, 0), substeps=substeps)
    sim.step(0.6)
    return sim.state.particle_q.numpy()[1, 0], sim.state.particle_qd.numpy()[1, 0]


def test_damped_spring_at_first_order():
    exact = np.array([0.260767102762, 0.485737506])
    errors = [np.array(damped_spring(n)) - exact for n in (2000, 4000, 8000)]
    assert error_order([abs(e[0]) for e in errors]) == pytest.approx(1.0, abs=0.05)
    assert error_order([abs(e[1]) for e in errors]) == pytest.approx(1.0, abs=0.05)
    extrapolated = 2.0 * errors[2] - errors[1]  # what is left is of second order in the step
    assert np.abs(extrapolated).max() < 1e-4 * np.abs(exact).max()


def hanging_chain(count: int) -> float:
    """Sag [m] of the chain of section 3 with ``count`` springs, by heavily damped motion to rest."""
    mass, k_s, span = 0.1, 50.0, 0.8
    rest = 1.0 / count
    x = np.zeros((count + 1, 3))
    x[:, 0] = np.linspace(0.0, span, count + 1)
    x[:, 2] = -0.27 * np.sin(np.pi * x[:, 0] / span)
    masses = np.full(count + 1, mass / count)
    springs = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    model = wc.Model.from_springs(x, masses, springs, rest, k_s, 0.02 * count * rest, [0, count], precision="float64")
    sim = wc.Simulation(model, gravity=(0, 0, -9.81))
    settle(sim, 2400)
    return -sim.state.particle_q.numpy()[:, 2].min()


def settle(sim: wc.Simulation, frames: int) -> None:
    """Kinetic damping: whenever kinetic energy falls, all velocities are set to zero (Barnes 1999)."""
    previous = 0.0
    for _ in range(frames):
        sim.step(1.0 / 240.0)
        kinetic = sim.energy()["kinetic"]
        if kinetic < previous:
            sim.state.particle_qd.zero_()
            kinetic = 0.0
            if previous < 1e-14:
                return
        previous = kinetic


def exact_sag() -> float:
    """Extensible catenary (Irvine 1981): horizontal tension from the span, then the sag."""
    length, weight, k_s, span = 1.0, 0.1 * 9.81, 50.0, 0.8

    def x_end(h):
        return h * length / k_s + 2.0 * h * length / weight * math.asinh(weight / (2.0 * h))

    h = brentq(lambda h: x_end(h) - span, 1e-3, 10.0)
    return quad(lambda s: (weight * s / length) * (1.0 / k_s + 1.0 / math.hypot(h, weight * s / length)), 0.0, 0.5)[0]


def test_hanging_chain_converges_to_the_catenary_at_second_order():
    sag = exact_sag()
    assert sag == pytest.approx(0.271858992, abs=1e-8)
    errors = [abs(hanging_chain(n) / sag - 1.0) for n in (10, 20, 40)]
    assert errors == pytest.approx([5.3e-3, 1.3e-3, 3.3e-4], rel=0.1)


def test_vertical_hang():
    count, mass, k_s = 16, 0.1, 50.0
    x = np.zeros((count + 1, 3))
    x[:, 2] = -np.linspace(0.0, 1.0, count + 1)
    masses = np.full(count + 1, mass / count)
    masses[-1] *= 0.5
    springs = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    model = wc.Model.from_springs(x, masses, springs, 1.0 / count, k_s, 0.01, [0], precision="float64")
    sim = wc.Simulation(model)
    settle(sim, 2400)
    assert -sim.state.particle_q.numpy()[-1, 2] == pytest.approx(1.0 + mass * 9.81 / (2.0 * k_s), rel=1e-6)


def test_rotating_pair_does_not_decay():
    """The spring's damping acts along the spring only, so steady rotation is not slowed (section 2)."""
    k_s, m, r, omega = 10.0, 0.01, 0.1, 50.0
    length = r / (1.0 - m * omega**2 * r / (2.0 * k_s))
    assert length == pytest.approx(0.114285714, abs=1e-9)
    half = 0.5 * length
    model = wc.Model.from_springs(
        [[-half, 0, 0], [half, 0, 0]], m, [[0, 1]], r, k_s, 0.01,
        velocities=[[0, -half * omega, 0], [0, half * omega, 0]], precision="float64",
    )  # fmt: skip
    sim = wc.Simulation(model, gravity=(0, 0, 0), substeps=2000)
    sim.run(10, fps=10)
    x, v = sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()
    spin = m * np.cross(x, v).sum(axis=0)[2]
    assert spin == pytest.approx(2.0 * m * half**2 * omega, rel=1e-11)
    assert np.linalg.norm(x[1] - x[0]) == pytest.approx(length, rel=1e-3)
