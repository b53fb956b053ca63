"""Implicit schemes: their solver against dense linear algebra, their equations, known decay, stiff cloth, reports."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

import warpcloth as wc
from warpcloth.cloth import pin
from warpcloth.errors import ConvergenceWarning, InputError
from warpcloth.forces import Forces, Linearization, Springs
from warpcloth.integrators import INTEGRATORS
from warpcloth.integrators.conjugate_gradient import ConjugateGradient
from warpcloth.state import State

NEWTON = ("implicit_euler", "implicit_midpoint", "implicit_trapezoid", "bdf2")
LINEAR = ("linear_implicit_euler", "imex")
GRAVITY = np.array([0.0, 0.0, -9.81])


def small_cloth(n: int = 6, precision: str = "float64", stiffness: float = 50.0, worlds: int = 1) -> wc.Model:
    """Cloths that hang by two corners; each world's is softer than the one before."""
    cloths = []
    for world in range(worlds):
        fabric = wc.Fabric(stretch_stiffness=stiffness / (1 + world), shear_stiffness=0.2 * stiffness)
        cloths.append(wc.Cloth.grid((0.5, 0.5), (n, n), fabric, pins=["top_left", "top_right"]))
    return wc.Model.build_worlds([([cloth], []) for cloth in cloths], precision=precision)


def phase(sim: wc.Simulation) -> np.ndarray:
    return np.stack([sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()])


def forces_of(model: wc.Model) -> Forces:
    gravity = np.tile(GRAVITY, (model.world_count, 1))
    return Forces(model, [Springs(model)], model.array(gravity, model.vec3))


