"""Woven triangles: the same sheet on any mesh, derivatives, invariances, schemes against each other."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
import warp as wp
from gradient_checks import RandomLoss, assert_slopes_agree
from test_hessians import dense_matrix, force_slope, linearization, product
from test_mesh_fit import irregular

import warpcloth as wc
from warpcloth.cloth import BEND
from warpcloth.cloth.sheet import sheet_tensor
from warpcloth.diagnostics import every_strain, measure
from warpcloth.errors import InputError
from warpcloth.forces import ASSEMBLIES, Forces, Woven
from warpcloth.gradients import Rollout
from warpcloth.lab import Setup, shear, tensile
from warpcloth.stability import fastest_rates, largest_stable_step
from warpcloth.state import State

FABRIC = wc.Fabric(stretch_stiffness=4000.0, stretch_stiffness_weft=3000.0, shear_stiffness=50.0, bend_stiffness=0.0)
LIMITED = wc.Fabric(
    stretch_stiffness=400.0, stretch_stiffness_weft=300.0, shear_stiffness=60.0, bend_stiffness=0.0,
    damping_time=0.0, strain_limit=0.05, limit_stiffness=900.0,
)  # fmt: skip
LIMITED_DAMPED = replace(LIMITED, damping_time=2e-3)


def sheet(fabric: wc.Fabric = FABRIC, cells: int = 7, **options) -> wc.Cloth:
    return wc.Cloth.from_mesh(irregular(cells), fabric, springs="woven", **options)


def crumpled(fabric: wc.Fabric = LIMITED, seed: int = 0, **options) -> tuple[wc.Model, State]:
    """Every triangle strained at random, by more and by less than the limit, and moving."""
    model = wc.Model.build(sheet(fabric, 4), **{"precision": "float64", **options})
    rng, state = np.random.default_rng(seed), State.of(model)
    state.particle_q.assign(model.particle_q.numpy() + rng.normal(size=(model.particle_count, 3)) * 0.03)
    state.particle_qd.assign(rng.normal(size=(model.particle_count, 3)))
    return model, state


def forces_of(model: wc.Model, assembly: str = "scatter") -> Forces:
    return Forces(model, [Woven(model, assembly)], model.array(np.zeros((1, 3)), model.vec3))


def test_patch_of_any_triangles_is_the_sheet():
    """Under uniform strain no force inside, and the energy of the continuum to round-off, at finite strain too."""
    cloth, f = sheet(), np.array([[1.02, 0.015], [0.03, 0.97]])
    model = wc.Model.build(cloth, precision="float64")
    state, forces = State.of(model), forces_of(model)
    state.particle_q.assign(np.column_stack([cloth.points[:, :2] @ f.T, cloth.points[:, 2]]))
    forces.evaluate(state)
    got = state.particle_f.numpy()
    x, y = cloth.points[:, 0], cloth.points[:, 1]
    border = (x < 1e-9) | (x > 1.0 - 1e-9) | (y < 1e-9) | (y > y.max() - 1e-9)
    assert (~border).sum() > 10
    assert np.linalg.norm(got[border]) > 1.0
    assert np.abs(got[~border]).max() <= 1e-12 * np.abs(got).max()
    c_x, c_y = sheet_tensor(FABRIC.stretch, 50.0)
    directions = np.array([[1, 0], [0, 1], [0.5**0.5, 0.5**0.5], [0.5**0.5, -(0.5**0.5)]])
    strains = np.linalg.norm(directions @ f.T, axis=1) - 1.0
    expected = 0.5 * cloth.area * np.sum(np.array([c_x - 50.0, c_y - 50.0, 100.0, 100.0]) * strains**2)
    assert forces.energy(state)["spring"] == pytest.approx(expected, rel=1e-12)
    measures = measure(model, state, 0.0)
    assert measures["max_strain"] == pytest.approx(np.abs(strains[:2]).max(), rel=1e-12)
    assert measures["mean_strain"] == pytest.approx(np.abs(strains[:2]).mean(), rel=1e-12)


def test_small_strains_have_the_moduli_put_in():
    """Y along warp and weft, G, and ν = G/C, from the energy's second derivatives."""
    cloth = sheet()
    model = wc.Model.build(cloth, precision="float64")
    forces, h = forces_of(model), 1e-5

    def density(xx: float, yy: float, xy: float) -> float:
        state = State.of(model)
        f = np.array([[1.0 + xx, 0.5 * xy], [0.5 * xy, 1.0 + yy]])
        state.particle_q.assign(np.column_stack([cloth.points[:, :2] @ f.T, cloth.points[:, 2]]))
        return forces.energy(state)["spring"] / cloth.area

    def component(a: np.ndarray, b: np.ndarray) -> float:
        return (density(*(h * (a + b))) - density(*(h * (a - b)))) / (2.0 * h * h)

    units = np.eye(3)
    compliance = np.linalg.inv([[component(a, b) for b in units] for a in units])
    assert 1.0 / np.diag(compliance) == pytest.approx([4000.0, 3000.0, 50.0], rel=1e-4)
    assert -compliance[0, 1] / compliance[0, 0] == pytest.approx(50.0 / sheet_tensor(FABRIC.stretch, 50.0)[1], rel=1e-3)


