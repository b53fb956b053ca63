"""The loop around the integrator: graphs, worlds, automatic substeps, rest, divergence, motions, energies."""

import numpy as np
import pytest
import warp as wp
from hypothesis import example, given, settings
from hypothesis import strategies as st

import warpcloth as wc
from warpcloth.errors import DivergedError, InputError, SimulationError, StabilityWarning
from warpcloth.integrators import INTEGRATORS
from warpcloth.kinematics import MovingPins, drive_pins, make_tracks
from warpcloth.stability import fastest_rates, largest_stable_step

BALL = wc.Sphere((0.0, 0.0, -0.2), 0.15)


def sheet(n=10, **options) -> wc.Cloth:
    return wc.Cloth.grid(size=(0.4, 0.4), resolution=(n, n), **options)


def phase(sim: wc.Simulation) -> np.ndarray:
    return np.hstack([sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()])


def final(model: wc.Model, frames=30, **options) -> np.ndarray:
    sim = wc.Simulation(model, **options)
    sim.run(frames)
    return phase(sim)


@pytest.mark.parametrize("substeps", ["auto", 31])
def test_captured_frame_equals_the_uncaptured_one(substeps):
    swing = wc.Motion.keyframes([(0, (0, 0, 0)), (0.3, (0.1, 0, 0.1), (0, 0, 2))])
    mover = wc.Sphere(BALL.center, BALL.radius, motion=wc.Motion.keyframes([(0, (0, 0, 0)), (0.4, (0, 0, 0.2))]))
    cloth = sheet(pins=[wc.pin("left", motion=swing)])
    model = wc.Model.build(cloth, [mover, wc.Plane((0, 0, -0.3))])
    assert np.array_equal(final(model, substeps=substeps, graph=True), final(model, substeps=substeps, graph=False))


def test_a_world_does_not_feel_its_neighbours():
    worlds = [
        ([sheet(8)], [BALL]),
        ([sheet(11, pins="left"), sheet(6, name="small", transform=(0, 0, 0.5))], [wc.Plane((0, 0, -0.1))]),
        ([sheet(9, velocity=(0, 0, 1))], []),
    ]
    together = wc.Model.build_worlds(worlds)
    got = final(together, substeps=60)
    for w, (cloths, obstacles) in enumerate(worlds):
        alone = final(wc.Model.build(cloths, obstacles), substeps=60)
        ranges = [c for c in together.cloths if c.world == w]
        assert np.array_equal(got[ranges[0].start : ranges[-1].stop], alone)


def test_gravity_per_world():
    model = wc.Model.build_worlds([([sheet(4)], []), ([sheet(4)], [])])
    sim = wc.Simulation(model, gravity=[(0, 0, -1), (2, 0, 0)])
    sim.run(60)
    v = sim.state.particle_qd.numpy()
    assert np.allclose(v[:16], (0, 0, -1), atol=1e-4)
    assert np.allclose(v[16:], (2, 0, 0), atol=1e-4)


def test_fastest_rate_of_a_square_grid_is_the_closed_form():
    """Exact without bend springs (section 1 of the known answers); the bound for all configurations lies above."""
    n, a, density, young, shear = 33, 0.02, 0.2, 300.0, 60.0
    fabric = wc.Fabric(areal_density=density, stretch_stiffness=young, shear_stiffness=shear, bend_stiffness=0.0)
    cloth = wc.Cloth.grid(size=(a * (n - 1), a * (n - 1)), resolution=(n, n), fabric=fabric)
    model = wc.Model.build(cloth, precision="float64")
    root = np.sqrt(young**2 + 4 * shear**2)
    k1, k2 = a * ((young + root) / 2 - shear), np.sqrt(2) * a * shear
    closed_form = 2.0 / (a * np.sqrt(density * a / (k1 + k2 / np.sqrt(2))))
    omega, gamma = fastest_rates(model, cloth.points)
    assert omega == pytest.approx(closed_form, rel=0.01)
    assert gamma == pytest.approx(fabric.damping_time * omega**2, rel=0.01)
    assert fastest_rates(model)[0] > omega