def force_at(model: wc.Model, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    state = State.of(model)
    state.particle_q.assign(x)
    state.particle_qd.assign(v)
    forces_of(model).evaluate(state)
    return state.particle_f.numpy()


def dense(forces: Forces, at: Linearization) -> np.ndarray:
    model, columns = forces.model, []
    for unit in np.eye(3 * model.particle_count):
        out = wp.zeros_like(model.particle_q)
        forces.hessian_product(at, model.array(unit.reshape(-1, 3), model.vec3), out)
        columns.append(out.numpy().reshape(-1))
    return np.stack(columns, axis=1)


def test_conjugate_gradients_equal_a_dense_solve():
    model = small_cloth()
    forces, n = forces_of(model), model.particle_count
    at = Linearization(State.of(model), 1e-4, 1e-2, model.array([1.0], model.real))
    residual = np.random.default_rng(0).normal(size=(n, 3))
    cg = ConjugateGradient(model, 1000)
    active = wp.ones(1, dtype=wp.int32, device=model.device)
    cg.solve(forces, at, model.array(residual, model.vec3), active, model.array([1e-13], wp.float64))
    free = np.repeat(model.particle_inv_mass.numpy() > 0.0, 3)
    matrix = (dense(forces, at) + np.diag(np.repeat(model.particle_mass.numpy(), 3)))[np.ix_(free, free)]
    expected = np.zeros(3 * n)
    expected[free] = -np.linalg.solve(matrix, residual.reshape(-1)[free])
    assert np.linalg.norm(expected) > 1.0
    assert np.abs(cg.x.numpy().reshape(-1) - expected).max() <= 1e-9 * np.abs(expected).max()
    assert 10 < cg.solves.iterations.numpy()[0] < 400
    decrease = -residual.reshape(-1) @ expected
    assert cg.solves.decrease.numpy()[0] == pytest.approx(decrease, rel=1e-9)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
def test_linear_solves_are_as_exact_as_asked_for(tolerance):
    """In the energy norm, and hardly more exact, which would be for nothing: x·A x is the decrease at its end."""
    model = wc.Model.build(wc.Cloth.grid((0.5, 0.5), (25, 25), pins="top"), precision="float64")
    forces, active = forces_of(model), wp.ones(1, dtype=wp.int32, device=model.device)
    at = Linearization(State.of(model), 1e-3, 1e-2, model.array([1.0], model.real))
    residual = np.zeros((model.particle_count, 3))
    residual[model.particle_inv_mass.numpy() > 0.0] = 1e-3, 2e-3, 3e-3
    decreases = []
    for accuracy in (tolerance, 1e-12):
        cg = ConjugateGradient(model, 1000)
        cg.solve(forces, at, model.array(residual, model.vec3), active, model.array([accuracy], wp.float64))
        decreases.append(float(cg.solves.decrease.numpy()[0]))
    assert 1e-4 * tolerance < np.sqrt(1.0 - decreases[0] / decreases[1]) < tolerance


@pytest.mark.parametrize("name", NEWTON)
def test_steps_satisfy_the_equations_of_the_scheme(name):
    """Every equation is written out a second time here, for cloth in free fall into its pins."""
    model, h = small_cloth(), 0.02
    sim = wc.Simulation(model, name, substeps=1)
    states = [phase(sim)]
    for _ in range(3):
        sim.step(h)
        states.append(phase(sim))
        assert sim.metrics()["converged"]
    (x2, v2), (x1, v1), (x0, v0) = states[-1], states[-2], states[-3]
    m = model.particle_mass.numpy()[:, None]
    if name == "implicit_euler":
        dx, dv, x_rate, f = x2 - x1, v2 - v1, v2, force_at(model, x2, v2)
    elif name == "implicit_midpoint":
        x, v = 0.5 * (x1 + x2), 0.5 * (v1 + v2)
        dx, dv, x_rate, f = x2 - x1, v2 - v1, v, force_at(model, x, v)
    elif name == "implicit_trapezoid":
        f = 0.5 * (force_at(model, x1, v1) + force_at(model, x2, v2))
        dx, dv, x_rate = x2 - x1, v2 - v1, 0.5 * (v1 + v2)
    else:
        dx, dv = 1.5 * x2 - 2.0 * x1 + 0.5 * x0, 1.5 * v2 - 2.0 * v1 + 0.5 * v0
        x_rate, f = v2, force_at(model, x2, v2)
    free = model.particle_inv_mass.numpy() > 0.0
    assert np.abs(dv[free]).max() > 1e-3
    assert np.abs(dx - h * x_rate)[free].max() <= 1e-13
    assert np.abs(m * dv - h * f)[free].max() <= 1e-9 * np.abs(m * dv)[free].max()


def test_linear_schemes_satisfy_their_linear_equation():
    """With pins that gain speed: springs are stretched by the way they go, and damped by what their speed changes."""
    motion = wc.Motion.keyframes([(0.0, (0, 0, 0)), (0.05, (0.03, 0.02, 0.04))], interpolation="smooth")
    fabric = wc.Fabric(stretch_stiffness=50.0, shear_stiffness=10.0)
    cloth = wc.Cloth.grid((0.5, 0.5), (6, 6), fabric, pins=["top_left", pin("top_right", motion)])
    model, h = wc.Model.build(cloth, precision="float64"), 0.004
    m = np.repeat(model.particle_mass.numpy(), 3)
    free = np.repeat(model.particle_inv_mass.numpy() > 0.0, 3)
    for name, elastic in [("linear_implicit_euler", 1.0), ("imex", 0.0)]:
        sim = wc.Simulation(model, name, substeps=1, integrator_options={"cg_tolerance": 1e-12})
        sim.step(h)
        x, v = phase(sim)
        state = State.of(model)
        state.particle_q.assign(x)
        state.particle_qd.assign(v)
        ones = model.array([1.0], model.real)
        k, c = (dense(forces_of(model), Linearization(state, a, b, ones)) for a, b in [(1.0, 0.0), (0.0, 1.0)])
        sim.step(h)
        dx, dv = (change.reshape(-1) for change in phase(sim) - np.stack([x, v]))
        right = h * force_at(model, x, v).reshape(-1)
        left = m * dv + h * c @ dv + elastic * h * k @ dx
        assert np.abs((left - right)[free]).max() <= 1e-10 * np.abs(m * dv).max()
        assert np.abs(dx - h * phase(sim)[1].reshape(-1))[free].max() <= 1e-15
        assert np.abs(dx - h * phase(sim)[1].reshape(-1))[~free].max() > 1e-4


@pytest.mark.parametrize(
    ("name", "loss"),
    [
        ("implicit_euler", lambda t: t**2 / (1.0 + t**2)),
        ("linear_implicit_euler", lambda t: t**2 / (1.0 + t**2)),
        ("bdf2", lambda t: 0.5 * t**4),
        ("implicit_midpoint", lambda t: 0.0),
        ("implicit_trapezoid", lambda t: 0.0),
    ],
)
def test_energy_decays_by_the_known_factor_per_step(name, loss):
    """The undamped oscillator ω = 1: energy lost per step at θ = ω h, a relation of the linear scheme."""
    theta, steps = 0.05, 400
    model = wc.Model.from_springs([[0, 0, 0], [1.1, 0, 0]], 1.0, [[0, 1]], 1.0, 1.0, 0.0, [0], precision="float64")
    sim = wc.Simulation(model, name, (0, 0, 0), substeps=steps)
    energies = []
    for _ in range(2):  # the second round is free of the start of BDF2
        energies.append(sim.energy()["total"])
        sim.step(theta * steps)
    measured = 1.0 - (sim.energy()["total"] / energies[-1]) ** (1.0 / steps)
    assert energies[-1] > 1e-4 * energies[0]
    if loss(theta) > 0.0:
        # averaged over turns the rate is exact for Euler; BDF2's has a relative remainder of order θ²
        assert measured == pytest.approx(loss(theta), rel=0.05)
    else:
        assert abs(measured) < 1e-13


def test_bdf2_starts_afresh_at_another_step_and_after_reset():
    """A captured graph must do so too: the flag is on the device."""
    model = small_cloth()
    sim = wc.Simulation(model, "bdf2", substeps=1)
    for dt in (0.01, 0.01, 0.01, 0.02, 0.02, 0.02, 0.01):
        sim.step(dt)
    for reset in (False, True):
        x, v = phase(sim)
        if reset:
            sim.integrator.reset()
        euler = wc.Simulation(model, "implicit_euler", substeps=1)
        for array, value in zip((euler.state.particle_q, euler.state.particle_qd), (x, v), strict=True):
            array.assign(value)
        euler.step(0.01)
        sim.step(0.01)
        base = v + (phase(euler)[1] - v) / 3.0  # as if Euler's acceleration had been that of the step before
        after = phase(sim)
        fresh = base + 2.0 / 3.0 * 0.01 * force_at(model, *after) / model.particle_mass.numpy()[:, None]
        free = model.particle_inv_mass.numpy() > 0.0
        assert (np.abs(after[1] - fresh)[free].max() < 1e-8) == reset


def test_bdf2_is_not_thrown_by_a_start_out_of_balance():
    """Stiff cloth with waves of 4 mm, at rest: its first step is implicit Euler's."""
    cloth = wc.Cloth.grid((0.3, 0.3), (13, 13), wc.Fabric(stretch_stiffness=2000.0), pins="left")
    rng = np.random.default_rng(0)
    points = cloth.points + np.outer(rng.normal(scale=0.004, size=len(cloth.points)), (0, 0, 1))
    ends = []
    for name in ("implicit_euler", "bdf2"):
        sim = wc.Simulation(wc.Model.build(replace(cloth, points=points), precision="float64"), name, substeps=1)
        sim.step(0.01)
        ends.append(phase(sim))
    assert np.linalg.norm(ends[0][1], axis=1).max() > 0.05
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-8)


