"""What every integrator must do whatever its order: conserve, hold pins, replay graphs, keep worlds apart."""

import numpy as np
import pytest
from integrator_problems import ALL, NAMES, oscillator, phase, simulation

import warpcloth as wc
from warpcloth.cloth import pin
from warpcloth.errors import InputError, StepSizeError
from warpcloth.integrators import INTEGRATORS
from warpcloth.stability import largest_stable_step

LINEAR = [cls.name for cls in ALL if cls.conserves_linear_momentum]
ANGULAR = [cls.name for cls in ALL if cls.conserves_angular_momentum]
ADAPTIVE = [cls.name for cls in ALL if cls.adaptive]
ROUND_OFF = {False: 1e-12, True: 1e-9}  # of schemes that solve nothing, and of solvers at their tolerance


def free_network() -> wc.Model:
    """Eight damped, stretched particles that tumble without pins or gravity."""
    rng = np.random.default_rng(3)
    x, v = rng.normal(size=(8, 3)), rng.normal(size=(8, 3))
    ends = np.array([(i, j) for i in range(8) for j in range(i)])
    rest = 0.8 * np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)
    masses = rng.uniform(0.5, 2.0, 8)
    return wc.Model.from_springs(x, masses, ends, rest, 20.0, 0.5, velocities=v, precision="float64")