@settings(max_examples=12)
@given(
    n=st.integers(3, 9),
    size=st.floats(0.05, 2.0),
    density=st.floats(0.05, 1.0),
    young=st.floats(10.0, 1000.0),
    ratio=st.floats(0.01, 0.5),
    damping=st.floats(5e-4, 2e-3),
    crumple=st.floats(0.0, 1.0),
)
def test_automatic_substeps_never_explode(n, size, density, young, ratio, damping, crumple):
    fabric = wc.Fabric(
        areal_density=density, stretch_stiffness=young, shear_stiffness=ratio * young,
        bend_stiffness=0.1 * ratio * young, damping_time=damping,
    )  # fmt: skip
    cloth = wc.Cloth.grid(size=(size, size), resolution=(n, n), fabric=fabric, pins="top_left")
    sim = wc.Simulation(wc.Model.build(cloth), contact="none")
    jolt = crumple * size / n * np.random.default_rng(0).standard_normal(cloth.points.shape)
    sim.state.particle_q.assign(cloth.points + np.where(model_free(sim)[:, None], jolt, 0.0))
    before = sim.energy()["total"]
    sim.run(20)
    # Springs crushed through zero length turn at once, which no finite step follows: some drift, but no explosion.
    growth = 0.05 if crumple < 0.3 else 1.0
    scale = abs(before) + 9.81 * size * sim.model.particle_mass.numpy().sum()
    assert sim.energy()["total"] <= before + growth * scale


def model_free(sim: wc.Simulation) -> np.ndarray:
    return sim.model.particle_inv_mass.numpy() > 0.0


def test_an_unstable_step_raises_and_says_what_to_change():
    sim = wc.Simulation(wc.Model.build(sheet(30, pins="left")), substeps=2)
    with (
        pytest.warns(StabilityWarning, match="which takes [0-9]+ substeps") as caught,
        pytest.raises(DivergedError, match='substeps="auto"'),
    ):
        sim.run(200)
    assert caught[0].filename == __file__  # the line that called, not one of the package's


def test_hopeless_automatic_substeps_are_refused():
    stiff = wc.Fabric(stretch_stiffness=1e11, shear_stiffness=1e10)
    with pytest.raises(SimulationError, match="substeps per frame"):
        wc.Simulation(wc.Model.build(sheet(fabric=stiff))).step(1 / 60)


def test_substeps_follow_the_stable_step():
    model = wc.Model.build(sheet())
    sim = wc.Simulation(model)
    sim.step(1 / 60)
    step = largest_stable_step(model, sim.integrator)
    assert (1 / 60) / sim.substeps <= step < (1 / 60) / (sim.substeps - 1)


def test_rest_is_seen_and_lost():
    model = wc.Model.build(sheet(transform=(0, 0, 0.002)), [wc.Plane(motion=wc.Motion.keyframes(
        [(0.0, (0, 0, 0)), (1.0, (0, 0, 0)), (1.5, (0, 0, 0.3))]
    ))])  # fmt: skip
    sim = wc.Simulation(model)
    sim.run(10)
    assert not sim.settled  # quiet, but not yet for long enough
    sim.run(20)
    assert sim.settled
    sim.run(40)
    assert not sim.settled
    sim.run(60)
    assert sim.settled


@settings(max_examples=40)
@given(
    t=st.floats(-0.5, 4.0),
    turn=st.tuples(*[st.floats(-7.0, 7.0)] * 3),
    smooth=st.booleans(),
    loop=st.booleans(),
)
@example(t=-5e-324, turn=(0.0, 0.0, 0.0), smooth=False, loop=True)
@example(t=-1e-300, turn=(0.0, 0.0, 0.0), smooth=False, loop=True)
def test_device_motion_equals_host_motion(t, turn, smooth, loop):
    keys = [(0.0, (0, 0, 0)), (0.7, (1, -1, 0.5), turn), (2.0, (0.2, 0.1, 0), (0, 0, 12.0))]
    motion = wc.Motion.keyframes(keys, interpolation="smooth" if smooth else "linear", loop=loop)
    model = wc.Model.from_springs([[0.3, 0.2, 0.1], [1, 2, 3]], 1, [[0, 1]], 1, 1, 1, precision="float64")
    rest = np.array([[0.3, 0.2, 0.1]])
    pivot = np.array([0.1, 0.0, -0.2])
    model.tracks = make_tracks(model.kernels, [motion], model.device)
    model.moving_pins = MovingPins.of([(np.array([0]), 0, rest, pivot)], model.device)
    q, qd = wp.clone(model.particle_q), wp.clone(model.particle_qd)
    drive_pins(model, wp.zeros(1, dtype=wp.float64, device=model.device), t, q, qd)
    assert np.allclose(q.numpy()[0], motion.evaluate(rest, t, pivot)[0], atol=1e-12)
    h = 1e-6
    s = t % 2.0 if loop else t
    if all(abs(s - key) > 2 * h for key in (0.0, 0.7, 2.0)):  # speed jumps at keys
        slope = (motion.evaluate(rest, t + h, pivot) - motion.evaluate(rest, t - h, pivot))[0] / (2 * h)
        assert np.allclose(qd.numpy()[0], slope, atol=1e-6)


