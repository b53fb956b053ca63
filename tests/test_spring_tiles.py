"""Springs in lanes: the law, whatever the network; the same bits whatever the blocks, threads and neighbours."""

import numpy as np
import pytest
import trimesh
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st
from test_springs import law_in_numpy, random_network

import warpcloth as wc
from warpcloth.forces import Forces, Linearization, Springs, spring_tiles
from warpcloth.forces import lanes as lanes_module
from warpcloth.forces.lanes import in_lanes
from warpcloth.forces.spring_rows import SpringRows
from warpcloth.forces.spring_tiles import SpringTiles, arranged
from warpcloth.state import State


def tiles_of(model: wc.Model, ranges: int = 1, block: int = 512) -> SpringTiles:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lanes_module, "SMALLEST_BLOCK", block)
        patch.setattr(lanes_module, "LEAST_FILL", 0.0)
        patch.setattr(spring_tiles, "BLOCK_TO_REACH", 1)
        lanes, left = in_lanes(model, arranged)
    assert not left.any()
    return SpringTiles(model, lanes, ranges)


def tile_forces(model: wc.Model, ranges: int = 1, block: int = 512) -> np.ndarray:
    """Forces by tiles, however few lanes they fill, in blocks of at least so many particles."""
    tiles = tiles_of(model, ranges, block)
    tiles._memory.fill_(float("nan"))  # nothing must come from lanes without a spring
    state = State.of(model)
    state.particle_f.zero_()
    tiles.accumulate(state)
    return state.particle_f.numpy()


def grid(shape=(33, 21), **options) -> wc.Model:
    """A sheet whose vertices are off their places, and move."""
    cloth = wc.Cloth.grid((1.0, 0.6), shape)
    rng = np.random.default_rng(3)
    model = wc.Model.build(cloth, **options)
    model.particle_q.assign(cloth.points + rng.normal(0.0, 0.01, cloth.points.shape))
    model.particle_qd.assign(rng.normal(0.0, 1.0, cloth.points.shape))
    return model


@settings(max_examples=40)
@given(
    seed=st.integers(0, 10**6),
    particles=st.integers(2, 70),
    springs=st.integers(1, 200),
    block=st.sampled_from([8, 16, 40, 512]),
    ranges=st.integers(1, 4),
)
def test_any_network_gets_the_forces_of_the_law(seed, particles, springs, block, ranges):
    net = random_network(seed, particles, springs)  # with springs side by side, and between any particles
    expected = law_in_numpy(net)
    got = tile_forces(wc.Model.from_springs(**net, precision="float64"), ranges, block)
    assert np.abs(got - expected).max() <= 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_grid_goes_in_tiles_and_a_heap_row_by_row(precision):
    model = grid(precision=precision)
    by_lanes, one_by_one = (Springs(model, ranges=ranges) for ranges in (2, None))
    assert [type(part) for part in by_lanes._parts] == [SpringTiles]
    forces = []
    for springs in (by_lanes, one_by_one):
        state = State.of(model)
        springs.accumulate(state, 0.0)
        forces.append(state.particle_f.numpy())
    rounding = np.finfo(forces[0].dtype).eps * np.abs(model.spring_stiffness.numpy()).max() * 300
    assert np.abs(forces[0] - forces[1]).max() < rounding < 1e-2 * np.abs(forces[1]).max()
    shuffled = wc.Model.from_springs(**random_network(1, 300, 900))
    assert [type(part) for part in Springs(shuffled, ranges=1)._parts] == [SpringRows]


def test_neither_blocks_nor_threads_nor_other_worlds_change_a_bit():
    alone = grid()
    forces = tile_forces(alone)
    for block, ranges in ((8, 1), (40, 3), (64, 2)):
        assert np.array_equal(tile_forces(alone, ranges, block), forces)
    cloth, other = wc.Cloth.grid((1.0, 0.6), (33, 21)), wc.Cloth.grid((0.3, 0.2), (9, 5))
    both = wc.Model.build_worlds([([item], []) for item in (other, cloth, other)])
    own = slice(45, 45 + len(cloth.points))
    for name in ("particle_q", "particle_qd"):
        values = getattr(both, name).numpy()
        values[own] = getattr(alone, name).numpy()
        getattr(both, name).assign(values)
    assert np.array_equal(tile_forces(both, 2, 64)[own], forces)


def test_gravity_and_springs_at_once_are_the_same_bits():
    sheet, other = wc.Cloth.grid((1.0, 0.6), (33, 21)), wc.Cloth.grid((0.3, 0.2), (9, 5))
    model = wc.Model.build_worlds([([item], []) for item in (sheet, other)])
    state, gravity = State.of(model), model.array([[0.3, 0.0, -9.8], [0.0, 1.6, 0.1]], model.vec3)
    model.particle_q.assign(model.particle_q.numpy() * [1.1, 0.9, 1.0])
    model.launch_particles("particles", "set_gravity_force", [model.particle_mass, model.particle_world, gravity],
                           [state.particle_f])  # fmt: skip
    tiles = tiles_of(model, 2, 64)
    tiles.accumulate(state)
    expected = state.particle_f.numpy().copy()
    state.particle_f.fill_(float("nan"))  # what was there before must not count
    tiles.accumulate(state, gravity)
    assert np.abs(expected[-45:]).max() > 0.0
    assert np.array_equal(state.particle_f.numpy(), expected)


