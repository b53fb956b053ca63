"""Air: terminal velocity, lift, resolution, matrices against finite differences, wind fields, graphs, scenes."""

import warnings

import numpy as np
import pytest
import warp as wp
from warpcloth.scenes import scene_from_toml

import warpcloth as wc
from warpcloth.errors import DivergedError, InputError, SceneError, StabilityWarning
from warpcloth.fabric import STANDARD_GRAVITY
from warpcloth.forces import AirDrag, Forces, Linearization
from warpcloth.load_rates import load_rates, present_rates
from warpcloth.state import State

FABRIC = wc.Fabric(areal_density=0.1, air_drag=1.2, air_friction=0.05)
RHO = 1.225


def sheet(resolution=(5, 4), transform=None, **options) -> wc.Model:
    cloth = wc.Cloth.grid((0.4, 0.3), resolution, FABRIC, transform=transform, **options)
    return wc.Model.build(cloth, precision="float64")


def crumpled(seed: int = 0) -> tuple[wc.Model, State]:
    """A sheet with random positions and velocities."""
    model, rng = sheet(), np.random.default_rng(seed)
    state, shape = State.of(model), (model.particle_count, 3)
    state.particle_q.assign(model.particle_q.numpy() + rng.normal(0.0, 0.02, shape))
    state.particle_qd.assign(rng.normal(0.0, 2.0, shape))
    return model, state


def forces_of(model: wc.Model, air: wc.Air) -> Forces:
    return Forces(model, [AirDrag(model, [air] * model.world_count)], model.array(np.zeros((1, 3)), model.vec3))


def evaluated(forces: Forces, state: State, offset: float = 0.0) -> np.ndarray:
    state.particle_f.fill_(float("nan"))
    forces.evaluate(state, offset)
    return state.particle_f.numpy().copy()


def law_in_numpy(model: wc.Model, state: State, air: wc.Air, t: float) -> np.ndarray:
    """The law of ``kernels/air.py`` and the wind of ``kernels/wind.py``, written down a second time."""
    corners = model.tri_indices.numpy()
    x, v = state.particle_q.numpy()[corners], state.particle_qd.numpy()[corners]
    normal = 0.5 * np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    area = np.linalg.norm(normal, axis=1, keepdims=True)
    share = model.tri_corner_share.numpy()
    n, middle = normal / area, np.einsum("tc,tci->ti", share, x)
    wave, amplitude, rate, phase = air.waves()
    wind = air.wind * (1.0 + air.gust * np.sin(2.0 * np.pi * t / air.gust_period))
    u = wind + np.cos(middle @ wave.T + rate * t + phase) @ amplitude - np.einsum("tc,tci->ti", share, v)
    across = np.sum(u * n, axis=1, keepdims=True) * n
    f = 0.5 * air.density * area * np.linalg.norm(u, axis=1, keepdims=True)
    f = f * (FABRIC.air_drag * across + FABRIC.air_friction * (u - across))
    total = np.zeros((model.particle_count, 3))
    np.add.at(total, corners, share[:, :, None] * f[:, None])
    return total


AIRS = [
    wc.Air(),
    wc.Air(wind=(3.0, -1.0, 0.5), gust=0.4, gust_period=2.0),
    wc.Air(wind=(2.0, 0.0, 0.0), turbulence=1.5, turbulence_length=0.3, seed=7),
]


@pytest.mark.parametrize("air", AIRS)
@pytest.mark.parametrize("t", [0.0, 1000.3])
def test_force_equals_an_independent_evaluation(air, t):
    model, state = crumpled()
    expected = law_in_numpy(model, state, air, t)
    got = evaluated(forces_of(model, air), state, t)
    assert np.linalg.norm(expected) > 0.01
    assert np.abs(got - expected).max() <= 1e-9 * np.abs(expected).max()


def test_turbulence_is_as_exact_in_single_precision_after_days():
    model, t = wc.Model.build(wc.Cloth.grid((0.4, 0.3), (5, 4), FABRIC), precision="float32"), 3e5
    state = State.of(model)
    expected = law_in_numpy(model, state, AIRS[2], t)
    got = evaluated(forces_of(model, AIRS[2]), state, t)
    assert np.abs(got - expected).max() <= 1e-5 * np.abs(expected).max()


def test_uniform_motion_of_sheet_and_air_together_makes_no_force():
    model, state = crumpled()
    state.particle_qd.assign(np.tile((3.0, 1.0, -2.0), (model.particle_count, 1)))
    assert np.abs(evaluated(forces_of(model, wc.Air(wind=(3.0, 1.0, -2.0))), state)).max() < 1e-15