@pytest.mark.parametrize("name", NEWTON + LINEAR)
def test_captured_equals_uncaptured_and_worlds_equal_single_runs(name):
    """Bitwise: iterations are counted, and worlds stopped, on the device and one by one."""
    dt = 1e-3 if name == "imex" else 1.0 / 60.0
    runs = {}
    for graph, worlds in itertools.product((True, False), (1, 2)):
        sim = wc.Simulation(small_cloth(8, "float32", 500.0, worlds), name, substeps=1, graph=graph)
        for _ in range(6):
            sim.step(dt)
        runs[graph, worlds] = phase(sim)
        assert sim.graph == graph
    assert np.abs(runs[True, 1][1]).max() > 1e-3
    assert np.array_equal(runs[True, 1], runs[False, 1])
    assert np.array_equal(runs[True, 2], runs[False, 2])
    single = runs[True, 1].shape[1]
    assert np.array_equal(runs[True, 2][:, :single], runs[True, 1])
    assert not np.array_equal(runs[True, 2][:, single:], runs[True, 1])


@pytest.mark.parametrize("name", NEWTON + LINEAR)
def test_moving_pins_are_where_their_motion_is(name):
    motion = wc.Motion(times=[0.0, 0.5], positions=[[0, 0, 0], [0.2, 0.1, 0.3]], rotations=np.zeros((2, 3)))
    fabric = wc.Fabric(stretch_stiffness=20.0, shear_stiffness=5.0)
    cloth = wc.Cloth.grid((0.5, 0.5), (6, 6), fabric, pins=[pin("top", motion)])
    sim = wc.Simulation(wc.Model.build([cloth], precision="float64"), name, substeps=20)
    sim.step(0.1)
    pinned = cloth.pins[0].indices
    expected, _ = motion.pose(0.1)
    x, v = phase(sim)
    assert np.abs(x[pinned] - cloth.points[pinned] - expected).max() <= 1e-14
    assert np.abs(v[pinned] - np.array([0.4, 0.2, 0.6])).max() <= 1e-12
    assert np.abs(x - cloth.points).max() < 0.3


