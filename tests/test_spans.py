"""Spans of springs: that they cover rows, carry load, leave slack alone and follow their formula."""

from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st
from test_rows import chain
from warpcloth.kernels import KernelSet

import warpcloth as wc
from warpcloth.integrators.rows import SHORTEST_ROW
from warpcloth.integrators.spans import UNIT, Spans, in_groups, span_levels, unit_starts


@given(st.lists(st.integers(SHORTEST_ROW, 300), min_size=1, max_size=8))
def test_each_level_covers_a_row_with_spans_that_end_where_others_begin(lengths):
    first = np.concatenate([[0], np.cumsum(lengths)])
    start, row = unit_starts(first)
    assert np.array_equal(np.unique(np.concatenate([start, first])), start)
    assert np.diff(start).min() >= SHORTEST_ROW
    assert np.diff(start).max() < 2 * UNIT
    every = span_levels(row)
    finest = every[-1]
    assert np.array_equal(finest, np.column_stack([np.arange(len(row)), np.arange(len(row)) + 1]))
    for level in every:
        assert np.array_equal(row[level[:, 0]], row[level[:, 1] - 1])
        assert np.all(level[1:, 0] >= level[:-1, 1])
    whole = {tuple(units) for level in every for units in level.tolist()}
    assert all(
        (int(np.searchsorted(row, r)), int(np.searchsorted(row, r, "right"))) in whole for r in set(row.tolist())
    )


def stepped(net: dict, h: float, **options) -> np.ndarray:
    """Positions after a step whose rows are not solved as one at the end."""
    sim = wc.Simulation(wc.Model.from_springs(**net), "xpbd", (0, 0, 0), substeps=1, integrator_options=options)
    sim.integrator._row_parts = []
    sim.step(h)
    return sim.state.particle_q.numpy()


def test_a_span_is_the_spring_that_its_springs_make():
    """Ends alone have mass to speak of: eight springs in a row are one of an eighth of the stiffness per length."""
    masses = np.full(9, 1e-9)
    masses[[0, 8]] = 0.3
    row = chain(8, 0.2) | {"masses": masses}
    one = {"positions": row["positions"][[0, 8]], "springs": [[0, 1]], "rest_lengths": 0.8, "masses": 0.3}
    one |= {"k_s": 50.0, "k_d": 0.02, "precision": "float64"}
    assert stepped(row, 0.01, iterations=1)[[0, 8]] == pytest.approx(stepped(one, 0.01, iterations=1), abs=1e-8)
    assert stepped(row, 0.01, iterations=1, rows=False)[8, 0] - row["positions"][8, 0] > -1e-4


def test_slack_rows_are_left_alone():
    net = chain(16, -0.1)
    assert np.array_equal(stepped(net, 0.01), stepped(net, 0.01, rows=False))
    assert not np.array_equal(stepped(chain(16, 0.1), 0.01), stepped(chain(16, 0.1), 0.01, rows=False))


def test_spans_follow_their_formula():
    """The formula of ``kernels/spans.py`` in numpy, span after span, for a crooked row of unlike springs."""
    rng, h, count = np.random.default_rng(3), 0.02, 45
    net = chain(count, 0.15)
    net["positions"] += 0.03 * rng.normal(size=(count + 1, 3))
    net |= {"masses": rng.uniform(0.01, 0.03, count + 1), "k_s": rng.uniform(20.0, 80.0, count), "k_d": 0.1}
    net |= {"pinned": [0], "velocities": rng.normal(size=(count + 1, 3))}
    model = wc.Model.from_springs(**net)
    sim = wc.Simulation(model, "xpbd", (0, 0, 0), integrator_options={"warm_start": 0.5})
    scheme, start = sim.integrator, model.particle_q.numpy()
    force = rng.normal(size=(count, 3))
    springs = next(sweep for sweep in scheme.sweeps if len(sweep.slots()[0]) > 0)
    spring, slot = springs.slots()
    places = slot[:, None] + springs.stride * np.arange(3)
    flat = springs.flat_force.numpy()
    flat[places] = force[spring]
    springs.flat_force.assign(flat)
    moved = rng.normal(size=(count + 1, 3)) * 0.01
    scheme.displacement.assign(moved)
    for part, turn in scheme.pieces(sim.state, h):
        if part in scheme._span_parts:
            part.solve(turn, scheme.displacement)

    w, alpha = model.particle_inv_mass.numpy(), 0.1 / net["k_s"]
    tau, now = 0.1 / net["k_s"], 0.5 * force
    first, row = unit_starts(np.array([0, count]))
    units = list(pairwise(first))
    for level in span_levels(row):
        for even in (0, 1):
            for a, b in level[even::2]:
                own = units[a:b]
                d = np.array([start[q] + moved[q] - start[p] - moved[p] for p, q in own])
                n = d / np.linalg.norm(d, axis=1)[:, None]
                rest = np.array([0.1 * (q - p) for p, q in own])
                rate = np.array([tau[p:q].mean() for p, q in own]) / h
                going = np.array([moved[q] - moved[p] for p, q in own])
                held = np.array([(alpha[p:q, None] * now[p:q]).sum(axis=0) for p, q in own])
                excess = (np.linalg.norm(d, axis=1) - rest + (n * (rate[:, None] * going - held)).sum(axis=1)).sum()
                turns = np.diff(n, axis=0, prepend=0.0, append=0.0)
                joints = [p for p, _ in own] + [own[-1][1]]
                mobility = (w[joints] * (turns**2).sum(axis=1)).sum()
                soft = sum(alpha[p:q].sum() for p, q in own) / h**2
                if excess > 0.0:
                    impulse = excess / ((1.0 + (rate * rest).sum() / rest.sum()) * mobility + soft)
                    moved[joints] += impulse * w[joints, None] * turns
                    for (p, q), along in zip(own, n, strict=True):
                        now[p:q] += impulse / h**2 * along
    assert scheme.displacement.numpy() == pytest.approx(moved, abs=1e-12)
    assert springs.flat_force.numpy()[places] == pytest.approx(now[spring], abs=1e-9)


