"""Bending: elements that are exact on quadratic surfaces, and a law whose energy, forces and matrices agree."""

import dataclasses
import functools

import numpy as np
import pytest
import trimesh
import warp as wp
from test_hessians import dense_matrix, force_slope, linearization, product

import warpcloth as wc
from warpcloth.cloth import BendingElements
from warpcloth.cloth.bending_mesh import mesh_bending
from warpcloth.cloth.bending_sheet import BendingSheet
from warpcloth.errors import InputError
from warpcloth.forces import ASSEMBLIES, Bending, Forces
from warpcloth.integrators import INTEGRATORS
from warpcloth.meshes.trianglemesh import TriangleMesh
from warpcloth.stability import fastest_rates, largest_stable_step
from warpcloth.state import State

B, HYSTERESIS, TAU = 1e-3, 4e-3, 2e-3
STIFF = wc.Fabric(bending_rigidity=B, bend_stiffness=0.0, damping_time=TAU)
SLIPPING = wc.Fabric(bending_rigidity=B, bending_hysteresis=HYSTERESIS, bend_stiffness=0.0, damping_time=0.0)


def ragged(size=1.0, cells=8, jitter=0.25) -> tuple[np.ndarray, np.ndarray]:
    """A flat square whose inner vertices are displaced by up to ``jitter`` cells."""
    cloth = wc.Cloth.grid((size, size), (cells + 1, cells + 1))
    points, cell = cloth.points.copy(), size / cells
    inner = np.abs(points[:, :2]).max(axis=1) < 0.5 * size - 0.1 * cell
    points[inner, :2] += np.random.default_rng(0).uniform(-jitter, jitter, (inner.sum(), 2)) * cell
    return points, cloth.triangles


def arch(fabric: wc.Fabric, radius: float = 0.3) -> wc.Cloth:
    """A ragged sheet at rest on a cylinder around the y axis, turned as a whole."""
    points, triangles = ragged(0.6, 5, 0.15)
    angle = points[:, 0] / radius
    bent = np.column_stack([radius * np.sin(angle), points[:, 1], radius * np.cos(angle)])
    return wc.Cloth.from_mesh(TriangleMesh(bent @ rotation().T, triangles), fabric, name="arch")


def rotation(seed: int = 3) -> np.ndarray:
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return q * np.sign(np.linalg.det(q))


SHAPES = {
    "grid": lambda fabric: wc.Cloth.grid((0.6, 0.5), (6, 5), fabric),
    "disc": lambda fabric: wc.Cloth.disc(0.3, 3, fabric),
    "arch": arch,
    "ball": lambda fabric: wc.Cloth.from_mesh(trimesh.creation.icosphere(subdivisions=1, radius=0.3), fabric),
}


def bent(name: str, fabric: wc.Fabric, amount: float = 0.02) -> tuple[wc.Model, Forces, State, Bending]:
    """A sheet with random displacements and velocities, bending its only force."""
    model = wc.Model.build(SHAPES[name](fabric), precision="float64")
    term = Bending(model)
    forces = Forces(model, [term], model.array(np.zeros((1, 3)), model.vec3))
    state, rng = State.of(model), np.random.default_rng(1)
    state.particle_q.assign(state.particle_q.numpy() + amount * rng.normal(size=(model.particle_count, 3)))
    state.particle_qd.assign(rng.normal(size=(model.particle_count, 3)))
    if term.slips:
        term.slip.assign(rng.uniform(-3.0, 3.0, model.bend_count))
    return model, forces, state, term


def scalar(elements: BendingElements, heights: np.ndarray) -> np.ndarray:
    """Curvature of a function given at the vertices, by element."""
    return np.bincount(elements.element, elements.weights[:, 0] * heights[elements.particles], len(elements))


def matrix_of(elements: BendingElements, count: int) -> np.ndarray:
    rows = np.zeros((len(elements), count))
    rows[elements.element, elements.particles] = elements.weights[:, 0]
    return rows.T @ (elements.stiffness[:, None] * rows)