@pytest.mark.parametrize("name", [*NEWTON, "linear_implicit_euler"])
def test_stiff_cloth_hangs_at_a_frame_a_step(name):
    """5000 N/m at 1/60 s, where explicit schemes need hundreds of substeps; swung, then strained by its weight only."""
    fabric = wc.Fabric(stretch_stiffness=5000.0, shear_stiffness=1000.0)
    cloth = wc.Cloth.grid((1.0, 1.0), (32, 32), fabric, pins=["top_left", "top_right"])
    sim = wc.Simulation(wc.Model.build([cloth]), name, substeps=1)
    for _ in range(12):
        sim.step(1.0 / 60.0)
    measures = sim.metrics()
    assert measures["unconverged_steps"] == 0
    assert measures["mean_strain"] < 2e-3
    assert 0.1 < measures["max_speed"] < 10.0


def test_newton_reports_what_it_did_and_what_it_could_not():
    good = wc.Simulation(small_cloth(8, stiffness=500.0), "implicit_euler", substeps=1)
    good.step(1.0 / 60.0)
    measures = good.metrics()
    assert measures["converged"]
    assert measures["unconverged_steps"] == 0
    assert measures["residual"] <= 1e-10
    assert 1 < measures["newton_iterations"] < 30
    assert measures["cg_iterations"] > measures["newton_iterations"]
    options = {"max_iterations": 1, "cg_iterations": 2}
    bad = wc.Simulation(small_cloth(8, stiffness=500.0), "implicit_euler", substeps=3, integrator_options=options)
    with pytest.warns(ConvergenceWarning, match="did not meet its tolerance"):
        bad.step(0.05)
    measures = bad.metrics()
    assert not measures["converged"]
    assert measures["unconverged_steps"] == 3
    assert measures["residual"] > 1e-10
    bad.step(0.05)  # says so once
    assert bad.metrics()["newton_iterations_total"] == 6


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("implicit_euler", {"tolerance": 0.0}),
        ("implicit_euler", {"max_iterations": 0}),
        ("bdf2", {"cg_tolerance": 2.0}),
        ("imex", {"cg_iterations": 1.5}),
        ("imex", {"tolerance": 1.0}),
    ],
)
def test_options_are_checked(name, options):
    with pytest.raises(InputError, match=f"(?i)integrator '{name}'.* {next(iter(options))}|'{next(iter(options))}'"):
        wc.Simulation(small_cloth(), name, substeps=1, integrator_options=options)