def test_pins_hold_and_moving_pins_follow_their_path():
    motion = wc.Motion.keyframes([(0, (0, 0, 0)), (0.5, (0, 0.1, 0.1), (1.0, 0, 0))])
    cloth = sheet(pins=["right", wc.pin("left", motion=motion)])
    sim = wc.Simulation(wc.Model.build(cloth, precision="float64"))
    sim.run(20)
    x = sim.state.particle_q.numpy()
    right, left = cloth.pins[0].indices, cloth.pins[1].indices
    assert np.array_equal(x[right], cloth.points[right])
    assert np.allclose(x[left], motion.evaluate(cloth.points[left], 20 / 60), atol=1e-12)


def test_energies_of_a_falling_sheet():
    sim = wc.Simulation(wc.Model.build(sheet(), precision="float64"), substeps=100)
    before = sim.energy()
    sim.run(30)
    after = sim.energy()
    mass = sim.model.particle_mass.numpy().sum()
    assert mass == pytest.approx(0.4 * 0.4 * 0.2, rel=1e-12)
    assert after["kinetic"] == pytest.approx(0.5 * mass * (9.81 * 0.5) ** 2, rel=1e-9)
    assert after["total"] == pytest.approx(before["total"], abs=0.01 * after["kinetic"])
    assert after["spring"] + after["bending"] < 1e-20


def test_misuse_is_one_sentence():
    model = wc.Model.build(sheet())
    for options in ({"integrator": "simplectic_euler"}, {"substeps": 0}, {"gravity": (0, 1)}, {"substeps": "many"}):
        with pytest.raises(InputError) as error:
            wc.Simulation(model, **options)
        assert "\n" not in str(error.value)
    with pytest.raises(InputError):
        wc.Simulation(model).step(0.0)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: wc.Model.build(None), r"cloths\[0\] must be a warpcloth.Cloth, got NoneType"),
        (lambda: wc.Model.build([sheet(), BALL]), r"cloths\[1\] must be a warpcloth.Cloth, got Sphere"),
        (lambda: wc.Model.build(sheet(), [3]), r"obstacles\[0\] must be an obstacle such as warpcloth.Sphere, got int"),
        (lambda: wc.Model.build(sheet(), differentiable="yes"), "Differentiable must be true or false"),
        (lambda: wc.Model.build_worlds(3), "needs a list of at least one world"),
        (lambda: wc.Model.build_worlds([sheet()]), r"worlds\[0\] must be a pair \(cloths, obstacles\)"),
        (lambda: wc.Model.build_worlds([([sheet()], None)]), r"worlds\[0\]: obstacles\[0\] must be an obstacle"),
        (lambda: wc.Simulation(None), "Model must be a warpcloth.Model, got NoneType"),
        (lambda: wc.Simulation(wc.Model.build(sheet()), check_start="no"), "Check_start must be true or false"),
        (lambda: wc.ContactPlanes(None), "Model must be a warpcloth.Model"),
        (lambda: wc.Sphere((0, 0, 0), 1e13), r"radius must be a number greater than 0 and at most 1e\+12, got 1"),
    ],
)
def test_what_is_of_another_kind_is_refused(make, sentence):
    with pytest.raises(InputError, match=sentence):
        make()


def test_worlds_may_come_one_by_one():
    worlds = [([sheet()], [BALL]), (sheet(), BALL)]
    assert wc.Model.build_worlds(iter(worlds)).world_count == 2


@pytest.mark.parametrize("substeps", [1, 2])
@pytest.mark.parametrize("name", INTEGRATORS)
def test_forces_of_the_latest_evaluation_are_in_the_state(name, substeps):
    cloth = wc.Cloth.grid((0.4, 0.4), (6, 6), wc.library_fabric("denim"))
    model = wc.Model.build(cloth, precision="float64")
    sim = wc.Simulation(model, name, substeps=substeps, contact="none")
    sim.run(2, fps=1e4)  # falling, so that gravity is all there is
    weight = np.outer(model.particle_mass.numpy(), (0.0, 0.0, -9.81))
    np.testing.assert_allclose(sim.state.particle_f.numpy(), weight, atol=1e-6 * np.abs(weight).max())