@pytest.mark.parametrize("angle", [0.0, 20.0, 45.0, 90.0])
@pytest.mark.parametrize("resolution", [(2, 2), (9, 5)])
def test_drag_and_lift_of_a_plate_at_any_angle_and_resolution(angle, resolution):
    alpha, speed = np.radians(angle), 4.0
    model = sheet(resolution)
    air = wc.Air(wind=speed * np.array([np.cos(alpha), 0.0, np.sin(alpha)]))
    total = evaluated(forces_of(model, air), State.of(model)).sum(axis=0)
    pressure = 0.5 * RHO * speed**2 * 0.12
    lift_direction = np.array([-np.sin(alpha), 0.0, np.cos(alpha)])
    drag = 1.2 * np.sin(alpha) ** 2 + 0.05 * np.cos(alpha) ** 2
    lift = (1.2 - 0.05) * np.sin(alpha) * np.cos(alpha)
    assert total @ (air.wind / speed) == pytest.approx(pressure * drag, rel=1e-12)
    assert total @ lift_direction == pytest.approx(pressure * lift, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("integrator", ["symplectic_euler", "implicit_midpoint", "xpbd"])
def test_falling_sheet_reaches_its_terminal_velocity(integrator):
    """v = v∞ tanh(g t/v∞), v∞ = √(2 σ g/(ρ C_n)); the slip of a first-order scheme is below g dt."""
    cloth = wc.Cloth.grid((0.2, 0.2), (3, 3), FABRIC)
    dt, substeps = 0.02, 20
    simulation = wc.Simulation(
        wc.Model.build(cloth, precision="float64"), integrator, substeps=substeps, contact="none", air=wc.Air()
    )
    limit = np.sqrt(2.0 * 0.1 * 9.81 / (RHO * 1.2))
    for _ in range(50):
        simulation.step(dt)
        speed = -simulation.state.particle_qd.numpy()[:, 2]
        exact = limit * np.tanh(9.81 * simulation.time / limit)
        assert np.abs(speed - exact).max() < 9.81 * dt / substeps
    assert speed == pytest.approx(limit, rel=1e-5)


def matrix(forces: Forces, state: State, project: float, offset: float = 0.0) -> np.ndarray:
    model, n = forces.model, 3 * forces.model.particle_count
    at = Linearization(state, 0.0, 1.0, model.array([project], model.real), offset)
    columns = []
    for unit in np.eye(n):
        out = wp.zeros_like(model.particle_q)
        forces.hessian_product(at, model.array(unit.reshape(-1, 3), model.vec3), out)
        columns.append(out.numpy().reshape(-1))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize(("air", "offset"), [(AIRS[1], 0.5), (AIRS[2], 0.0)])
def test_damping_is_the_symmetric_part_of_the_slope_and_can_be_made_semidefinite(air, offset):
    """Also at a stage within a step, when gusts are stronger than at its start."""
    model, state = crumpled(3)
    forces = forces_of(model, air)
    middle, h, columns = state.particle_qd.numpy().copy(), 1e-6, []
    for unit in np.eye(middle.size):
        ends = []
        for sign in (1.0, -1.0):
            state.particle_qd.assign(middle + sign * h * unit.reshape(-1, 3))
            ends.append(evaluated(forces, state, offset).reshape(-1))
        columns.append((ends[0] - ends[1]) / (2.0 * h))
    state.particle_qd.assign(middle)
    slope = -np.stack(columns, axis=1)
    assert np.linalg.norm(slope - slope.T) > 1e-3 * np.linalg.norm(slope)
    got = matrix(forces, state, 0.0, offset)
    assert np.abs(got - 0.5 * (slope + slope.T)).max() <= 1e-6 * np.abs(slope).max()
    projected = matrix(forces, state, 1.0, offset)
    assert np.abs(projected - projected.T).max() <= 1e-14 * np.abs(projected).max()
    assert np.linalg.eigvalsh(projected).min() > -1e-13 * np.abs(projected).max()


def test_diagonal_blocks_are_those_of_the_matrix():
    model, state = crumpled(4)
    forces = forces_of(model, AIRS[1])
    blocks = wp.zeros(model.particle_count, dtype=model.kernels.precision.mat33)
    forces.hessian_diagonal(Linearization(state, 0.0, 1.0, model.array([0.0], model.real), 0.5), blocks)
    whole = matrix(forces, state, 0.0, 0.5).reshape(model.particle_count, 3, model.particle_count, 3)
    expected = np.stack([whole[i, :, i] for i in range(model.particle_count)])
    assert np.linalg.norm(expected) > 1e-3
    assert np.abs(blocks.numpy() - expected).max() <= 1e-13 * np.abs(expected).max()


def test_turbulence_has_its_strength_is_free_of_divergence_and_repeats_with_its_seed():
    air = wc.Air(turbulence=2.0, seed=1)
    wave, amplitude, _, _ = air.waves()
    assert np.abs(np.sum(wave * amplitude, axis=1)).max() < 1e-12
    assert np.sum(amplitude**2) / 2.0 == pytest.approx(3.0 * 2.0**2, rel=1e-12)
    again, other = wc.Air(turbulence=2.0, seed=1).waves(), wc.Air(turbulence=2.0, seed=2).waves()
    assert all(np.array_equal(a, b) for a, b in zip(air.waves(), again, strict=True))
    assert not np.array_equal(wave, other[0])


def test_captured_frames_equal_plain_ones():
    results = []
    for graph in (True, False):
        simulation = wc.Simulation(sheet(), substeps=20, contact="none", air=AIRS[2], graph=graph)
        simulation.run(6)
        results.append(simulation.state.particle_q.numpy())
    assert np.array_equal(*results)


def test_every_world_has_its_own_air():
    cloths = [wc.Cloth.grid((0.4, 0.3), (4, 3), FABRIC)]
    model = wc.Model.build_worlds([(cloths, []) for _ in AIRS], precision="float64")
    together = wc.Simulation(model, substeps=20, contact="none", air=AIRS)
    together.run(3)
    worlds = np.split(together.state.particle_q.numpy(), len(AIRS))
    for air, expected in zip(AIRS, worlds, strict=True):
        alone = wc.Simulation(wc.Model.build(cloths, precision="float64"), substeps=20, contact="none", air=air)
        alone.run(3)
        assert np.array_equal(alone.state.particle_q.numpy(), expected)
    with pytest.raises(InputError, match="once or for each of the 3 worlds, got 2"):
        wc.Simulation(model, air=AIRS[:2])


def test_sliver_makes_no_nan():
    model = sheet((2, 2))
    state = State.of(model)
    state.particle_q.zero_()
    assert np.array_equal(evaluated(forces_of(model, AIRS[1]), state), np.zeros((4, 3)))


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: wc.Air(density=-1.0), "Air: density must be a number of at least 0"),
        (lambda: wc.Air(wind=(1.0, 2.0)), "Air: wind must be 3 numbers"),
        (lambda: wc.Air(gust_period=0.0), "Air: gust_period must be a number greater than 0"),
        (lambda: wc.Air(seed=0.5), "Air: seed must be a whole number"),
        (lambda: wc.Simulation(sheet((2, 2)), air="windy"), "Air must be an Air, one for each world, or None, got str"),
    ],
)
def test_bad_input_is_one_sentence(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value).startswith(sentence)