def test_imex_limit_is_where_its_polynomial_says():
    imex = INTEGRATORS["imex"]
    for omega, gamma in [(1.0, 0.0), (2.0, 3.0), (1.0, 50.0)]:
        h = imex.stable_step(omega, gamma)
        for factor, stable in [(0.999, True), (1.001, False)]:
            s = factor * h
            roots = np.roots([1.0 + gamma * s, -(2.0 + gamma * s - (omega * s) ** 2), 1.0])
            assert (np.abs(roots).max() <= 1.0 + 1e-12) == stable
    assert imex.stable_step(0.0, 1.0) == np.inf


def test_collapsed_cloth_stays_finite():
    """All particles in one point: springs without direction, a matrix of masses alone."""
    model = wc.Model.from_springs(np.zeros((4, 3)), 1.0, [[0, 1], [1, 2], [2, 3]], 1.0, 100.0, 1.0, [0])
    for name in NEWTON + LINEAR:
        sim = wc.Simulation(model, name, substeps=2)
        sim.step(0.01)
        assert np.isfinite(phase(sim)).all()


@pytest.mark.parametrize(("name", "substeps"), [("implicit_euler", 1), ("linear_implicit_euler", 4), ("bdf2", 4)])
def test_stiff_cloth_drapes_on_a_sphere(name, substeps):
    """Implicit Euler knows what cloth stands on while it solves, so it needs one step a frame; where contact moves
    particles after the solve only, stiff cloth wants a few."""
    fabric = wc.Fabric(stretch_stiffness=5000.0, shear_stiffness=1000.0)
    cloth = wc.Cloth.grid((1.0, 1.0), (24, 24), fabric, transform=(0.0, 0.0, 0.31))
    model = wc.Model.build([cloth], [wc.Sphere(center=(0, 0, 0), radius=0.3)])
    sim = wc.Simulation(model, name, substeps=substeps)
    for _ in range(10):
        sim.step(1.0 / 60.0)
    measures = sim.metrics()
    assert measures["unconverged_steps"] == 0
    assert measures["mean_strain"] < (0.003 if substeps == 1 else 0.01)
    assert measures["max_penetration_m"] < 1e-4
    lowest = sim.state.particle_q.numpy()[:, 2].min()
    assert -0.1 < lowest < 0.25  # the edges fall, the middle lies on the sphere


@pytest.mark.parametrize("name", NEWTON + LINEAR)
def test_cloth_slides_down_an_incline_as_coulomb_says(name):
    """30°, μ = 0.3: 0.294536 m in 0.5 s. BDF2 must take what contact changes between its steps as impulses."""
    fabric = wc.Fabric(stretch_stiffness=50.0, shear_stiffness=10.0, friction=0.3)
    distance = 0.5 * fabric.thickness + 0.001
    cloth = wc.Cloth.grid((0.1, 0.1), (4, 4), fabric, transform=(0.0, 0.0, distance))
    model = wc.Model.build([cloth], [wc.Plane(friction=0.3, thickness=0.001)], precision="float64")
    tilt = np.radians(30.0)
    sim = wc.Simulation(model, name, gravity=9.81 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)]), substeps=400)
    start = phase(sim)[0].mean(axis=0)
    sim.step(0.5)
    way = phase(sim)[0].mean(axis=0) - start
    assert way[0] == pytest.approx(0.294536, rel=0.01)  # first order in contact: g h t/2 off at most
    assert abs(way[2]) < 1e-4