@functools.cache
def flat(name: str) -> tuple[np.ndarray, np.ndarray, BendingElements]:
    fabric = wc.Fabric(bending_rigidity=1.0, bend_stiffness=0.0)
    if name == "ragged":
        points, triangles = ragged(cells=12)
        return points, triangles, mesh_bending(points, triangles, BendingSheet((1.0, 1.0), 1.0))
    cloth = wc.Cloth.grid((1.0, 1.0), (9, 9), fabric) if name == "grid" else wc.Cloth.disc(0.5, 6, fabric)
    return cloth.points, cloth.triangles, cloth.bending


@pytest.mark.parametrize("name", ["grid", "disc", "ragged"])
def test_only_planes_are_free(name):
    points, _, elements = flat(name)
    assert np.abs(scalar(elements, 1.0 + points @ [2.0, -3.0, 0.0])).max() < 1e-10
    values = np.linalg.eigvalsh(matrix_of(elements, len(points)))
    assert values[2] < 1e-9 * values[-1]
    assert values[3] > 1e-5 * values[-1]


@pytest.mark.parametrize("name", ["grid", "disc", "ragged"])
@pytest.mark.parametrize("form", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.3, -1.2, 0.7)])
def test_quadratic_surfaces_have_their_curvature_and_are_in_equilibrium_inside(name, form):
    """Exact away from the border, where no moment acts; so constant curvature passes the patch test on any mesh."""
    points, _, elements = flat(name)
    x, y = points[:, 0], points[:, 1]
    heights = 0.5 * form[0] * x * x + 0.5 * form[1] * y * y + form[2] * x * y
    centre = np.linalg.norm(points, axis=1) < 0.35
    inner = np.bincount(elements.element, ~centre[elements.particles], len(elements)) == 0.0
    values = scalar(elements, heights)[inner]
    assert len(values) > 3
    assert np.abs(values[:, None] - np.array(form)).min(axis=1).max() < 1e-9
    forces = matrix_of(elements, len(points)) @ heights
    assert np.abs(forces[np.linalg.norm(points, axis=1) < 0.13]).max() < 1e-9 * np.abs(forces).max()


@pytest.mark.parametrize("triangles", [[[0, 1, 2]], [[0, 1, 2], [3, 4, 5]]], ids=["one", "two apart"])
def test_single_triangles_do_not_bend(triangles):
    loose = TriangleMesh(np.vstack([np.eye(3), 2.0 + np.eye(3)])[: 3 * len(triangles)], np.array(triangles))
    cloth = wc.Cloth.from_mesh(loose, wc.library_fabric("cotton"))
    assert len(cloth.bending) == 0
    wc.Simulation(wc.Model.build(cloth), "xpbd").step(0.01)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_parabola_has_the_energy_of_its_strips_whatever_the_shape_of_cells(axis):
    """½ B κ² on all but half a cell at either end; κ is exact there."""
    size, resolution, curvature = np.array([0.4, 0.3]), np.array([6, 7]), 2.0
    fabric = wc.Fabric(shear_stiffness=5.0, bend_stiffness=0.0, bending_rigidity=1e-5, bending_rigidity_weft=3e-5)
    model = wc.Model.build(wc.Cloth.grid(tuple(size), tuple(resolution), fabric), precision="float64")
    sim, bent = wc.Simulation(model, contact="none"), model.particle_q.numpy()
    bent[:, 2] = 0.5 * curvature * bent[:, axis] ** 2
    sim.state.particle_q.assign(bent)
    cell = size[axis] / (resolution[axis] - 1)
    strip = (size[axis] - cell) * size[1 - axis]
    assert sim.energy()["bending"] == pytest.approx(0.5 * (1e-5, 3e-5)[axis] * curvature**2 * strip, rel=1e-9)


def test_energy_of_an_inner_piece_is_that_of_the_sheet():
    """½ B κ² per area for a cylinder along either direction, B κ² for a twist (2 B_xy κ_xy²)."""
    points, triangles = ragged(cells=12)
    elements = mesh_bending(points, triangles, BendingSheet((1.0, 4.0), 2.0))
    x, y = points[:, 0], points[:, 1]
    border = 2.0 * 2.0 / 12.0  # elements at a free border leave out the curvature across it
    for heights, density in ((0.5 * x * x, 0.5), (0.5 * y * y, 2.0), (x * y, 2.0)):
        energy = 0.5 * np.sum(elements.stiffness * scalar(elements, heights) ** 2)
        assert (1.0 - border) * density < energy < density * (1.0 + 1e-9)