@pytest.mark.parametrize("assembly", ASSEMBLIES)
def test_force_is_minus_the_gradient_of_the_energy(assembly):
    model, state = crumpled()
    forces = forces_of(model, assembly)
    middle = state.particle_q.numpy().copy()
    x = np.random.default_rng(1).normal(size=middle.shape)
    values = []
    for sign in (1.0, -1.0):
        state.particle_q.assign(middle + sign * 1e-6 * x)
        values.append(forces.energy(state)["spring"])
    state.particle_q.assign(middle)
    forces.evaluate(state)
    got = state.particle_f.numpy()
    assert np.linalg.norm(got) > 1.0
    assert -np.sum(got * x) == pytest.approx((values[0] - values[1]) / 2e-6, rel=1e-7)
    assert np.abs(got.sum(axis=0)).max() <= 1e-13 * np.abs(got).sum()
    assert np.abs(np.cross(middle, got).sum(axis=0)).max() <= 1e-13 * np.abs(got).sum()


@pytest.mark.parametrize("assembly", ASSEMBLIES)
@pytest.mark.parametrize(("name", "a", "b", "damping"), [("particle_q", 1, 0, 0.0), ("particle_qd", 0, 1, 1e-2)])
def test_products_equal_finite_differences_of_the_force(assembly, name, a, b, damping):
    model, state = crumpled(replace(LIMITED, damping_time=damping))
    forces = forces_of(model, assembly)
    x = np.random.default_rng(2).normal(size=(model.particle_count, 3))
    expected = -force_slope(forces, state, name, x, 1e-7)
    assert np.linalg.norm(expected) > 1.0
    at = replace(linearization(model, a, b), state=state)
    got = product(forces, at, x)
    assert np.abs(got - expected).max() <= 2e-6 * np.abs(expected).max()


def test_stiffness_of_damped_yarns_is_the_slope_at_the_present_tension():
    """Exactly so where no yarn turns, as in cloth that grows evenly: what is left out is from their turning."""
    model, state = crumpled(replace(LIMITED, damping_time=0.3))
    state.particle_qd.assign(2.0 * state.particle_q.numpy())
    forces = forces_of(model)
    x = np.random.default_rng(3).normal(size=(model.particle_count, 3))
    expected = -force_slope(forces, state, "particle_q", x, 1e-7)
    got = product(forces, replace(linearization(model, 1.0, 0.0), state=state), x)
    assert np.abs(got - expected).max() <= 2e-6 * np.abs(expected).max()


def test_projection_leaves_nothing_out_where_all_yarns_are_taut():
    """Beyond their limit, too; its own part of the matrix is semi-definite as it is."""
    model, state = crumpled(LIMITED)
    state.particle_q.assign(1.1 * model.particle_q.numpy())
    assert every_strain(model, state)[0].min() > LIMITED.strain_limit
    x = np.random.default_rng(4).normal(size=(model.particle_count, 3))
    whole, projected = (
        product(forces_of(model), replace(linearization(model, 1.0, 0.0, project), state=state), x)
        for project in (0.0, 1.0)
    )
    assert np.abs(projected - whole).max() <= 1e-13 * np.abs(whole).max()