def test_scene_has_air_unless_it_is_a_vacuum():
    cloth = '[[cloth]]\nshape = "grid"\n'
    assert scene_from_toml(cloth).air.build(3).density == RHO
    windy = scene_from_toml("[air]\nwind = [5, 0, 0]\nturbulence = 1.0\n" + cloth).air.build(3)
    assert (windy.wind.tolist(), windy.turbulence, windy.seed) == ([5.0, 0.0, 0.0], 1.0, 3)
    with pytest.raises(SceneError, match=r"air.density must be a number from 0 to 10,000 kg/m³, not -1"):
        scene_from_toml("[air]\ndensity = -1\n" + cloth)


@pytest.mark.parametrize(
    ("air", "sentence"),
    [
        ("gust = 0.5", "air must have a wind for its gust"),
        ("gust = 0.5\nturbulence = 1.0", "air must have a wind for its gust"),
        ("density = 0\nwind = [1, 0, 0]", "air must have a density above 0 for its wind"),
        ("density = 0\nturbulence = 1.0", "air must have a density above 0 for its wind"),
    ],
)
def test_scenes_have_no_wind_that_would_do_nothing(air, sentence):
    with pytest.raises(SceneError, match=sentence):
        scene_from_toml(f'[air]\n{air}\n[[cloth]]\nshape = "grid"\n')


@pytest.mark.parametrize("name", ["xpbd", "symplectic_euler", "velocity_verlet", "rk4"])
def test_automatic_steps_know_how_dense_the_air_is(name):
    """In water, which would throw cloth about within steps that its springs allow."""
    model = wc.Model.build(wc.Cloth.grid((0.4, 0.4), (9, 9), pins="top"))
    sim = wc.Simulation(model, name, air=wc.Air(density=1000.0, wind=(0.0, 0.0, 0.5)))
    sim.run(20)
    assert sim.metrics()["max_speed"] < 1.0
    assert sim.metrics()["max_strain"] < 0.05
    assert load_rates(model, [wc.Air()])[1] < 0.01 * load_rates(model, [wc.Air(density=1000.0, wind=(0, 0, 20))])[1]