def began(warm_start: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacements and forces after the spans of a step, of rumpled cloths in two worlds."""
    grids = [wc.Cloth.grid((0.5, 0.4), shape, pins="left") for shape in ((29, 23), (50, 37))]
    model = wc.Model.build_worlds([([cloth], []) for cloth in grids], precision="float64", device="cpu")
    rng, shape = np.random.default_rng(5), (model.particle_count, 3)
    model.particle_q.assign(1.1 * model.particle_q.numpy() + rng.normal(0.0, 0.004, shape))
    sim = wc.Simulation(model, "xpbd", integrator_options={"warm_start": warm_start})
    scheme = sim.integrator
    scheme.displacement.assign(rng.normal(0.0, 0.002, shape) * (model.particle_inv_mass.numpy() > 0.0)[:, None])
    for sweep in scheme.sweeps:
        sweep.flat_force.assign(rng.normal(size=len(sweep.flat_force)))
    for part, turn in scheme.pieces(sim.state, 0.003):
        if part in scheme._span_parts:
            part.solve(turn, scheme.displacement)
    return scheme.displacement.numpy(), np.concatenate([sweep.flat_force.numpy() for sweep in scheme.sweeps])


@pytest.mark.parametrize("warm_start", [0.0, 0.5])
def test_eight_spans_at_once_are_the_same_as_one_by_one(warm_start):
    moved, force = began(warm_start)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Spans, "_in_lanes", Spans._one_by_one)
        expected, expected_force = began(warm_start)
    assert np.abs(moved).max() > 0.003
    np.testing.assert_allclose(moved, expected, atol=1e-13)
    np.testing.assert_allclose(force, expected_force, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("kept", [0.0, 0.25])
def test_forces_of_units_are_spread_the_same(kept):
    kernels, rng = KernelSet("float64"), np.random.default_rng(1)
    unit = wp.array(rng.integers(-2, 20, 80).clip(-1), dtype=wp.int32)
    ours, force = rng.normal(size=(20, 3)), rng.normal(size=240)
    if kept == 0.0:
        force[:] = np.nan  # nothing of it may count
    of_unit = wp.array(ours, dtype=kernels.precision.vec3)
    one, eight = (wp.array(force, dtype=wp.float64) for _ in range(2))
    wp.launch(kernels.spans.spread_units, dim=80, inputs=[0, unit, 8, of_unit, kept, one])
    wp.launch(kernels.span_lanes.spread_entries, dim=10, inputs=[0, unit, of_unit, kept, eight])
    added = np.where(unit.numpy()[:, None] < 0, 0.0, ours[unit.numpy()]).reshape(10, 8, 3).transpose(0, 2, 1).ravel()
    np.testing.assert_allclose(one.numpy(), added if kept == 0.0 else added + kept * force, rtol=1e-14)
    np.testing.assert_array_equal(one.numpy(), eight.numpy())


@given(
    st.lists(st.tuples(st.integers(0, 50), st.integers(1, 5)), min_size=1, max_size=60),
    st.sampled_from([1, 4, 8]),
)
def test_groups_have_spans_of_one_length_and_memory_of_their_own(spans, lanes):
    before = np.array([(first, first + length) for first, length in spans])
    after, groups = in_groups(before, lanes)
    assert sorted(map(tuple, after.tolist())) == sorted(map(tuple, before.tolist()))
    assert groups[:, 1].min() >= 1
    assert groups[:, 1].max() <= lanes
    assert np.array_equal(np.concatenate([np.arange(a, a + n) for a, n, _, _ in groups]), np.arange(len(spans)))
    for first, count, length, _ in groups:
        assert (np.diff(after[first : first + count]) == length).all()
    assert np.array_equal(groups[1:, 3], np.cumsum(3 * lanes * groups[:-1, 2]))


@pytest.mark.parametrize(("iterations", "order"), [(1, (0, 1)), (2, (0, 1, 1, 0)), (3, (0, 1, 0, 1, 1, 0))])
def test_the_last_of_several_sweeps_goes_back(iterations, order):
    h, net = 0.01, chain(2, 0.2)
    x = net["positions"][:, 0]
    moved, force = np.zeros(3), np.zeros(2)
    stiffness, damping, w = h * h * 50.0 / 0.1, h * 0.02 / 0.1, 2.0 / 0.01
    for s in order:
        ends = np.array([s, s + 1])
        moved[ends] -= force[s] / 0.01 * np.array([1.0, -1.0])
        going = moved[s + 1] - moved[s]
        force[s] = (stiffness * (x[s + 1] - x[s] + going - 0.1) + damping * going) / (1.0 + (stiffness + damping) * w)
        moved[ends] += force[s] / 0.01 * np.array([1.0, -1.0])
    assert stepped(net, h, iterations=iterations, rows=False)[:, 0] == pytest.approx(x + moved, abs=1e-12)