@pytest.mark.parametrize("project", [0.0, 0.5, 1.0])
def test_diagonal_blocks_are_those_of_the_matrix_however_it_is_projected(project):
    model, state = crumpled(FABRIC)
    at = replace(linearization(model, 0.7, 0.3, project), state=state)
    blocks = wp.zeros(model.particle_count, dtype=model.kernels.precision.mat33)
    forces_of(model).hessian_diagonal(at, blocks)
    whole = dense_matrix(forces_of(model), at).reshape(model.particle_count, 3, model.particle_count, 3)
    expected = np.stack([whole[i, :, i, :] for i in range(model.particle_count)])
    assert np.abs(blocks.numpy() - expected).max() <= 1e-12 * np.abs(expected).max()


def test_diagonal_and_projection():
    model, state = crumpled(FABRIC)
    forces = forces_of(model)
    blocks = wp.zeros(model.particle_count, dtype=model.kernels.precision.mat33)
    at, projected = (replace(linearization(model, 0.7, 0.3, project), state=state) for project in (0.0, 1.0))
    forces.hessian_diagonal(at, blocks)
    matrix = dense_matrix(forces, at)
    whole = matrix.reshape(model.particle_count, 3, model.particle_count, 3)
    expected = np.stack([whole[i, :, i, :] for i in range(model.particle_count)])
    assert np.linalg.norm(expected) > 1.0
    assert np.abs(blocks.numpy() - expected).max() <= 1e-12 * np.abs(expected).max()
    assert np.abs(matrix - matrix.T).max() <= 1e-12 * np.abs(matrix).max()
    assert np.linalg.eigvalsh(matrix).min() < -1e-4 * np.abs(matrix).max()
    assert np.linalg.eigvalsh(dense_matrix(forces, projected)).min() > -1e-12 * np.abs(matrix).max()


def test_turning_the_cloth_turns_the_forces():
    model, state = crumpled()
    forces = forces_of(model)
    forces.evaluate(state)
    before, energy = state.particle_f.numpy().copy(), forces.energy(state)["spring"]
    turn = trimesh.transformations.rotation_matrix(1.1, (1.0, 2.0, -0.5))[:3, :3]
    state.particle_q.assign(state.particle_q.numpy() @ turn.T + np.array([0.3, -0.2, 5.0]))
    state.particle_qd.assign(state.particle_qd.numpy() @ turn.T)
    forces.evaluate(state)
    assert np.linalg.norm(before) > 1.0
    assert np.abs(state.particle_f.numpy() - before @ turn.T).max() <= 1e-12 * np.abs(before).max()
    assert forces.energy(state)["spring"] == pytest.approx(energy, rel=1e-12)


def test_precisions_and_assemblies_agree():
    results = []
    for precision in ("float32", "float64"):
        for assembly in ASSEMBLIES:
            model, state = crumpled(FABRIC, precision=precision)
            forces_of(model, assembly).evaluate(state)
            results.append(state.particle_f.numpy().astype(np.float64))
    for result, tolerance in zip(results, (3e-5, 3e-5, 1e-13), strict=False):
        assert np.abs(result - results[3]).max() <= tolerance * np.abs(results[3]).max()


def test_curved_and_steep_meshes_are_at_rest_and_follow_their_surface():
    """The rest shape has no force, whichever way its triangles face; a grown ball has the energy of the sheet."""
    ball = trimesh.creation.icosphere(2, 0.3)
    cloth = wc.Cloth.from_mesh(ball, FABRIC, springs="woven")
    model = wc.Model.build(cloth, precision="float64")
    state, forces = State.of(model), forces_of(model)
    forces.evaluate(state)
    assert np.abs(state.particle_f.numpy()).max() < 1e-9
    state.particle_q.assign(1.01 * cloth.points)
    c_x, c_y = sheet_tensor(FABRIC.stretch, 50.0)
    assert forces.energy(state)["spring"] == pytest.approx(0.5e-4 * (c_x + c_y + 100.0) * cloth.area, rel=1e-9)


