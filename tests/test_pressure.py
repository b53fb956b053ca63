"""Pressure in closed cloth: gradient of its energy, balance, Laplace's law of a balloon, Boyle's law, input."""

import warnings

import numpy as np
import pytest
import trimesh
import warp as wp
from warpcloth.scenes import scene_from_toml

import warpcloth as wc
from warpcloth.errors import DivergedError, InputError, StabilityWarning
from warpcloth.forces import Forces, Linearization, Pressure
from warpcloth.load_rates import breathing_modes, load_rates, present_rates
from warpcloth.state import State

KINDS = [wc.Inflation(200.0), wc.Inflation(500.0, gas=True, ambient=2000.0)]


def bag(inflation: wc.Inflation, subdivisions: int = 1, inward: bool = False) -> wc.Cloth:
    ball = trimesh.creation.icosphere(subdivisions, 0.1)
    if inward:
        ball.invert()
    fabric = wc.Fabric(areal_density=0.2, shear_stiffness=150.0, bend_stiffness=0.0, damping_time=2e-3)
    return wc.Cloth.from_mesh(ball, fabric, inflation=inflation)


def crumpled(inflation: wc.Inflation, inward: bool = False) -> tuple[Forces, State]:
    beside = wc.Cloth.grid((0.1, 0.1), (3, 3), transform=(1.0, 0.0, 0.0), name="open")
    model = wc.Model.build([beside, bag(inflation, inward=inward)], precision="float64")
    state = State.of(model)
    state.particle_q.assign(state.particle_q.numpy() + np.random.default_rng(0).normal(0.0, 0.01, (51, 3)))
    return Forces(model, [Pressure(model)], model.array(np.zeros((1, 3)), model.vec3)), state


def evaluated(forces: Forces, state: State) -> np.ndarray:
    state.particle_f.fill_(float("nan"))
    forces.evaluate(state)
    return state.particle_f.numpy().copy()


@pytest.mark.parametrize("inward", [False, True])
@pytest.mark.parametrize("inflation", KINDS)
def test_force_is_the_slope_of_the_energy_and_balanced(inflation, inward):
    forces, state = crumpled(inflation, inward)
    f, middle, h = evaluated(forces, state), state.particle_q.numpy().copy(), 1e-5
    assert np.array_equal(f[:9], np.zeros((9, 3)))  # the open cloth
    assert np.linalg.norm(f) > 0.1
    for x in np.random.default_rng(1).normal(size=(5, *f.shape)):
        energies = []
        for sign in (1.0, -1.0):
            state.particle_q.assign(middle + sign * h * x)
            energies.append(forces.energy(state)["pressure"])
        assert -np.sum(f * x) == pytest.approx((energies[0] - energies[1]) / (2.0 * h), rel=1e-6)
    scale = np.abs(f).sum()
    assert np.abs(f.sum(axis=0)).max() <= 1e-13 * scale
    assert np.abs(np.cross(middle, f).sum(axis=0)).max() <= 1e-13 * scale


@pytest.mark.parametrize("inward", [False, True])
def test_a_gas_pushes_out_even_where_it_has_been_turned_inside_out(inward):
    forces, state = crumpled(KINDS[1], inward)
    mirrored = state.particle_q.numpy()
    mirrored[9:] *= -1.0
    grows = evaluated(crumpled(wc.Inflation(1.0), inward)[0], state)  # of 1 Pa: the slope of the volume
    state.particle_q.assign(mirrored)
    assert np.sum(evaluated(forces, state) * grows) > 0.0
    assert np.isfinite(forces.energy(state)["pressure"])


def test_matrix_of_a_gas_is_its_resistance_to_changes_of_volume():
    forces, state = crumpled(KINDS[1])
    model, rng = forces.model, np.random.default_rng(2)
    at = Linearization(state, 2.0, 0.0, model.array([1.0], model.real))
    gradient = evaluated(crumpled(wc.Inflation(1.0))[0], state)
    volume = np.einsum("ni,ni->", state.particle_q.numpy(), gradient) / 3.0
    rest = model.bags["volume"][0]
    x, out = rng.normal(size=gradient.shape), wp.zeros_like(model.particle_q)
    forces.hessian_product(at, model.array(x, model.vec3), out)
    stiffness = 2.0 * 2500.0 * rest / volume**2
    expected = stiffness * np.sum(gradient * x) * gradient
    assert np.abs(out.numpy() - expected).max() <= 1e-10 * np.abs(expected).max()
    blocks = wp.zeros(model.particle_count, dtype=model.kernels.precision.mat33)
    forces.hessian_diagonal(at, blocks)
    expected = stiffness * np.einsum("ni,nj->nij", gradient, gradient)
    assert np.abs(blocks.numpy() - expected).max() <= 1e-10 * np.abs(expected).max()


