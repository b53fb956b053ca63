"""XPBD in lanes: it solves what colours solve, in an order that nothing else in the model changes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import warpcloth as wc
from warpcloth.forces import lanes as lanes_module
from warpcloth.integrators import sweep_tiles
from warpcloth.integrators.spring_sweeps import ListSweep, spring_sweeps
from warpcloth.integrators.sweep_tiles import TileSweep, arranged, goes_on

LANES = 8


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(2, 150),
    springs=st.integers(1, 300),
    block=st.sampled_from([8, 24, 512]),
)
def test_springs_that_are_solved_at_once_share_no_particle(seed, count, springs, block):
    rng = np.random.default_rng(seed)
    ends = rng.integers(0, count, (springs, 2))
    ends[:, 1] = np.where(ends[:, 0] == ends[:, 1], (ends[:, 1] + 1) % count, ends[:, 1])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lanes_module, "SMALLEST_BLOCK", block)
        patch.setattr(sweep_tiles, "goes_on", lambda listed: True)
        lanes = arranged(ends, count, LANES)
    has = lanes.lane_spring >= 0
    assert np.array_equal(np.sort(lanes.lane_spring[has]), np.arange(springs))  # each once
    near = lanes.entry[:, 1:2] + np.arange(LANES)
    far = near + lanes.entry[:, 2:]
    sides = np.sort(ends, axis=1)
    assert np.array_equal(sides[lanes.lane_spring[has]], np.stack([near[has], far[has]], axis=1))
    for row in range(len(has)):
        own = np.concatenate([near[row][has[row]], far[row][has[row]]])
        assert len(set(own)) == len(own)
    for phase in range(2):
        bounds = lanes.block[lanes.phase == phase]
        assert (bounds[1:, 0] >= bounds[:-1, 1]).all()
    low, high = lanes.block[lanes.entry[:, 0]].T
    assert (near[has] >= np.broadcast_to(low[:, None], has.shape)[has]).all()
    assert (far[has] < np.broadcast_to(high[:, None], has.shape)[has]).all()


@pytest.mark.parametrize(("shape", "tolerance"), [((5, 5), 1e-12), ((23, 40), 1e-10)])
def test_what_is_solved_is_what_colours_solve(shape, tolerance):
    """Many sweeps of either come to the solution of the implicit step."""
    ends = []
    for differentiable in (False, True):
        cloth = wc.Cloth.grid((0.4, 0.4), shape, pins="left")
        model = wc.Model.build(cloth, precision="float64", differentiable=differentiable)
        sim = wc.Simulation(model, "xpbd", substeps=4, integrator_options={"iterations": 3000})
        assert isinstance(sim.integrator.sweeps[0], ListSweep if differentiable else TileSweep)
        sim.step(1.0 / 60.0)
        ends.append(sim.state.particle_q.numpy())
    assert np.abs(ends[0] - ends[1]).max() < tolerance
    assert np.abs(ends[0] - model.particle_q.numpy()).max() > 1e-4


def sheet(**options):
    return wc.Cloth.grid((1.0, 0.6), (34, 21), pins="left", transform=(0.0, 0.0, 1.0), **options)


def positions(model, **options):
    sim = wc.Simulation(model, "xpbd", substeps=8, **options)
    sim.run(6, fps=30.0)
    return sim.state.particle_q.numpy()


def test_neither_threads_nor_other_worlds_change_a_bit():
    alone = positions(wc.Model.build([sheet()], device="cpu"), threads=1)
    assert np.array_equal(positions(wc.Model.build([sheet()], device="cpu"), threads=2), alone)
    disc = wc.Cloth.disc(0.3, 8, transform=(0.0, 0.0, 3.0))  # swept another way
    worlds = [([disc], []), ([sheet()], []), ([disc], [])]
    together = wc.Model.build_worlds(worlds, device="cpu")
    assert [type(sweep) for sweep in spring_sweeps(together)] == [TileSweep, ListSweep]
    own = slice(len(disc.points), len(disc.points) + len(alone))
    assert np.array_equal(positions(together)[own], alone)


def test_worlds_go_on_alone_where_others_were_swept_another_way():
    disc = wc.Cloth.disc(0.3, 8, pins=[0], transform=(0.0, 0.0, 3.0))
    together = wc.Simulation(wc.Model.build_worlds([([disc], []), ([sheet()], [])]), "xpbd", substeps=8)
    together.run(3, fps=30.0)
    parts = []
    for world, cloth in enumerate((disc, sheet())):
        alone = wc.Simulation(wc.Model.build_worlds([([cloth], [])]), "xpbd", substeps=8)
        alone.continue_from(together, [world])
        alone.run(3, fps=30.0)
        parts.append(alone.state.particle_q.numpy().copy())
    together.run(3, fps=30.0)
    assert np.array_equal(np.concatenate(parts), together.state.particle_q.numpy())


def test_what_is_not_a_number_stays_in_its_world():
    worlds = [([wc.Cloth.grid((0.5, 0.5), (9, 5))], []) for _ in range(2)]
    sim = wc.Simulation(wc.Model.build_worlds(worlds), "xpbd", substeps=4, check=False)
    values = sim.state.particle_q.numpy().copy()
    values[44] = np.nan  # the last one of the first world
    sim.state.particle_q.assign(values)
    sim.step(1.0 / 60.0)
    found = np.isnan(sim.state.particle_q.numpy()).any(axis=1)
    assert found[:45].sum() > 5
    assert not found[45:].any()


def test_lists_that_stay_at_a_particle_are_told():
    along = np.array([[0, 1], [1, 2], [2, 3], [3, 4]])
    assert goes_on(along)
    assert goes_on(along[:1])
    assert not goes_on(np.array([[5, 6], [0, 1], [2, 0], [0, 3]]))
    assert goes_on(np.asarray(wc.Cloth.grid((1.0, 1.0), (9, 7)).springs.indices))
    assert not goes_on(np.asarray(wc.Cloth.disc(0.5, 6).springs.indices))