def test_automatic_steps_know_the_yarns():
    """ω is that of the Hessian product at rest; the bound for all directions is above, and steps follow from it."""
    model = wc.Model.build(sheet(), precision="float64")
    forces = forces_of(model)
    matrix = dense_matrix(forces, linearization(model, 1.0, 0.0))
    scale = np.repeat(model.particle_inv_mass.numpy() ** 0.5, 3)
    largest = np.linalg.eigvalsh(scale[:, None] * matrix * scale).max()
    omega, gamma = fastest_rates(model, model.particle_q.numpy())
    assert omega == pytest.approx(np.sqrt(largest), rel=1e-3)
    assert gamma == pytest.approx(FABRIC.damping_time * largest, rel=1e-3)
    assert omega < fastest_rates(model)[0] < 1.5 * omega
    assert fastest_rates(model, without=("woven",)) == (0.0, 0.0)
    limited, free = (wc.Model.build(sheet(f)) for f in (LIMITED, replace(LIMITED, strain_limit=None)))
    assert fastest_rates(limited)[0] > 1.5 * fastest_rates(free)[0]
    assert np.isfinite(largest_stable_step(model, wc.Simulation(model, "vbd").integrator))
    assert np.isinf(largest_stable_step(model, wc.Simulation(model, "xpbd").integrator))


def pulled(fabric: wc.Fabric, speed: float, integrator: str, **options) -> tuple[np.ndarray, float]:
    """Positions after three steps of cloth held at two corners and thrown away from them; its largest strain."""
    model = wc.Model.build(sheet(fabric, 3, pins=[0, 3], velocity=(0.3, speed, 0.0)), precision="float64")
    sim = wc.Simulation(model, integrator, substeps=1, integrator_options=options)
    for _ in range(3):
        sim.step(0.01)
    return sim.state.particle_q.numpy(), sim.metrics()["max_strain"]


@pytest.mark.parametrize(
    ("fabric", "speed", "least"),
    [(FABRIC, 1.0, 0.002), (LIMITED, 6.0, LIMITED.strain_limit), (LIMITED_DAMPED, 6.0, LIMITED.strain_limit)],
)
def test_sweeps_of_xpbd_end_at_the_implicit_step(fabric, speed, least):
    implicit, strain = pulled(fabric, speed, "implicit_euler", tolerance=1e-12)
    swept, _ = pulled(fabric, speed, "xpbd", iterations=3000, warm_start=0.6)
    assert strain > 1.2 * least
    assert np.abs(implicit - pulled(fabric, speed, "xpbd")[0]).max() > 1e-5
    assert np.abs(implicit - swept).max() < 1e-9


def test_one_yarn_of_xpbd_is_implicit_euler():
    """A triangle hung by two corners, with yarns along the weft only, in one sweep."""
    points = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.07, -0.15, 0.0]])
    triangle = trimesh.Trimesh(points, [[0, 2, 1]], process=False)
    cloth = wc.Cloth.from_mesh(triangle, wc.Fabric(bend_stiffness=0.0), pins=[0, 1], springs="woven")
    cloth = replace(cloth, woven=replace(cloth.woven, stiffness=cloth.woven.stiffness * np.array([0.0, 1.0, 0.0])))
    found = []
    for name, options in (("xpbd", {}), ("implicit_euler", {"tolerance": 1e-12})):
        sim = wc.Simulation(
            wc.Model.build(cloth, precision="float64"), name, (0.0, -9.81, 0.0), 1, integrator_options=options
        )
        for _ in range(20):
            sim.step(0.01)
        found.append(sim.state.particle_q.numpy())
    assert np.abs(found[0] - points)[2, 1] > 1e-6
    assert np.abs(found[0] - found[1]).max() < 1e-12