def test_the_rate_of_the_air_is_the_slope_of_its_force():
    """A sheet that falls flat: 2 C_n ½ ρ A |u|/m at the speed of the wind, on every particle alike."""
    fabric = wc.Fabric(areal_density=0.2)
    model = wc.Model.build(wc.Cloth.grid((0.4, 0.4), (9, 9), fabric), precision="float64")
    fall = np.sqrt(2.0 * STANDARD_GRAVITY * 0.4)
    expected = 1.2 * (10.0 + fall) * float(model.tri_air_drag.numpy().max()) / 0.2
    assert load_rates(model, [wc.Air(density=1.2, wind=(0.0, 0.0, 10.0))])[1] == pytest.approx(expected, rel=1e-6)


STORM = {"density": 1.2, "wind": (0.0, 0.0, 10.0)}


@pytest.mark.parametrize(
    ("air", "falling", "relative"),
    [
        (wc.Air(**STORM, gust=0.5), 0.0, 15.0),
        (wc.Air(density=1.2, turbulence=2.0), 0.0, 6.0),
        (wc.Air(**STORM), 4.0, 10.0),
    ],
    ids=("gust", "turbulence", "speed"),
)
@pytest.mark.parametrize("fabric", [wc.Fabric(air_friction=0.0), wc.Fabric(air_drag=0.0, air_friction=0.7)])
def test_the_rate_of_the_air_is_that_of_all_that_may_come(air, falling, relative, fabric):
    """Gusts at their strongest, three times the turbulence, the speed at the start; drag or friction, the greater."""
    cloth = wc.Cloth.grid((0.4, 0.4), (9, 9), fabric, velocity=(0.0, 0.0, -falling))
    relative += np.sqrt(falling**2 + 2.0 * STANDARD_GRAVITY * 0.4)
    expected = 1.2 * relative * max(fabric.air_drag, fabric.air_friction) / fabric.areal_density
    assert load_rates(wc.Model.build(cloth, precision="float64"), [air])[1] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("storm", [0, 1])
def test_rates_of_the_air_are_those_of_the_worst_world(storm):
    cloth = wc.Cloth.grid((0.4, 0.4), (5, 5))
    both = wc.Model.build_worlds([([cloth], []), ([cloth], [])], precision="float64")
    for air in (wc.Air(**STORM), wc.Air(density=100.0, wind=(0.0, 0.0, 1.0))):
        airs = [wc.Air(density=1.0, wind=(0.0, 0.0, 1.0))] * 2
        airs[storm] = air
        alone = wc.Model.build(cloth, precision="float64")
        assert load_rates(both, airs)[1] == pytest.approx(load_rates(alone, [air])[1], rel=1e-12)
        rates = [
            present_rates(model, model_airs, model.particle_q.numpy(), np.zeros((model.particle_count, 3)))[1]
            for model, model_airs in ((both, airs), (alone, [air]))
        ]
        assert rates[0] == pytest.approx(rates[1], rel=0.02)  # found from below


def test_what_is_warned_of_is_drag_at_the_present_speed():
    """C_n ½ ρ A |u|/m slows a sheet as a whole across itself, and none of its motions faster; found from below."""
    fabric = wc.Fabric(areal_density=0.2)
    model = wc.Model.build(wc.Cloth.grid((0.4, 0.4), (9, 9), fabric), precision="float64")
    x, v = model.particle_q.numpy(), np.tile((0.0, 0.0, -3.0), (81, 1))
    drag = float(model.tri_air_drag.numpy().max())
    expected = 0.5 * 1.2 * 10.0 * drag / 0.2
    _, rate = present_rates(model, [wc.Air(density=1.2, wind=(0.0, 0.0, 7.0))], x, v)
    assert 0.98 * expected < rate < (1.0 + 1e-9) * expected
    assert rate < load_rates(model, [wc.Air(density=1.2, wind=(0.0, 0.0, 10.0))])[1]
    assert present_rates(model, [wc.Air(density=0.0)], x, v) == present_rates(model, [], x, v) == (0.0, 0.0)


@pytest.mark.parametrize("name", ["xpbd", "symplectic_euler", "rk4"])
def test_too_few_substeps_for_dense_air_are_warned_of(name):
    """Cloth that water runs against, in steps that its springs allow."""
    model = wc.Model.build(wc.Cloth.grid((0.4, 0.4), (9, 9), pins="top"))
    air = wc.Air(density=1000.0, wind=(0.0, 0.0, 2.0))
    with pytest.warns(StabilityWarning, match="is unstable with 32 substeps"), pytest.raises(DivergedError):
        wc.Simulation(model, name, air=air, substeps=32).run(20)
    with warnings.catch_warnings():
        warnings.simplefilter("error", StabilityWarning)
        sim = wc.Simulation(model, name, air=air, substeps=64)
        sim.run(20)
    assert sim.metrics()["max_strain"] < 0.1