@pytest.mark.parametrize("inward", [False, True])
def test_balloon_grows_as_laplace_says(inward):
    """Tension p R/2 strains a membrane with ν = 1/3 by p R (1 − ν)/(2 Y): 0.83 %, up to 1 % of that for the mesh."""
    model = wc.Model.build(bag(wc.Inflation(100.0), 2, inward), precision="float64")
    simulation = wc.Simulation(model, "implicit_euler", gravity=(0, 0, 0), substeps=4, contact="none")
    simulation.run(8, 60.0)
    radius = np.linalg.norm(simulation.state.particle_q.numpy(), axis=1)
    strain = radius.mean() / 0.1 - 1.0
    assert strain == pytest.approx(100.0 * 0.1 * (1.0 + strain) ** 2 * (2.0 / 3.0) / (2.0 * 400.0), rel=0.05)


@pytest.mark.parametrize("integrator", ["symplectic_euler", "implicit_euler", "xpbd"])
def test_gas_obeys_boyle_and_every_kind_of_scheme_has_it(integrator):
    """A bag with 1 kPa too much swells until the gas holds the membrane: p V = const against the energy's slope."""
    cloth = bag(wc.Inflation(1000.0, gas=True, ambient=20000.0), 1)
    simulation = wc.Simulation(
        wc.Model.build(cloth, precision="float64"), integrator, gravity=(0, 0, 0), substeps=100, contact="none"
    )
    simulation.run(20, 60.0)
    q = simulation.state.particle_q.numpy()
    a, b, c = (q[cloth.triangles[:, i]] for i in range(3))
    ratio = np.einsum("ti,ti->", a, np.cross(b, c)) / 6.0 / simulation.model.bags["volume"][0]
    pressure = 21000.0 / ratio - 20000.0
    strain = np.linalg.norm(q, axis=1).mean() / 0.1 - 1.0
    assert ratio > 1.02
    assert strain == pytest.approx(pressure * 0.1 * (1.0 + strain) ** 2 * (2.0 / 3.0) / (2.0 * 400.0), rel=0.1)