def test_lab_returns_what_was_put_in_on_irregular_meshes():
    """A firm weave, along warp and weft and in shear; a limited sheet bends up where it should."""
    setup = Setup(fabric=wc.library_fabric("cotton"), mesh="irregular", resolution=8)
    assert warp_modulus(setup) == pytest.approx(12000.0, rel=0.002)
    stress, settled = shear.sheared(setup, 0.5)
    assert settled
    assert stress / np.deg2rad(0.5) == pytest.approx(56.0, rel=0.002)
    limited = wc.Fabric(
        stretch_stiffness=400.0, shear_stiffness=20.0, strain_limit=0.01, limit_stiffness=2000.0, bend_stiffness=0.0
    )
    strain, load, _ = tensile.pulled(Setup(fabric=limited, mesh="irregular", resolution=12), limited, 0.02)
    assert strain > 0.015
    assert load == pytest.approx(tensile.load_at(limited, strain), rel=0.01)


def warp_modulus(setup: Setup) -> float:
    strain, load, settled = tensile.pulled(setup, setup.fabric, 0.002)
    assert settled
    return load / strain


@pytest.mark.parametrize("integrator", ["symplectic_euler", "velocity_verlet", "xpbd"])
def test_the_scheme_does_not_change_the_moduli(integrator):
    setup = Setup(fabric=FABRIC, mesh="irregular", resolution=6)
    assert warp_modulus(replace(setup, integrator=integrator)) == pytest.approx(warp_modulus(setup), rel=1e-5)


def test_newton_gets_no_woven_cloth():
    newton = pytest.importorskip("newton")
    from warpcloth.interop.newton import add_cloth

    with pytest.raises(InputError, match="must have springs between its vertices for Newton"):
        add_cloth(newton.ModelBuilder(), sheet())


def test_bend_springs_stand_beside_the_yarns():
    """The tutorials' bend springs join vertices; all else is in the triangles."""
    cloth = sheet(replace(FABRIC, bend_stiffness=4.0))
    assert set(cloth.springs.kinds) == {BEND}
    model = wc.Model.build(cloth, precision="float64")
    assert [len(values) for values in every_strain(model, State.of(model))] == [
        len(cloth.springs) + 4 * len(cloth.triangles)
    ] * 3


@pytest.mark.parametrize("integrator", ["symplectic_euler", "xpbd", "implicit_euler"])
def test_gradients_equal_differences(integrator):
    model = wc.Model.build(sheet(LIMITED, 2, pins=[0]), precision="float64", differentiable=True)
    simulation = wc.Simulation(model, integrator, substeps=20)
    noise = 0.02 * np.random.default_rng(0).normal(size=(model.particle_count, 3))
    simulation.state.particle_q.assign(simulation.state.particle_q.numpy() + noise)
    loss = RandomLoss(Rollout(simulation, 2, observe=[2]))
    assert {"woven_stiffness", "woven_law"} <= set(loss.rollout.gradients)
    zero = tuple(name for name in loss.rollout.gradients if name.startswith("spring"))
    assert_slopes_agree(loss, together=True, zero=zero)


@pytest.mark.parametrize("integrator", ["xpbd", "implicit_euler", "vbd"])
def test_a_world_among_others_is_that_world_alone(integrator):
    """Woven cloth beside a grid and another one; steps are captured as graphs or not."""

    def run(worlds: list[int], graph: bool) -> list[np.ndarray]:
        cloths = [sheet(cells=4 + k, pins=[0]) if k < 2 else wc.Cloth.grid((0.4, 0.4), (5, 5)) for k in worlds]
        model = wc.Model.build_worlds([([cloth], []) for cloth in cloths])
        sim = wc.Simulation(model, integrator, substeps=40, assembly="gather", graph=graph)
        sim.run(3, fps=60)
        return [sim.state.particle_q.numpy()[c.start : c.stop] for c in model.cloths]

    together = run([0, 2, 1], graph=False)
    for k, alone in zip((0, 2, 1), together, strict=True):
        assert np.array_equal(alone, run([k], graph=True)[0])