@pytest.mark.parametrize("integrator", ["symplectic_euler", "velocity_verlet"])
def test_springs_that_move_their_particles_at_once_move_them_to_the_same_bits(integrator, monkeypatch):
    cloths = [wc.Cloth.grid((1.0, 1.0), (33, 33), pins="top"), wc.Cloth.grid((0.5, 0.5), (21, 17), name="other")]
    worlds = [([cloths[0]], []), (cloths, [])]
    rest = wc.Model.build_worlds(worlds).particle_q.numpy()
    start = rest + np.random.default_rng(2).normal(0.0, 1e-3, rest.shape)
    at_once, taken = Forces.advance_at_once, []

    def ends() -> list[bytes]:
        sim = wc.Simulation(wc.Model.build_worlds(worlds), integrator, threads=2)
        sim.state.particle_q.assign(start)
        sim.run(2)
        arrays = sim.state.particle_q, sim.state.particle_qd, sim.state.particle_f
        assert np.isfinite(arrays[0].numpy()).all()
        return [array.numpy().tobytes() for array in arrays]

    monkeypatch.setattr(Forces, "advance_at_once", lambda *given: taken.append(at_once(*given)) or taken[-1])
    together = ends()
    monkeypatch.setattr(Forces, "advance_at_once", lambda *_: False)
    assert any(taken)
    assert ends() == together


def test_particles_of_a_world_without_springs_fall_too():
    """Blocks are of worlds that have springs; where one has none, gravity goes by itself."""
    sheet = wc.Cloth.grid((0.3, 0.2), (9, 5))
    woven = wc.Cloth.from_mesh(trimesh.Trimesh(np.eye(3), [[0, 1, 2]], process=False), springs="woven")
    for cloths, has_all in (([sheet, sheet], True), ([sheet, woven], False)):
        model = wc.Model.build_worlds([([item], []) for item in cloths])
        springs, state = Springs(model, ranges=2), State.of(model)
        assert [part.has_all for part in springs._parts] == [has_all]
        Forces(model, [springs], model.array([[0.0, 0.0, -10.0]] * 2, model.vec3)).evaluate(state)
        weight = 10.0 * model.particle_mass.numpy()
        assert np.allclose(state.particle_f.numpy()[:, 2], -weight, rtol=1e-6)  # springs at rest pull nowhere


def test_what_is_not_a_number_shows_at_its_neighbours_and_nowhere_else():
    model = grid((9, 5))
    positions = model.particle_q.numpy()
    positions[20] = np.nan
    model.particle_q.assign(positions)
    touched = np.unique(model.spring_indices.numpy()[(model.spring_indices.numpy() == 20).any(axis=1)])
    nan = np.isnan(tile_forces(model, block=8)).all(axis=1)
    assert np.array_equal(np.flatnonzero(nan), touched)


def test_springs_of_no_length_pull_nowhere():
    model = wc.Model.from_springs(np.zeros((16, 3)), 1.0, [[k, k + 1] for k in range(15)], 1.0, 100.0, 1.0)
    assert np.array_equal(tile_forces(model), np.zeros((16, 3)))


def test_changed_springs_are_taken_over():
    model = grid((9, 5))
    tiles, state = tiles_of(model), State.of(model)
    model.spring_stiffness.assign(2.0 * model.spring_stiffness.numpy())
    model.spring_damping.assign(2.0 * model.spring_damping.numpy())
    tiles.accumulate(state)
    before = state.particle_f.numpy().copy()
    tiles.arrange()
    wp.copy(state.particle_f, wp.zeros_like(state.particle_f))
    tiles.accumulate(state)
    assert np.array_equal(state.particle_f.numpy(), 2.0 * before)


@pytest.mark.parametrize("project", [0.0, 0.3, 1.0])
def test_products_equal_those_one_by_one(project):
    net = random_network(5, 80, 400)
    model = wc.Model.from_springs(**net, precision="float64")
    x = model.array(np.random.default_rng(1).normal(size=(80, 3)), model.vec3)
    at = Linearization(State.of(model), 0.7, 0.2, model.array([project], model.real))
    one_by_one, in_tiles = (wp.ones_like(model.particle_q) for _ in range(2))
    Springs(model).hessian_product(at, x, one_by_one)
    tiles_of(model, 2, 16).multiply(at, x, in_tiles)
    expected = one_by_one.numpy()
    assert np.abs(expected).max() > 100.0
    assert np.abs(in_tiles.numpy() - expected).max() <= 1e-12 * np.abs(expected).max()


def test_every_spring_of_mixed_worlds_is_in_a_product_once():
    """A grid in tiles, and springs between any particles one by one."""
    disordered = wc.Cloth.disc(0.3, 6)
    shuffle = np.random.default_rng(0).permutation(len(disordered.points))
    model = wc.Model.build_worlds([([wc.Cloth.grid((0.5, 0.5), (9, 9))], []), ([disordered], [])])
    ends = model.spring_indices.numpy().copy()
    other = ends[:, 0] >= 81
    ends[other] = 81 + shuffle[ends[other] - 81]
    model.spring_indices.assign(ends)
    rng = np.random.default_rng(2)
    model.particle_q.assign(rng.normal(size=(model.particle_count, 3)))
    x = model.array(rng.normal(size=(model.particle_count, 3)), model.vec3)
    at = Linearization(State.of(model), 0.7, 0.2, model.array([1.0, 1.0], model.real))
    products = []
    for ranges in (None, 2):
        springs, out = Springs(model, ranges=ranges), wp.zeros_like(model.particle_q)
        springs.hessian_product(at, x, out)
        products.append(out.numpy())
    assert [type(part) for part in springs._parts] == [SpringTiles, SpringRows]
    assert np.abs(products[0] - products[1]).max() < 1e-5 * np.abs(products[0]).max()
