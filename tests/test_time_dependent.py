"""Forces that depend on time, and a state that somebody changed: every integrator sees them when they are."""

import math

import numpy as np
import pytest
import warp as wp
from integrator_problems import ALL, oscillator, phase, simulation
from scipy.integrate import solve_ivp

import warpcloth as wc
from warpcloth.forces import MassDamping
from warpcloth.integrators import INTEGRATORS

ORDERLY = [cls.name for cls in ALL if cls.order > 1]  # in others a time that is off by a step does not show
STEPS = {2: 32, 3: 16, 4: 16, 5: 8}
OMEGA, START, END, PUSH, RATE = 6.0, 0.2, 0.5, 8.0, 9.0


@wp.kernel
def push_to_and_fro(world_time: wp.array(dtype=wp.float64), offset: wp.float64, particle_f: wp.array(dtype=wp.vec3d)):
    i = wp.tid()
    f = wp.float64(PUSH) * wp.sin(wp.float64(RATE) * (world_time[0] + offset))
    particle_f[i] = particle_f[i] + wp.vec3d(f, wp.float64(0.0), wp.float64(0.0))


class ToAndFro(wc.UserForce):
    """PUSH sin(RATE t) along x on every particle."""

    name = "to_and_fro"

    def accumulate(self, state: wc.State, time_offset: float) -> None:
        wp.launch(push_to_and_fro, len(state.particle_f), [state.world_time, time_offset], [state.particle_f])


@pytest.mark.parametrize("zeta", [0.0, 0.1])
@pytest.mark.parametrize("name", ORDERLY)
def test_a_force_is_that_of_its_time_at_every_stage(name, zeta):
    """A driven oscillator at the order of the scheme; forces of another time within the step would make it one."""
    order = INTEGRATORS[name].order

    def rhs(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -(OMEGA**2) * y[0] - 2.0 * zeta * OMEGA * y[1] + PUSH * math.sin(RATE * t)]

    exact = solve_ivp(rhs, (0.0, END), [START, 0.0], method="DOP853", rtol=3e-14, atol=1e-15).y[:, -1]
    errors = []
    for level in range(3):
        sim = simulation(oscillator(OMEGA, zeta, START), name, substeps=STEPS[order] * 2**level, forces=[ToAndFro()])
        sim.step(END)
        x, v = phase(sim)[:, 1, 0]
        errors.append(float(np.hypot(OMEGA * (x - 1.0 - exact[0]), v - exact[1])))
    assert math.log2(errors[1] / errors[2]) > order - 0.3


@pytest.mark.parametrize("name", ["symplectic_euler", "rk4", "implicit_euler", "bdf2", "xpbd"])
def test_mass_damping_slows_by_e_in_its_time(name):
    """v ← v exp(−c t), to the order of the scheme; implicit Euler has 1/(1 + c h) for each step, whatever the mass."""
    rate, steps, time = 3.0, 64, 0.25
    model = wc.Model.from_springs(
        [[0, 0, 0], [1, 0, 0]], [0.1, 5.0], [[0, 1]], 1.0, 1e-9, 0.0, velocities=[[1, 2, 3]] * 2, precision="float64"
    )
    sim = simulation(model, name, substeps=steps, forces=[MassDamping(model, rate)])
    sim.step(time)
    allowed = rate**2 * time * time / steps if INTEGRATORS[name].order < 2 else 1e-4
    np.testing.assert_allclose(phase(sim)[1] / np.array([1.0, 2.0, 3.0]), math.exp(-rate * time), rtol=allowed)
    if name == "implicit_euler":
        slowed = (1.0 + rate * time / steps) ** -steps
        np.testing.assert_allclose(phase(sim)[1] / np.array([1.0, 2.0, 3.0]), slowed, rtol=1e-9)


def test_bdf2_takes_its_past_along_when_somebody_moves_cloth_between_steps():
    """Without forces what was pushed and put elsewhere flies on straight, at its new speed."""
    model = wc.Model.from_springs(
        [[0, 0, 0], [1, 0, 0]], [0.1, 5.0], [[0, 1]], 1.0, 1e-12, 0.0, velocities=[[1, 2, 3]] * 2, precision="float64"
    )
    sim, h = simulation(model, "bdf2"), 0.01
    for _ in range(3):
        sim.step(h)
    x, v = phase(sim)
    x, v = x + np.array([0.3, -0.2, 0.1]), v + np.array([-2.0, 0.5, 4.0])
    sim.state.particle_q.assign(x)
    sim.state.particle_qd.assign(v)
    for step in (1, 2):
        sim.step(h)
        np.testing.assert_allclose(phase(sim), [x + step * h * v, v], atol=1e-11)


class Asked(wc.UserForce):
    """No force; keeps when within the step it was asked for."""

    name = "asked"

    def __init__(self):
        self.times: set[float] = set()

    def accumulate(self, state: wc.State, time_offset: float) -> None:
        self.times.add(time_offset)


@pytest.mark.parametrize("name", ["implicit_midpoint", "implicit_trapezoid"])
def test_undamped_rules_measure_the_work_of_forces_when_they_did_it(name):
    """By Simpson's rule, which takes the forces at the start, in the middle and at the end of the step."""
    asked = Asked()
    sim = simulation(oscillator(OMEGA, 0.0, START), name, forces=[asked], graph=False)
    sim.step(0.01)
    assert asked.times == {0.0, 0.005, 0.01}
