"""Matrices written down in blocks, against the products of the force terms themselves."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpcloth as wc
from warpcloth.forces import BlockMatrix, Linearization, MassDamping
from warpcloth.state import State

LIFTED = (0.0, 0.0, 0.01)


def grid(precision: str = "float64") -> wc.Model:
    """Springs, bending with hysteresis."""
    cloth = wc.Cloth.grid((0.4, 0.5), (9, 12), fabric=wc.library_fabric("cotton"), transform=LIFTED)
    return wc.Model.build([cloth], [wc.Plane()], precision=precision)


def woven(precision: str = "float64") -> wc.Model:
    cloth = wc.Cloth.from_mesh(irregular(), wc.library_fabric("denim"), transform=LIFTED, springs="woven")
    return wc.Model.build([cloth], [wc.Plane()], precision=precision)


def fitted(precision: str = "float64") -> wc.Model:
    """Springs that do not go eight at a time."""
    return wc.Model.build(
        [wc.Cloth.from_mesh(irregular(), wc.library_fabric("ponte"), transform=LIFTED, springs="fitted")],
        [wc.Plane()],
        precision=precision,
    )


def irregular() -> trimesh.Trimesh:
    """Vertices in no order, so that no eight springs are alike."""
    cloth, rng = wc.Cloth.grid((0.5, 0.5), (8, 8)), np.random.default_rng(3)
    points = cloth.points + 0.01 * rng.normal(size=cloth.points.shape) * [1.0, 1.0, 0.0]
    number = rng.permutation(len(points))
    return trimesh.Trimesh(points[np.argsort(number)], number[cloth.triangles], process=False)


def disturbed(model: wc.Model, **options) -> wc.Simulation:
    """In motion, out of shape, some of it on the floor; bending with and without slip, flat and curved at rest."""
    air = wc.Air(wind=(3.0, 1.0, 2.0), turbulence=1.0)
    forces = [MassDamping(model, 3.0)]
    sim = wc.Simulation(model, "implicit_euler", contact="obstacles", air=air, forces=forces, **options)
    rng = np.random.default_rng(0)
    shape = (model.particle_count, 3)
    q = sim.state.particle_q
    q.assign(q.numpy() * 0.98 + 1e-3 * rng.normal(size=shape) - [0.0, 0.0, 0.01])
    sim.state.particle_qd.assign(rng.normal(size=shape))
    for term in sim.forces.terms:
        if term.name == "bending":
            slips, curved = rng.integers(0, 2, (2, model.bend_count))
            term.slip.assign(slips * rng.normal(size=model.bend_count))
            law = model.bending.law.numpy()
            law[:, 2] = curved * rng.normal(size=model.bend_count)
            model.bending.law.assign(law)
    sim.contact.support.begin(State.of(model), 0.01)
    sim.forces.evaluate(sim.state)
    return sim


def product(sim: wc.Simulation, at: Linearization, x: np.ndarray) -> np.ndarray:
    model = sim.model
    out = wp.zeros_like(model.particle_q)
    sim.forces.hessian_product(at, model.array(x, model.vec3), out)
    return out.numpy().copy()


def linearization(sim: wc.Simulation, project: float, a: float = 1e-4, b: float = 1e-2) -> Linearization:
    return Linearization(sim.state, a, b, sim.model.array([project], sim.model.real), 0.5)


@pytest.mark.parametrize("project", [0.0, 1.0])
@pytest.mark.parametrize("build", [grid, woven, fitted])
def test_blocks_multiply_as_the_terms_themselves(build, project):
    sim = disturbed(build())
    x = np.random.default_rng(1).normal(size=(sim.model.particle_count, 3))
    at = linearization(sim, project)
    expected = product(sim, at, x)
    sim.forces.linearize(at)
    names = {term.name for term in sim.forces.blocks.terms}
    assert names >= {"bending", "air", "obstacles", "mass_damping", "woven" if build is woven else "springs"}
    assert np.abs(product(sim, at, x) - expected).max() <= 1e-12 * np.abs(expected).max()


def test_each_term_is_written_down_as_it_multiplies():
    sim = disturbed(grid())
    x = np.random.default_rng(2).normal(size=(sim.model.particle_count, 3))
    at = linearization(sim, 0.5)
    for term in sim.forces.terms:
        alone = wp.zeros_like(sim.model.particle_q)
        term.hessian_product(at, sim.model.array(x, sim.model.vec3), alone)
        matrix = BlockMatrix(sim.model, [term])
        matrix.assemble(at)
        out = wp.zeros_like(alone)
        matrix.multiply(at, sim.model.array(x, sim.model.vec3), out)
        if matrix.terms:
            assert np.abs(alone.numpy()).max() > 0.0, term.name
            assert np.abs(out.numpy() - alone.numpy()).max() <= 1e-12 * np.abs(alone.numpy()).max(), term.name


def test_a_common_motion_feels_nothing_between_particles():
    """Exactly, in single precision too: else the stiffest springs would hold cloth back as a whole."""
    model = grid("float32")
    sim = wc.Simulation(model, "implicit_euler", contact="none")
    at = linearization(sim, 1.0)
    sim.forces.linearize(at)
    assert len(sim.forces.blocks.rows.column) > 10 * model.particle_count
    assert not product(sim, at, np.full((model.particle_count, 3), 1e3)).any()


def test_a_diagonal_written_down_is_that_of_the_terms_themselves():
    sim = disturbed(grid())
    at, projected = linearization(sim, 0.0), sim.model.array([1.0], sim.model.real)

    def diagonal(where: Linearization) -> np.ndarray:
        out = wp.zeros(sim.model.particle_count, dtype=sim.model.kernels.precision.mat33, device=sim.model.device)
        sim.forces.hessian_diagonal(where, out)
        return out.numpy()

    expected = diagonal(at.projected(projected))
    sim.forces.linearize(at)
    assert [term.name for term in sim.forces.blocks.with_diagonal] == ["bending"]
    assert np.abs(sim.forces.blocks.rows.diagonal.numpy()).max() > 1e-6 * np.abs(expected).max()
    assert np.array_equal(diagonal(at.projected(projected)), expected)
    sim.forces.blocks.rows.diagonal.zero_()  # that it is read, and for this matrix only
    assert not np.array_equal(diagonal(at.projected(projected)), expected)
    for other in (linearization(sim, 1.0), linearization(sim, 0.0).projected(projected)):
        assert np.array_equal(diagonal(other), expected)


def test_another_state_or_matrix_is_not_taken_for_the_one_written_down():
    sim = disturbed(grid())
    x = np.random.default_rng(3).normal(size=(sim.model.particle_count, 3))
    at, other = linearization(sim, 1.0), linearization(sim, 1.0, a=5e-4)
    expected = product(sim, other, x)
    sim.forces.linearize(at)
    assert np.array_equal(product(sim, other, x), expected)
    assert np.abs(product(sim, at, x) - expected).max() > 1e-3 * np.abs(expected).max()
    sim.state.particle_q.assign(1.1 * sim.state.particle_q.numpy())
    before = product(sim, at, x)
    sim.forces.linearize(at)
    assert np.abs(product(sim, at, x) - before).max() > 1e-6 * np.abs(before).max()


def test_forces_that_come_later_are_multiplied_beside_the_blocks():
    sim = disturbed(grid())
    x = np.random.default_rng(4).normal(size=(sim.model.particle_count, 3))
    sim.forces.terms.append(MassDamping(sim.model, 100.0))
    at = linearization(sim, 1.0)
    expected = product(sim, at, x)
    sim.forces.linearize(at)
    assert np.abs(product(sim, at, x) - expected).max() <= 1e-12 * np.abs(expected).max()


def test_only_schemes_that_multiply_many_times_write_matrices_down():
    model = grid()
    written = {name: wc.Simulation(model, name, contact="none").forces.blocks for name in wc.integrators()}
    with_blocks = {name for name, blocks in written.items() if blocks is not None}
    newton = {"implicit_euler", "implicit_midpoint", "implicit_trapezoid", "bdf2"}
    assert with_blocks == {*newton, "linear_implicit_euler"}