@pytest.mark.parametrize("ratio", [0.5, 1.0])
def test_between_the_yarns_cloth_bends_as_its_twist_ratio_says(ratio):
    """A cylinder along the diagonal takes (B_x + B_y + 2 B_t)/4, on grids and on irregular meshes."""
    fabric = wc.Fabric(bending_rigidity=1.0, bending_rigidity_weft=4.0, twist_ratio=ratio, bend_stiffness=0.0)
    points, triangles = ragged(cells=24)
    for cloth in (
        wc.Cloth.grid((1.0, 1.0), (25, 25), fabric),
        wc.Cloth.from_mesh(TriangleMesh(points, triangles), fabric),
    ):
        x, y = cloth.points[:, 0], cloth.points[:, 1]
        inside = np.abs(cloth.points[cloth.bending.particles[cloth.bending.start[:-1]], :2]).max(axis=1) < 0.4
        energies = []
        for heights in (0.25 * (x + y) ** 2, 0.5 * x * x):
            square = 0.5 * cloth.bending.stiffness * scalar(cloth.bending, heights) ** 2
            energies.append(square[inside].sum())
        assert energies[0] / energies[1] == pytest.approx(0.25 * (1.0 + 4.0 + 2.0 * 2.0 * ratio), rel=0.05)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("fabric", [STIFF, SLIPPING], ids=["plain", "hysteresis"])
def test_forces_are_the_slope_of_the_energy(name, fabric):
    _, forces, state, term = bent(name, fabric)
    state.particle_qd.zero_()
    forces.evaluate(state)
    f, x, h = state.particle_f.numpy().copy(), state.particle_q.numpy().copy(), 1e-6
    direction = np.random.default_rng(2).normal(size=x.shape)
    energies = []
    for sign in (1.0, -1.0):
        state.particle_q.assign(x + sign * h * direction)
        energies.append(term.energy(state)["bending"])
    slope = (energies[0] - energies[1]) / (2.0 * h)
    assert abs(slope) > 1e-3
    assert slope == pytest.approx(-np.sum(f * direction), rel=1e-6)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("fabric", [STIFF, SLIPPING], ids=["plain", "hysteresis"])
def test_no_net_force_or_torque_and_none_in_rigid_motion(name, fabric):
    model, forces, state, term = bent(name, fabric)
    forces.evaluate(state)
    x, f = state.particle_q.numpy(), state.particle_f.numpy()
    scale = np.abs(f).sum()
    assert scale > 1e-2
    assert np.abs(f.sum(axis=0)).max() < 1e-12 * scale
    assert np.abs(np.cross(x, f).sum(axis=0)).max() < 1e-12 * scale
    turned = model.particle_q.numpy() @ rotation(5).T + [1.0, 2.0, -1.0]
    state.particle_q.assign(turned)
    state.particle_qd.assign(np.cross([3.0, -2.0, 1.0], turned))
    term.slip.zero_()
    forces.evaluate(state)
    if fabric is STIFF:
        assert np.abs(state.particle_f.numpy()).max() < 1e-11 * scale
        assert term.energy(state)["bending"] < 1e-20


@pytest.mark.parametrize("assembly", ASSEMBLIES)
@pytest.mark.parametrize("name", ["grid", "disc"])
def test_products_equal_finite_differences_of_the_force(name, assembly):
    """Of cloth that is flat at rest: K from undamped forces, C from damped ones; blocks are those of the matrix."""
    for fabric, array, a, b in (
        (wc.Fabric(bending_rigidity=B, damping_time=0.0), "particle_q", 1.0, 0.0),
        (STIFF, "particle_qd", 0.0, 1.0),
    ):
        model, forces, state, _ = bent(name, fabric)
        forces.terms = [Bending(model, assembly)]
        at = linearization(model, a, b)
        at.state.copy_from(state)
        x = np.random.default_rng(4).normal(size=(model.particle_count, 3))
        expected = -force_slope(forces, state, array, x)
        assert np.linalg.norm(expected) > 1e-3
        assert np.abs(product(forces, at, x) - expected).max() < 1e-7 * np.abs(expected).max()