@pytest.mark.parametrize("name", INTEGRATORS)
def test_springs_that_change_between_frames_are_taken_over(name):
    """Rest lengths, stiffness and limits that are written to in place, as if the simulation were built after that."""
    cloth = wc.Cloth.grid((0.4, 0.4), (6, 6), wc.Fabric(strain_limit=0.02), pins="top")
    ends = []
    for late in (True, False):
        model = wc.Model.build(cloth, precision="float64")
        options = {"integrator_options": INTEGRATORS[name].convergence_options, "contact": "none"}
        sim = wc.Simulation(model, name, substeps=40, **options) if late else None
        if sim is not None:
            sim.step(1 / 60)
            sim.reset()
        model.spring_rest_length.assign(0.97 * model.spring_rest_length.numpy())
        model.spring_stiffness.assign(0.5 * model.spring_stiffness.numpy())
        model.spring_limit_stiffness.assign(2.0 * model.spring_limit_stiffness.numpy())
        sim = sim or wc.Simulation(model, name, substeps=40, **options)
        sim.run(3)
        ends.append(sim.state.particle_q.numpy())
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)


@pytest.mark.parametrize("name", ["xpbd", "vbd", "symplectic_euler"])
def test_single_steps_take_over_springs_that_changed(name):
    ends = []
    for early in (True, False):
        model = wc.Model.build(sheet(5, pins="left"))
        longer = 1.3 * model.spring_rest_length.numpy()
        if early:
            model.spring_rest_length.assign(longer)
        sim = wc.Simulation(model, name, substeps=10)
        model.spring_rest_length.assign(longer)
        for _ in range(5):
            sim.substep(1e-3)
        ends.append(sim.state.particle_q.numpy())
    np.testing.assert_array_equal(*ends)
    for wrong in (-1.0, float("nan"), "a"):
        with pytest.raises(InputError, match=r"^Dt must be"):
            sim.substep(wrong)
        with pytest.raises(InputError, match=r"^Dt must be"):
            sim.substeps_for(wrong)


def test_automatic_substeps_know_what_springs_are_like_when_all_is_reset():
    model = wc.Model.build([wc.Cloth.grid((0.5, 0.5), (5, 5), pins="top_left")])
    sim = wc.Simulation(model, "symplectic_euler")
    sim.step(1.0 / 60.0)
    first = sim.substeps
    model.spring_stiffness.assign(100.0 * model.spring_stiffness.numpy())
    model.spring_damping.assign(100.0 * model.spring_damping.numpy())
    sim.reset()
    sim.run(5)
    assert sim.substeps > 5 * first
    assert sim.metrics()["max_strain"] < 0.1


class Damper(wc.Hook):
    """Takes a part of all velocities, before or after each step."""

    def __init__(self, when: str):
        self.when = when

    def before_step(self, state: wc.State, dt: float) -> None:
        if self.when == "before":
            state.particle_qd.assign(0.99 * state.particle_qd.numpy())

    def after_step(self, start: wc.State, end: wc.State, dt: float) -> None:
        if self.when == "after":
            end.particle_qd.assign(0.99 * end.particle_qd.numpy())


@pytest.mark.parametrize("hooks", [[], [Damper("before")], [Damper("after")]])
@pytest.mark.parametrize("name", ["velocity_verlet", "bogacki_shampine", "dormand_prince"])
def test_a_frame_of_two_substeps_is_two_frames_of_one(name, hooks):
    """Forces at the end of a step serve the next one only where neither contact nor a hook has changed that end."""
    fabric = wc.Fabric(damping_time=0.0 if name == "velocity_verlet" else 1e-3)
    model = wc.Model.build(sheet(6, fabric=fabric, pins="left"), [wc.Sphere((0.0, 0.0, -0.152), 0.15)])
    ends = []
    for substeps in (1, 2):
        sim = wc.Simulation(model, name, substeps=substeps, hooks=hooks, graph=False)
        sim.run(200 // substeps, fps=1000 / substeps)
        ends.append(phase(sim))
    assert np.abs(ends[0] - np.hstack([model.particle_q.numpy(), model.particle_qd.numpy()])).max() > 0.01
    np.testing.assert_array_equal(*ends)


def test_single_steps_see_that_the_caller_moved_the_cloth():
    model = wc.Model.build(sheet(6, fabric=wc.Fabric(damping_time=0.0), pins="left"))
    ends = []
    for late in (True, False):
        sim = wc.Simulation(model, "velocity_verlet", substeps=2)
        if late:
            sim.step(1e-4)
        sim.state.particle_q.assign(1.1 * model.particle_q.numpy())
        sim.state.particle_qd.zero_()
        sim.substep(1e-4)
        ends.append(phase(sim))
    np.testing.assert_array_equal(*ends)
