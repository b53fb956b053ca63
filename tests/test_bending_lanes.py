"""Bending eight elements at once: the same forces and slips as one by one, whatever the blocks, threads and worlds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import warpcloth as wc
from warpcloth.forces import Bending, bending_lanes
from warpcloth.forces import lanes as lanes_module
from warpcloth.forces.bending_lanes import follows, grouped, in_groups
from warpcloth.state import State

FABRICS = {
    "plain": wc.Fabric(bending_rigidity=1e-5, damping_time=0.0),
    "damped": wc.Fabric(bending_rigidity=2e-5, damping_time=0.01),
    "hysteresis": wc.Fabric(bending_rigidity=1e-5, bending_hysteresis=0.02, damping_time=0.003),
}


def rumpled(model: wc.Model, seed: int = 3) -> State:
    state, rng = State.of(model), np.random.default_rng(seed)
    shape = (model.particle_count, 3)
    state.particle_q.assign(model.particle_q.numpy() + rng.normal(0.0, 0.005, shape))
    state.particle_qd.assign(rng.normal(0.0, 1.0, shape))
    return state


def evaluated(model: wc.Model, assembly: str = "scatter", ranges: int = 1) -> tuple[Bending, np.ndarray, np.ndarray]:
    """The term, forces on top of others, and slips after a step, both at a rumpled state."""
    term, state = Bending(model, assembly, ranges), rumpled(model)
    term.slip.assign(np.linspace(-30.0, 30.0, model.bend_count))
    state.particle_f.fill_(0.001)
    if term._lanes is not None:
        term._lanes._memory.fill_(float("nan"))  # nothing must come from lanes without an element
    term.accumulate(state, 0.0)
    term.advance(state)
    return term, state.particle_f.numpy(), term.slip.numpy()


@settings(max_examples=20)
@given(
    shape=st.tuples(st.integers(10, 40), st.integers(3, 20)),
    name=st.sampled_from(sorted(FABRICS)),
    block=st.sampled_from([40, 100, 512]),
    ranges=st.integers(1, 4),
)
def test_any_grid_gets_the_same_as_one_by_one(shape, name, block, ranges):
    model = wc.Model.build(wc.Cloth.grid((0.03 * shape[0], 0.03 * shape[1]), shape, FABRICS[name]), precision="float64")
    _, expected, slips = evaluated(model, "gather")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lanes_module, "SMALLEST_BLOCK", block)
        patch.setattr(lanes_module, "LEAST_FILL", 0.0)
        patch.setattr(bending_lanes, "BLOCK_TO_REACH", 1)
        term, forces, after = evaluated(model, ranges=ranges)
    assert term._lanes is not None
    assert np.abs(forces - expected).max() < 1e-13 * np.abs(expected).max()
    assert np.allclose(after, slips, rtol=1e-13, atol=1e-13)
    assert (name == "hysteresis") == bool(np.abs(after - np.linspace(-30.0, 30.0, len(after))).max() > 1.0)


@pytest.mark.parametrize("ranges", [1, 3])
def test_worlds_do_not_depend_on_each_other(ranges):
    """A grid and a mesh, which is not for lanes: the same bits as alone; and on any number of threads."""
    grid = wc.Cloth.grid((1.0, 0.6), (40, 30), FABRICS["hysteresis"])
    disc = wc.Cloth.disc(0.3, 12, FABRICS["hysteresis"])
    alone = [wc.Model.build(cloth) for cloth in (grid, disc)]
    both = wc.Model.build_worlds([([disc], []), ([grid], []), ([disc], [])])
    together, state = Bending(both, "scatter", ranges), State.of(both)
    assert together._lanes is not None
    assert together._left_count == 2 * alone[1].bend_count
    parts = [Bending(model) for model in alone]
    states = [rumpled(model) for model in alone]
    for name in ("particle_q", "particle_qd"):
        of_grid, of_disc = (getattr(own, name).numpy() for own in states)
        getattr(state, name).assign(np.concatenate([of_disc, of_grid, of_disc]))
    for term, own in [*zip(parts, states, strict=True), (together, state)]:
        own.particle_f.zero_()
        term.accumulate(own, 0.0)
        term.advance(own)
    forces, slips = ([own.particle_f.numpy() for own in states], [part.slip.numpy() for part in parts])
    assert np.array_equal(state.particle_f.numpy(), np.concatenate([forces[1], forces[0], forces[1]]))
    assert np.array_equal(together.slip.numpy(), np.concatenate([slips[1], slips[0], slips[1]]))


def test_properties_that_change_are_felt():
    model = wc.Model.build(wc.Cloth.grid((1.0, 0.6), (40, 30), FABRICS["damped"]), precision="float64")
    before = evaluated(model)[1] - 0.001
    model.bending.law.assign(2.0 * model.bending.law.numpy())
    assert np.allclose(evaluated(model)[1] - 0.001, 2.0 * before, rtol=1e-10, atol=1e-12)


def test_groups_are_rows_of_a_grid():
    model = wc.Model.build(wc.Cloth.grid((1.0, 0.6), (21, 9), FABRICS["plain"]))
    found = grouped(model)
    assert not found.left.any()
    elements = np.concatenate([np.arange(e, e + count) for e, count in found.each])
    assert np.array_equal(np.sort(elements), np.arange(model.bend_count))  # each once
    rows = 9 * [19] + [7 * 21] + 8 * [20]  # along, across (where rows go on with the next), twist
    assert np.add.reduceat(found.each[:, 1], np.cumsum([0, *(-(-n // 8) for n in rows[:-1])])).tolist() == rows
    disc = wc.Model.build(wc.Cloth.disc(0.3, 12, FABRICS["plain"]))
    assert follows(disc).mean() < 0.5
    assert grouped(disc).left.all()


def test_groups_end_where_elements_are_left_out():
    follower = np.ones(20, bool)
    follower[[0, 7]] = False
    assert in_groups(np.array([0, 1, 2, 5, 6, 7, 8]), follower, 8).tolist() == [[0, 3], [5, 2], [7, 2]]
    assert in_groups(np.arange(20), follower, 8).tolist() == [[0, 7], [7, 8], [15, 5]]
    assert in_groups(np.array([], int), follower, 8).shape == (0, 2)