@pytest.mark.parametrize("name", ["grid", "arch"])
def test_matrix_is_symmetric_semidefinite_and_has_the_blocks(name):
    model, forces, state, term = bent(name, SLIPPING)
    at = linearization(model, 0.7, 0.3)
    at.state.copy_from(state)
    matrix = dense_matrix(forces, at)
    scale = np.abs(matrix).max()
    assert np.abs(matrix - matrix.T).max() < 1e-12 * scale
    assert np.linalg.eigvalsh(matrix).min() > -1e-12 * scale
    blocks = wp.zeros(model.particle_count, dtype=model.kernels.precision.mat33)
    term.hessian_diagonal(at, blocks)
    whole = matrix.reshape(model.particle_count, 3, model.particle_count, 3)
    expected = np.stack([whole[i, :, i, :] for i in range(model.particle_count)])
    assert np.abs(blocks.numpy() - expected).max() < 1e-12 * scale


def test_matrix_at_a_curved_rest_shape_is_the_slope_of_the_force():
    model, forces, state, _ = bent("arch", wc.Fabric(bending_rigidity=B, damping_time=0.0), amount=0.0)
    assert np.abs(model.bending.law.numpy()[:, 2]).max() == pytest.approx(1.0 / 0.3, rel=0.05)
    at = linearization(model, 1.0, 0.0)
    x = np.random.default_rng(4).normal(size=(model.particle_count, 3))
    expected = -force_slope(forces, state, "particle_q", x)
    assert np.abs(product(forces, at, x) - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("fabric", [STIFF, SLIPPING], ids=["plain", "hysteresis"])
def test_assemblies_agree(fabric):
    model, forces, state, term = bent("disc", fabric)
    results = []
    for assembly in ASSEMBLIES:
        other = Bending(model, assembly)
        other.slip = term.slip
        forces.terms = [other]
        forces.evaluate(state)
        results.append(state.particle_f.numpy().copy())
    assert np.abs(results[0] - results[1]).max() < 1e-13 * np.abs(results[0]).max()


def moment_loop(steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Moment per width of a grid bent to a cylinder, to 100/m, to −100/m and back, in ``steps`` steps each way."""
    cloth = wc.Cloth.grid((0.05, 0.02), (26, 11), wc.Fabric(bending_rigidity=B, bending_hysteresis=0.2, damping_time=0))
    model = wc.Model.build(cloth, precision="float64")
    term, state = Bending(model), State.of(model)
    path = np.concatenate([np.linspace(0, 100, steps), np.linspace(100, -100, steps), np.linspace(-100, 100, steps)])
    moments = []
    for curvature in path:
        angle = curvature * cloth.points[:, 0]
        arc = np.column_stack([np.sin(angle), cloth.points[:, 1] * curvature, np.cos(angle)]) / (curvature or 1.0)
        state.particle_q.assign(arc if curvature else cloth.points)
        h, energies = 1e-4, []
        for step in (h, -h):
            angle = (curvature + step) * cloth.points[:, 0]
            near = np.column_stack([np.sin(angle), cloth.points[:, 1] * (curvature + step), np.cos(angle)])
            probe = State.of(model)
            probe.particle_q.assign(near / (curvature + step))
            energies.append(term.energy(probe)["bending"])
        owned = 0.02 * 0.05 * 24.0 / 25.0  # a free edge has no second difference across it
        moments.append((energies[0] - energies[1]) / (2.0 * h) / owned)
        term.advance(state)
    return path, np.array(moments)


def test_hysteresis_loop_has_the_width_and_slope_put_in():
    """M = B κ ± HB once friction slips, whatever the size of steps: rate-independent."""
    path, moments = moment_loop(21)
    chord = np.sin(0.5 * 0.002 * path) / (0.5 * 0.002)  # second differences see 2 sin(κ a/2)/a
    number, inner = np.arange(len(path)), np.abs(path) < 75.0
    up, down = inner & (number >= 42), inner & (number >= 21) & (number < 42)
    assert up.sum() > 10
    assert down.sum() > 10
    np.testing.assert_allclose(moments[up], B * chord[up] + 0.1, atol=1e-3)
    np.testing.assert_allclose(moments[down], B * chord[down] - 0.1, atol=1e-3)
    coarse_path, coarse = moment_loop(5)
    same = np.flatnonzero(np.isclose(path, coarse_path[-2]))[-1]
    np.testing.assert_allclose(coarse[-2], moments[same], rtol=5e-3)


def test_bad_elements_are_refused():
    with pytest.raises(InputError, match="start must rise"):
        BendingElements([0, 0], [], np.zeros((0, 3)), [1.0], [0.0], [0.0])
    with pytest.raises(InputError, match="stiffness must not be negative"):
        BendingElements([0, 1], [0], np.zeros((1, 3)), [-1.0], [0.0], [0.0])
    large, small = wc.Cloth.grid((1, 1), (3, 3), STIFF), wc.Cloth.grid((1, 1), (2, 2), STIFF)
    with pytest.raises(InputError, match="bending refers to vertex 8 of 4"):
        dataclasses.replace(small, bending=large.bending)


def test_the_stable_step_of_bending_is_the_known_one():
    """(a²/4) √(σ/B) on a square grid; schemes that solve for springs only keep to it, too, unless they smooth it."""
    fabric = wc.Fabric(areal_density=0.2, bending_rigidity=B, bend_stiffness=0.0, damping_time=0.0)
    a = 0.01
    model = wc.Model.build(wc.Cloth.grid((24 * a, 24 * a), (25, 25), fabric))
    omega, gamma = fastest_rates(model, without=("springs",))
    known = 0.25 * a * a * np.sqrt(0.2 / B)
    assert gamma == 0.0
    assert 2.0 / omega == pytest.approx(known, rel=0.05)
    recorded = wc.Model.build(wc.Cloth.grid((24 * a, 24 * a), (25, 25), fabric), differentiable=True)
    for name in ("xpbd", "vbd"):
        assert largest_stable_step(recorded, INTEGRATORS[name](recorded)) == pytest.approx(0.7 * 2.0 / omega, rel=1e-6)
        assert 6.0 < largest_stable_step(model, INTEGRATORS[name](model)) / (0.7 * 2.0 / omega) < 6.8
    assert np.isinf(largest_stable_step(model, INTEGRATORS["implicit_euler"](model)))


@pytest.mark.parametrize("dt", [0.005, 0.05])
def test_a_fold_springs_back_to_where_friction_holds_it_and_stays(dt):
    """Let go at 60/m a strip opens to κ = HB/B, where friction balances bending, and creeps no further."""
    fabric = wc.Fabric(
        stretch_stiffness=20.0, shear_stiffness=5.0, bending_rigidity=1e-4, bending_hysteresis=6e-3, bend_stiffness=0.0
    )
    cloth = wc.Cloth.grid((0.04, 0.01), (17, 5), fabric)
    model, options = wc.Model.build(cloth, precision="float64"), {"tolerance": 1e-4}
    sim = wc.Simulation(model, "implicit_euler", (0, 0, 0), 1, integrator_options=options)
    curvature = 60.0
    angle = curvature * cloth.points[:, 0]
    sim.state.particle_q.assign(
        np.column_stack([np.sin(angle) / curvature, cloth.points[:, 1], np.cos(angle) / curvature])
    )
    sim.forces.advance(sim.state)
    found = []
    for _ in range(2):
        for _ in range(int(1.0 / dt)):
            sim.step(dt)
        x = sim.state.particle_q.numpy().reshape(5, 17, 3)
        second = x[:, 2:] - 2.0 * x[:, 1:-1] + x[:, :-2]
        found.append(np.linalg.norm(second, axis=2).mean() / 0.0025**2)
    assert 0.9 * 30.0 < found[0] < 1.01 * 30.0  # short steps let it swing a little too far
    assert found[1] == pytest.approx(found[0], rel=1e-4)