def test_captured_frames_equal_plain_ones():
    results = []
    for graph in (True, False):
        simulation = wc.Simulation(wc.Model.build(bag(KINDS[1])), substeps=100, contact="none", graph=graph)
        simulation.run(5)
        results.append(simulation.state.particle_q.numpy())
    assert np.array_equal(*results)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: wc.Inflation(float("nan")), "Inflation: pressure must be a finite number"),
        (lambda: wc.Inflation(-2e5, gas=True), "Inflation: pressure must be a number of at least -101325"),
        (lambda: wc.Inflation(1.0, ambient=0.0), "Inflation: ambient must be a number greater than 0"),
        (
            lambda: wc.Cloth.from_mesh(trimesh.creation.icosphere(1).submesh([range(20)])[0], inflation=KINDS[0]),
            "inflation needs a closed surface, and this one has",
        ),
    ],
)
def test_bad_input_is_one_sentence(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert sentence in str(caught.value)


def test_scene_inflates_a_mesh(tmp_path):
    trimesh.creation.icosphere(1, 0.1).export(tmp_path / "ball.ply")
    text = '[[cloth]]\nshape = "mesh"\npath = "ball.ply"\ninflation = { pressure = 300, gas = true }'
    (cloth,), _ = scene_from_toml(text, folder=tmp_path).build()
    assert cloth.inflation == wc.Inflation(300.0, gas=True)


LIGHT = wc.Fabric(areal_density=0.05, stretch_stiffness=30.0, shear_stiffness=10.0, bend_stiffness=0.5)


@pytest.mark.filterwarnings("ignore::warpcloth.errors.FabricWarning")
@pytest.mark.parametrize("gas", [True, False])
@pytest.mark.parametrize("name", ["xpbd", "vbd", "symplectic_euler", "rk4"])
def test_automatic_steps_know_how_stiff_a_gas_is_and_what_it_lifts(name, gas):
    """A ball of 162 vertices: springs alone would allow 5 to 31 substeps, with which it burst in two frames."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.15)
    inflation = wc.Inflation(pressure=5.0, gas=gas)
    sim = wc.Simulation(wc.Model.build(wc.Cloth.from_mesh(ball, LIGHT, inflation=inflation)), name, (0, 0, 0))
    sim.run(40)
    assert sim.metrics()["max_strain"] < 0.03
    assert 40 < sim.substeps < 150 if gas else 5 < sim.substeps < 60


@pytest.mark.parametrize("name", ["forward_euler", "midpoint"])
def test_automatic_steps_know_how_little_damps_a_gas_that_breathes(name):
    """Schemes that need damping took that of the fastest yarns for granted: with 98 and 58 substeps the ball burst."""
    fabric = wc.Fabric(stretch_stiffness=100.0, shear_stiffness=20.0, bend_stiffness=0.0, damping_time=1e-3)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    cloth = wc.Cloth.from_mesh(ball, fabric, springs="woven", inflation=wc.Inflation(100.0, gas=True))
    sim = wc.Simulation(wc.Model.build(cloth), name, (0, 0, 0))
    sim.run(3)
    assert sim.metrics()["max_strain"] < 0.1
    assert sim.substeps < 5000


def test_the_rate_of_a_gas_is_that_of_its_breathing():
    """A ball that breathes: ω² = (p_a + p₀) A²/(V₀ m) of a thin shell, its springs next to nothing."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.2)
    inflation = wc.Inflation(pressure=0.0, gas=True)
    model = wc.Model.build(wc.Cloth.from_mesh(ball, LIGHT, springs="woven", inflation=inflation), precision="float64")
    ambient, mass = model.bags["ambient"][0], model.particle_mass.numpy().sum()
    stiff, damped = load_rates(model)
    assert stiff == pytest.approx(ambient * ball.area**2 / (ball.volume * mass), rel=0.02)
    assert damped == 0.0


@pytest.mark.parametrize("inward", [False, True])
def test_each_gas_breathes_by_itself(inward):
    """M^(−1/2) K M^(−1/2) has the rate of each gas for its eigenvalue, K as the force term multiplies by it."""
    kinds = [wc.Inflation(500.0, gas=True, ambient=2000.0), wc.Inflation(200.0), wc.Inflation(300.0, gas=True)]
    beside = [wc.Cloth.grid((0.1, 0.1), (3, 3), transform=(1.0, 0.0, 0.0)), *(bag(k, inward=inward) for k in kinds)]
    model = wc.Model.build_worlds([([cloth], []) for cloth in beside], precision="float64")
    forces = Forces(model, [Pressure(model)], model.array(np.zeros((4, 3)), model.vec3))
    at = Linearization(State.of(model), 1.0, 0.0, model.array(np.ones(4), model.real))
    root, modes = np.sqrt(model.particle_inv_mass.numpy())[:, None], breathing_modes(model)
    for (rate, mode), world in zip(modes, (1, 3), strict=True):
        assert set(model.particle_world.numpy()[np.abs(mode).max(axis=1) > 0.0]) == {world}
        out = wp.zeros_like(model.particle_q)
        forces.hessian_product(at, model.array(root * mode, model.vec3), out)
        np.testing.assert_allclose(root * out.numpy(), rate * mode, atol=1e-9 * rate * np.abs(mode).max())
    present = present_rates(model, (), model.particle_q.numpy(), np.zeros((model.particle_count, 3)))[0]
    assert present == pytest.approx(max(rate for rate, _ in modes), rel=1e-9)


def test_rates_of_given_pressures_do_not_depend_on_their_sign():
    rates = []
    for pressure in (50.0, -50.0):
        model = wc.Model.build(bag(wc.Inflation(pressure)), precision="float64")
        rates.append(load_rates(model)[0])
    assert rates[0] == rates[1] > 0.0


def test_the_rate_of_a_gas_pressed_flat_is_finite():
    model = wc.Model.build(bag(KINDS[1]), precision="float64")
    flat = model.particle_q.numpy() * [1.0, 1.0, 0.0]
    rate = present_rates(model, (), flat, np.zeros_like(flat))[0]
    assert 1e3 * load_rates(model)[0] < rate < np.inf


def test_the_rate_of_a_gas_falls_as_it_expands():
    """With the pose: −∂p/∂V as 1/V², |∇V|² as the fourth power of the size; a given pressure has none."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.2)
    rates, bounds = [], []
    for gas in (True, False):
        cloth = wc.Cloth.from_mesh(ball, LIGHT, inflation=wc.Inflation(50.0, gas=gas))
        model = wc.Model.build(cloth, precision="float64")
        x = model.particle_q.numpy()
        rates.append([present_rates(model, (), size * x, np.zeros_like(x)) for size in (1.0, 2.0)])
        bounds.append(load_rates(model)[0])
    (small, large), given = rates
    assert 0.0 < small[0] < bounds[0] < 1.1 * small[0]
    assert large[0] == pytest.approx(small[0] / 4.0)
    assert given == [(0.0, 0.0)] * 2


@pytest.mark.filterwarnings("ignore::warpcloth.errors.FabricWarning")
@pytest.mark.parametrize(("name", "few", "enough"), [("xpbd", 32, 64), ("forward_euler", 128, None), ("rk4", 32, 64)])
def test_too_few_substeps_for_a_gas_are_warned_of(name, few, enough):
    """A ball of 162 vertices; its springs alone say nothing about 32 substeps of XPBD."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.15)
    cloth = wc.Cloth.from_mesh(ball, LIGHT, inflation=wc.Inflation(pressure=5.0, gas=True))
    with pytest.warns(StabilityWarning, match=f"{name} is unstable with {few} substeps"), pytest.raises(DivergedError):
        wc.Simulation(wc.Model.build(cloth), name, (0, 0, 0), few).run(20)
    if enough is not None:
        sim = wc.Simulation(wc.Model.build(cloth), name, (0, 0, 0), enough)
        with warnings.catch_warnings():
            warnings.simplefilter("error", StabilityWarning)
            sim.run(20)
        assert sim.metrics()["max_strain"] < 0.03


def test_the_rate_of_a_given_pressure_bounds_how_its_forces_turn():
    """Against the slope of the forces by differences: no less than its largest eigenvalue, and not many times more."""
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.2)
    model = wc.Model.build(wc.Cloth.from_mesh(ball, LIGHT, springs="woven", inflation=wc.Inflation(50.0)),
                           precision="float64")  # fmt: skip
    state, term, h = State.of(model), Pressure(model), 1e-6
    forces = Forces(model, [term], model.array(np.zeros((1, 3)), model.vec3))
    x, columns = state.particle_q.numpy().ravel(), []
    for k in range(len(x)):
        ends = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[k] += sign * h
            state.particle_q.assign(moved.reshape(-1, 3))
            forces.evaluate(state)
            ends.append(state.particle_f.numpy().ravel().copy())
        columns.append((ends[0] - ends[1]) / (2.0 * h))
    root = np.sqrt(np.repeat(model.particle_mass.numpy(), 3))
    fastest = np.abs(np.linalg.eigvals(np.array(columns) / np.outer(root, root))).max()
    assert fastest < load_rates(model)[0] < 6.0 * fastest


@pytest.mark.parametrize(
    ("name", "options"),
    [("xpbd", {}), ("pbd", {}), ("projective_dynamics", {"warm_start": 0.0}), ("vbd", {"warm_start": 0.0})],
)
def test_an_inflated_ball_goes_on_spinning(name, options):
    """Within what implicit Euler takes from it by itself; pressure that did not turn with the ball stopped it."""
    model = wc.Model.build(bag(wc.Inflation(50.0)), precision="float64")
    q, mass = model.particle_q.numpy(), model.particle_mass.numpy()[:, None]
    model.particle_qd.assign(np.cross([0.0, 0.0, 10.0], q))
    sim = wc.Simulation(model, name, (0.0, 0.0, 0.0), 40, integrator_options=options)
    moments = []
    for _ in range(2):
        q, v = sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()
        moments.append(np.cross(q, mass * v).sum(axis=0)[2])
        sim.run(15)
    assert 0.94 * moments[0] < moments[1] < 1.02 * moments[0]