def momenta(sim: wc.Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Linear [kg m/s] and angular [kg m²/s]."""
    x, v = phase(sim)
    p = sim.model.particle_mass.numpy()[:, None] * v
    return p.sum(axis=0), np.cross(x, p).sum(axis=0)


@pytest.fixture(scope="module")
def drifts() -> dict[str, tuple[float, float]]:
    """Change of both momenta over 100 steps, relative to their size."""
    found = {}
    for name in NAMES:
        sim = simulation(free_network(), name, substeps=100)
        before, start = momenta(sim), phase(sim)
        sim.step(1.0)
        assert np.abs(phase(sim) - start).min(axis=(1, 2)).max() > 1e-3
        found[name] = tuple(
            float(np.linalg.norm(b - a) / np.linalg.norm(a)) for a, b in zip(before, momenta(sim), strict=True)
        )
    return found


@pytest.mark.parametrize("name", LINEAR)
def test_linear_momentum(name, drifts):
    assert drifts[name][0] < ROUND_OFF[INTEGRATORS[name].implicit]


@pytest.mark.parametrize("name", NAMES)
def test_angular_momentum(name, drifts):
    """Kept by the schemes that should; explicit ones that should not show that the test can tell."""
    if name in ANGULAR:
        assert drifts[name][1] < ROUND_OFF[INTEGRATORS[name].implicit]
    elif not INTEGRATORS[name].implicit:
        assert drifts[name][1] > 1e-11


@pytest.mark.parametrize("name", ANGULAR)
def test_rotating_pair_does_not_decay(name):
    """Damping acts along the spring only (section 2 of the known answers): ten damping times change nothing."""
    k_s, m, r, omega = 10.0, 0.01, 0.1, 50.0
    half = 0.5 * r / (1.0 - m * omega**2 * r / (2.0 * k_s))
    model = wc.Model.from_springs(
        [[-half, 0, 0], [half, 0, 0]], m, [[0, 1]], r, k_s, 0.01,
        velocities=[[0, -half * omega, 0], [0, half * omega, 0]], precision="float64",
    )  # fmt: skip
    sim = simulation(model, name, substeps=1000)
    sim.step(0.5)
    assert momenta(sim)[1][2] == pytest.approx(2.0 * m * half**2 * omega, rel=1e-8)
    x, _ = phase(sim)
    assert np.linalg.norm(x[1] - x[0]) == pytest.approx(2.0 * half, rel=2e-3)


MOTION = wc.Motion.keyframes([(0.0, (0, 0, 0)), (0.5, (0.05, 0.0, 0.1), (0.0, 0.0, 1.0))], interpolation="smooth")


def flag(height: float = 0.0) -> wc.Cloth:
    """A small, soft sheet with one still and one moving pin."""
    fabric = wc.Fabric(stretch_stiffness=20.0, shear_stiffness=5.0, bend_stiffness=0.5, damping_time=1e-3)
    pins = ["top_left", pin(["top_right", "bottom_right"], MOTION)]
    return wc.Cloth.grid((0.3, 0.3), (4, 4), fabric, pins=pins, transform=(0.0, 0.0, height))


def after(name: str, model: wc.Model, frames: int = 3, **options) -> wc.Simulation:
    """At the default options of the integrator, at 60 frames per second of 20 steps."""
    sim = wc.Simulation(model, name, substeps=20, **options)
    sim.run(frames)
    return sim


@pytest.mark.parametrize("name", NAMES)
def test_graphs_pins_and_worlds(name):
    """A captured graph does what its launches do; pins are where they belong; worlds do not see each other."""
    model = wc.Model.build(flag(), precision="float64")
    sim = after(name, model)
    assert sim.graph == INTEGRATORS[name].capturable
    q, qd = phase(sim)
    np.testing.assert_array_equal(phase(after(name, model, graph=False)), (q, qd))

    cloth = flag()
    np.testing.assert_array_equal(q[12], cloth.points[12])
    np.testing.assert_array_equal(qd[12], 0.0)
    moving = cloth.points[[3, 15]]
    path = [MOTION.evaluate(moving, t, moving.mean(axis=0)) for t in (sim.time - 1e-5, sim.time, sim.time + 1e-5)]
    np.testing.assert_allclose(q[[3, 15]], path[1], atol=1e-14)
    np.testing.assert_allclose(qd[[3, 15]], (path[2] - path[0]) / 2e-5, atol=1e-8)

    both = phase(after(name, wc.Model.build_worlds([([flag()], []), ([flag(0.5)], [])], precision="float64")))
    if INTEGRATORS[name].couples_worlds:
        np.testing.assert_allclose(both[:, :16], (q, qd), atol=2e-2)
    else:
        np.testing.assert_array_equal(both[:, :16], (q, qd))


@pytest.mark.parametrize("name", NAMES)
def test_single_precision_follows_double(name):
    double, single = (phase(after(name, wc.Model.build(flag(), precision=p))) for p in ("float64", "float32"))
    assert single.dtype == np.float32
    assert np.abs(double[1]).max() > 0.1
    np.testing.assert_allclose(single[0], double[0], atol=2e-5)
    np.testing.assert_allclose(single[1], double[1], atol=2e-3)


@pytest.mark.parametrize("name", NAMES)
def test_springs_of_zero_length_stay_finite(name):
    model = wc.Model.from_springs(
        [[0, 0, 0], [0, 0, 0], [0.1, 0, 0]], 0.1, [[0, 1], [1, 2]], 0.1, 5.0, 0.01, [0], precision="float64"
    )
    sim = wc.Simulation(model, name, (0, 0, 0), 50)
    sim.run(3)
    assert np.isfinite(phase(sim)).all()


@pytest.mark.parametrize("name", ADAPTIVE)
def test_adaptive_steps_follow_the_tolerance(name):
    """Errors fall with the tolerance, steps are counted, and the interval is met exactly however it is divided."""
    errors, steps = [], []
    for tolerance in (1e-4, 1e-6, 1e-8):
        options = {"rtol": tolerance, "position_tolerance": tolerance, "velocity_tolerance": tolerance}
        sim = simulation(oscillator(20.0, 0.0, 0.3), name, integrator_options=options)
        for _ in range(10):
            sim.step(0.05)
        errors.append(abs(sim.state.particle_q.numpy()[1, 0] - 1.0 - 0.3 * np.cos(10.0)))
        steps.append(sim.metrics()["accepted_steps"])
        assert steps[-1] + sim.metrics()["rejected_steps"] <= sim.forces.evaluations
    assert errors[0] > 10.0 * errors[1] > 100.0 * errors[2] > 0.0
    assert 10 <= steps[0] < steps[1] < steps[2]
    sim.integrator.reset()
    assert sim.metrics()["accepted_steps"] == 0


@pytest.mark.parametrize("name", ADAPTIVE)
def test_adaptive_steps_stay_stable_where_the_interval_is_not(name):
    model = wc.Model.build(flag(), precision="float64")
    sim = wc.Simulation(model, name)
    sim.run(6)
    assert sim.substeps == 1
    assert sim.metrics()["accepted_steps"] > 6
    assert np.abs(phase(sim)[0]).max() < 0.5
    assert 0.1 < sim.metrics()["step_size"] / largest_stable_step(model, INTEGRATORS["rk4"](model)) < 20.0


@pytest.mark.parametrize("name", ADAPTIVE)
def test_hysteresis_moves_on_with_adaptive_steps(name):
    """A strip that swings to and fro a few times in a call, in which friction turns with it."""
    fabric = wc.Fabric(
        areal_density=0.12, stretch_stiffness=20.0, shear_stiffness=4.0, bending_rigidity=1e-4,
        bending_hysteresis=4e-3, bend_stiffness=0.0, damping_time=0.0,
    )  # fmt: skip
    cloth = wc.Cloth.grid((0.06, 0.01), (7, 2), fabric, pins=[0, 1, 7, 8])
    model = wc.Model.build(cloth, precision="float64")
    bow = np.maximum(model.particle_q.numpy()[:, 0] + 0.02, 0.0) / 0.05
    tips = []
    for scheme, substeps in ((name, 1), ("rk4", 2000)):
        sim = wc.Simulation(model, scheme, (0, 0, 0), substeps, contact="none")
        sim.state.particle_qd.assign(np.outer(bow * bow, (0.0, 0.0, 2.0)))
        sim.step(0.15)
        tips.append(phase(sim)[:, 6, 2])
    np.testing.assert_allclose(*tips, atol=0.01 * np.abs(tips[1]).max())


@pytest.mark.parametrize("name", ADAPTIVE)
def test_a_tolerance_that_cannot_be_met_says_what_to_change(name):
    sim = simulation(oscillator(1e3, 0.0, 0.3), name, integrator_options={"max_steps": 5})
    with pytest.raises(StepSizeError, match=r"after 5 steps in 1 s .* raise rtol"):
        sim.step(1.0)
    with pytest.raises(InputError, match=f"^Integrator '{name}': rtol must be a number greater than 0"):
        simulation(oscillator(), name, integrator_options={"rtol": 0.0})


@pytest.mark.parametrize("name", ADAPTIVE)
def test_a_step_whose_forces_overflow_leaves_nothing_behind_in_those_that_follow(name):
    """A stiff spring, of which the first trial goes beyond single precision; it comes to rest within a millisecond."""
    points = [[0.0, 0.0, 0.0], [1.01, 0.0, 0.0]]
    model = wc.Model.from_springs(points, 1e-6, [[0, 1]], 1.0, 1e6, 1.0, [0], device="cpu")
    sim = wc.Simulation(model, name, (0.0, 0.0, 0.0))
    sim.step(0.01)
    assert sim.metrics()["rejected_steps"] > 2
    np.testing.assert_allclose(sim.state.particle_q.numpy()[1], [1.0, 0.0, 0.0], atol=1e-3)


@pytest.mark.filterwarnings("ignore::warpcloth.errors.StabilityWarning")  # forward Euler has no stable step here
@pytest.mark.parametrize("name", NAMES)
def test_it_does_not_show_where_frames_end(name):
    """Not even in what bending with hysteresis remembers from step to step."""
    fabric = wc.Fabric(
        stretch_stiffness=20.0, shear_stiffness=5.0, bending_rigidity=1e-5, bending_hysteresis=1e-3, damping_time=0.0
    )
    model = wc.Model.build([wc.Cloth.grid((0.3, 0.3), (6, 6), fabric, pins="top_left")], precision="float64")
    model.particle_q.assign(model.particle_q.numpy() + 0.01 * np.random.default_rng(0).normal(size=(36, 3)))
    ends = []
    for substeps in (1, 20):
        sim = wc.Simulation(model, name, substeps=substeps, contact="none")
        for _ in range(60 // substeps):
            sim.step(1e-4 * substeps)
        ends.append(np.hstack([sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()]))
    np.testing.assert_array_equal(ends[0], ends[1])
