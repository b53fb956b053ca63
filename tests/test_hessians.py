"""Stiffness and damping matrices of the force terms, against finite differences of the forces."""

import numpy as np
import pytest
import warp as wp

import warpcloth as wc
from warpcloth.forces import ASSEMBLIES, Forces, Linearization, Springs
from warpcloth.state import State


def random_model(seed: int = 0, particles: int = 30, springs: int = 90, k_d: float = 1.0) -> wc.Model:
    rng = np.random.default_rng(seed)
    ends = np.stack([rng.integers(0, particles, springs), rng.integers(1, particles, springs)], axis=1)
    ends[:, 1] = (ends[:, 0] + ends[:, 1]) % particles
    ends = ends[ends[:, 0] != ends[:, 1]]
    positions, velocities = rng.normal(size=(2, particles, 3))
    rest, k_s = rng.uniform(0.5, 3.0, len(ends)), rng.uniform(1.0, 100.0, len(ends))
    return wc.Model.from_springs(
        positions, rng.uniform(0.1, 1.0, particles), ends, rest, k_s, k_d * rng.uniform(0.1, 2.0, len(ends)),
        velocities=velocities, precision="float64",
    )  # fmt: skip


def forces_of(model: wc.Model, assembly: str = "scatter") -> Forces:
    return Forces(model, [Springs(model, assembly)], model.array(np.zeros((1, 3)), model.vec3))


def product(forces: Forces, at: Linearization, x: np.ndarray) -> np.ndarray:
    model = forces.model
    out = wp.zeros_like(model.particle_q)
    forces.hessian_product(at, model.array(x, model.vec3), out)
    return out.numpy()


def linearization(model: wc.Model, a: float, b: float, project: float = 0.0) -> Linearization:
    return Linearization(State.of(model), a, b, model.array(np.full(model.world_count, project), model.real))


def force_slope(forces: Forces, state: State, name: str, x: np.ndarray, h: float = 1e-6) -> np.ndarray:
    """Central difference of the forces along x in positions or velocities."""
    values = []
    array = getattr(state, name)
    middle = array.numpy().copy()
    for sign in (1.0, -1.0):
        array.assign(middle + sign * h * x)
        forces.evaluate(state)
        values.append(state.particle_f.numpy().copy())
    array.assign(middle)
    return (values[0] - values[1]) / (2.0 * h)


@pytest.mark.parametrize("assembly", ASSEMBLIES)
@pytest.mark.parametrize(("name", "a", "b", "k_d"), [("particle_q", 1.0, 0.0, 0.0), ("particle_qd", 0.0, 1.0, 1.0)])
def test_products_equal_finite_differences_of_the_force(assembly, name, a, b, k_d):
    model = random_model(k_d=k_d)
    forces = forces_of(model, assembly)
    x = np.random.default_rng(1).normal(size=(model.particle_count, 3))
    expected = -force_slope(forces, State.of(model), name, x)
    assert np.linalg.norm(expected) > 1.0
    got = product(forces, linearization(model, a, b), x)
    assert np.abs(got - expected).max() <= 1e-7 * np.abs(expected).max()


def dense_matrix(forces: Forces, at: Linearization) -> np.ndarray:
    n = 3 * forces.model.particle_count
    columns = [product(forces, at, unit.reshape(-1, 3)).reshape(-1) for unit in np.eye(n)]
    return np.stack(columns, axis=1)


def test_stiffness_of_damped_springs_is_the_slope_at_the_present_tension():
    """Of how damping changes as springs turn: its direction, and not how fast a spring is stretched, see the law."""
    model = random_model(k_d=30.0)
    x, v, (p, q) = model.particle_q.numpy(), model.particle_qd.numpy(), model.spring_indices.numpy().T
    rest, k_s, k_d = (a.numpy() for a in (model.spring_rest_length, model.spring_stiffness, model.spring_damping))
    n, length = x[q] - x[p], np.linalg.norm(x[q] - x[p], axis=1)
    n /= length[:, None]
    rate = np.sum((v[q] - v[p]) * n, axis=1)
    tension = k_s * (length / rest - 1.0) + k_d * rate / rest
    expected = np.zeros((model.particle_count, 3, model.particle_count, 3))
    for i, j, stiff, across, along in zip(p, q, k_s / rest, tension / length, n, strict=True):
        block = (stiff - across) * np.outer(along, along) + across * np.eye(3)
        for k, m, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            expected[k, :, m, :] += sign * block
    expected = expected.reshape(3 * model.particle_count, -1)
    assert np.abs(k_d * rate / rest).max() > 0.5 * np.abs(tension).max()
    got = dense_matrix(forces_of(model), linearization(model, 1.0, 0.0))
    assert np.abs(got - expected).max() <= 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("project", [0.0, 1.0])
def test_diagonal_blocks_are_those_of_the_matrix(project):
    model = random_model()
    forces = forces_of(model)
    at = linearization(model, 0.7, 0.3, project)
    blocks = wp.zeros(model.particle_count, dtype=model.kernels.precision.mat33)
    forces.hessian_diagonal(at, blocks)
    whole = dense_matrix(forces, at).reshape(model.particle_count, 3, model.particle_count, 3)
    expected = np.stack([whole[i, :, i, :] for i in range(model.particle_count)])
    assert np.linalg.norm(expected) > 1.0
    assert np.abs(blocks.numpy() - expected).max() <= 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("k_d", [0.0, 1.0])
def test_projection_makes_the_matrix_semidefinite(k_d):
    model = random_model(k_d=k_d)
    forces = forces_of(model)
    plain, half, projected = (dense_matrix(forces, linearization(model, 1.0, 0.0, p)) for p in (0.0, 0.5, 1.0))
    scale = np.abs(plain).max()
    assert np.abs(plain - plain.T).max() <= 1e-13 * scale
    assert np.linalg.eigvalsh(plain).min() < -1e-3 * scale  # these springs are compressed
    assert np.linalg.eigvalsh(projected).min() > -1e-12 * scale
    assert np.abs(half - 0.5 * (plain + projected)).max() <= 1e-13 * scale
    if k_d == 0.0:
        assert np.linalg.eigvalsh(projected - plain).min() > -1e-12 * scale


def test_zero_length_spring_has_a_finite_matrix():
    model = wc.Model.from_springs(np.zeros((2, 3)), 1.0, [[0, 1]], 1.0, 100.0, 1.0, precision="float64")
    matrix = dense_matrix(forces_of(model), linearization(model, 1.0, 1.0))
    assert np.array_equal(matrix, np.zeros((6, 6)))
