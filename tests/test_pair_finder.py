"""What may be near is found, whatever is remembered of earlier ways and however few pairs are looked at."""

import itertools
from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

import warpcloth as wc
from warpcloth.contact.fans import BROKEN, CLOSED, OPEN, fans_of
from warpcloth.contact.pair_finder import PairFinder
from warpcloth.contact.pair_list import PairList
from warpcloth.surface import Surface

MARGIN = 0.02


def crumpled(rng, n=9) -> np.ndarray:
    """A square sheet of unit size, folded and rumpled."""
    u, v = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    fold = rng.uniform(2, 9)
    points = np.stack([u, 0.3 * np.cos(fold * v) + 0.1 * v, 0.3 * np.sin(fold * v)], axis=-1).reshape(-1, 3)
    return points + rng.normal(scale=0.3 / n, size=points.shape) * rng.uniform(0, 1)


@pytest.fixture(scope="module")
def finder() -> tuple[PairFinder, PairList, Surface]:
    cloth = wc.Cloth.grid(size=(1, 1), resolution=(9, 9))
    model = wc.Model.build([cloth], [wc.Box((0, 0, -0.4), (0.5, 0.5, 0.2))], precision="float64")
    surface = Surface(model)
    return PairFinder(model, surface), PairList(model, 300_000), surface


def listed(pairs: PairList) -> set[tuple[int, ...]]:
    count = int(pairs.pairs.count.numpy()[0])
    assert count <= pairs.capacity
    rows = np.column_stack([pairs.pairs.kind.numpy()[:count], pairs.pairs.particles.numpy()[:count]])
    found = {tuple(row) for row in rows.tolist()}
    assert len(found) == count  # each once
    return found


def placed(surface, points) -> wp.array:
    array = surface.positions()
    wp.copy(array, wp.array(points, dtype=wp.vec3d, device="cpu"), count=len(points))
    return array


def look(finder, pairs, surface, start, end, fans=True, foreseen=False) -> set[tuple[int, ...]]:
    """What is found; with ``fans``, in sharp folds only."""
    arrays = [placed(surface, points) for points in (start, end)]
    while True:
        finder.look_at_fans(*arrays, finder.everything)
        finder.measure_drift(*arrays)
        flat = finder.flat if fans else wp.zeros_like(finder.flat)
        finder.find(pairs, *arrays, finder.everything, MARGIN, flat, foreseen)
        if not finder.grow():
            return listed(pairs)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), stray=st.floats(0.0, 0.2))
def test_what_is_remembered_does_not_show(finder, seed, stray):
    remember_and_forget(finder, seed, stray)


def test_there_is_something_to_remember(finder):
    assert all(remember_and_forget(finder, seed, 0.1) > 10 for seed in range(3))


def remember_and_forget(finder, seed, stray) -> int:
    """The number of pairs found in the second of two intervals, remembering the first of them and not."""
    rng = np.random.default_rng(seed)
    pairs_of = finder[1:]
    a = crumpled(rng)
    b, c = (a + rng.normal(scale=stray + 1e-9, size=a.shape) * [1, 1, 0.2] for _ in range(2))
    finder[0].forget()
    look(finder[0], *pairs_of, a, b)
    remembered = look(finder[0], *pairs_of, b, c)
    finder[0].forget()
    assert remembered == look(finder[0], *pairs_of, b, c)
    return len(remembered)


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), speed=st.sampled_from([0.01, 0.03, 0.1, 0.3]))
def test_nor_does_it_where_ways_are_foreseen(finder, seed, speed):
    """Interval after interval, each foreseen and then as it was, of two halves that go different ways."""
    rng = np.random.default_rng(seed)
    finder, pairs, surface = finder
    start = crumpled(rng)
    half = start[:, 1:2] > np.median(start[:, 1])
    ways, looks = rng.normal(scale=speed, size=(2, 3)), []
    for _ in range(6):
        ways += rng.normal(scale=0.2 * speed, size=(2, 3))
        way = np.where(half, *ways) + rng.normal(scale=0.002, size=start.shape)
        end = start + way + rng.normal(scale=0.002, size=start.shape)
        looks += [(start, start + way, True), (start, end, False)]
        start = end
    finder.forget()
    remembered = [look(finder, pairs, surface, a, b, foreseen=foreseen) for a, b, foreseen in looks]
    for (a, b, foreseen), found in zip(looks, remembered, strict=True):
        finder.forget()
        assert found == look(finder, pairs, surface, a, b, foreseen=foreseen)


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 0.3))
def test_a_list_with_holes_misses_nothing(finder, seed, share):
    """Some particles move in each of many looks, so that pairs are dropped, and holes filled, again and again."""
    rng = np.random.default_rng(seed)
    pairs_of = finder[1:]
    ways = [crumpled(rng)]
    for _ in range(6):
        moved = rng.random((len(ways[0]), 1)) < share
        ways.append(ways[-1] + moved * rng.normal(scale=0.03, size=ways[0].shape))
    finder[0].forget()
    look(finder[0], *pairs_of, *ways[:2])
    finder[0]._allocate(int(finder[0].known.count.numpy()[0]))  # no more room than there is need of
    remembered = [look(finder[0], *pairs_of, a, b) for a, b in itertools.pairwise(ways)]
    for (a, b), found in zip(itertools.pairwise(ways), remembered, strict=True):
        finder[0].forget()
        assert found == look(finder[0], *pairs_of, a, b)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 0.3))
def test_a_second_look_at_what_changed_is_enough(finder, seed, share):
    finder, pairs, surface = finder
    rng = np.random.default_rng(seed)
    a = crumpled(rng)
    changed = rng.random(len(a)) < share
    b = a + rng.normal(scale=0.02, size=a.shape)
    c = b + changed[:, None] * rng.normal(scale=0.02, size=a.shape)
    mask = np.zeros(surface.particle_count, np.int32)
    mask[: len(a)] = changed
    found = []
    for again in (False, True):
        active = finder.everything if again else wp.array(mask, dtype=wp.int32, device="cpu")
        start, end = placed(surface, a), placed(surface, c)
        grown = True
        while grown:  # from the beginning, as frames are done again
            look(finder, pairs, surface, a, b)
            finder.look_at_fans(start, end, active)
            finder.find(pairs, start, end, active, MARGIN, finder.flat)
            grown = finder.grow()
        found.append(listed(pairs))
    of_changed = {pair for pair in found[1] if mask[list(pair[1:])].any()}
    assert of_changed <= found[0] <= found[1]


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_all_pairs_that_start_near_are_found(finder, seed):
    """Against all pairs of vertices and triangles, by brute force in numpy."""
    points = crumpled(np.random.default_rng(seed))
    triangles = finder[2].tri_indices.numpy()[: finder[2].cloth_tris]
    found = look(*finder, points, points, fans=False)
    expected = set()
    for v in range(len(points)):
        for t in triangles.tolist():
            if (
                v not in t
                and np.all(points[v] > points[t].min(0) - MARGIN)
                and np.all(points[v] < points[t].max(0) + MARGIN)
            ):
                w = np.array(distance_weights(points[[v, *t]]))
                if np.linalg.norm(w @ points[[v, *t]]) < 0.999 * MARGIN:
                    expected.add((0, v, *t))
    assert expected <= found


@settings(max_examples=6)
@given(seed=st.integers(0, 10**6), speed=st.floats(0.0, 0.5))
def test_all_edges_that_come_near_each_other_are_found(finder, seed, speed):
    find_edges(finder, seed, speed)


def test_some_edges_come_near_each_other(finder):
    assert sum(find_edges(finder, seed, 0.25) for seed in range(5)) > 10


def find_edges(finder, seed, speed) -> int:
    """The number of pairs that come near each other; found once each, says brute force at four times of their way."""
    rng = np.random.default_rng(seed)
    start = crumpled(rng)
    end = start + (start[:, :1] < 0.5) * rng.normal(scale=speed, size=3) + rng.normal(scale=0.02, size=start.shape)
    rows = [row for row in look(*finder, start, end, fans=False) if row[0] == 1]
    found = {frozenset((frozenset(row[1:3]), frozenset(row[3:]))) for row in rows}
    assert len(found) == len(rows)
    triangles = finder[2].tri_indices.numpy()[: finder[2].cloth_tris]
    edges = np.unique(np.sort(np.stack([triangles, np.roll(triangles, 1, axis=1)], axis=-1).reshape(-1, 2)), axis=0)
    one, two = (edges[k] for k in np.triu_indices(len(edges), 1))
    free = (one[:, :, None] != two[:, None]).all(axis=(1, 2))
    one, two, near = one[free], two[free], 0
    for s in (0.0, 0.3, 0.6, 1.0):
        points = start + s * (end - start)
        close = edge_distances(points[one], points[two]) < 0.999 * MARGIN
        ends = zip(one[close].tolist(), two[close].tolist(), strict=True)
        expected = {frozenset((frozenset(a), frozenset(b))) for a, b in ends}
        assert expected <= found
        near += len(expected)
    return near


def edge_distances(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Of segments with ends of shape [n, 2, 3]: where lines are nearest if that is within both, else from some end."""
    u, v, r = one[:, 1] - one[:, 0], two[:, 1] - two[:, 0], one[:, 0] - two[:, 0]
    uu, vv, uv, ur, vr = (np.sum(x * y, axis=1) for x, y in ((u, u), (v, v), (u, v), (u, r), (v, r)))
    lines = np.maximum(uu * vv - uv * uv, 1e-12 * uu * vv)
    s, t = (uv * vr - vv * ur) / lines, (uu * vr - uv * ur) / lines
    within = (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    gaps = [np.where(within, np.linalg.norm(r + s[:, None] * u - t[:, None] * v, axis=1), np.inf)]
    for (p, q), k in itertools.product(((one, two), (two, one)), (0, 1)):
        way, ahead = p[:, k] - q[:, 0], q[:, 1] - q[:, 0]
        at = np.clip(np.sum(way * ahead, axis=1) / np.sum(ahead * ahead, axis=1), 0.0, 1.0)
        gaps.append(np.linalg.norm(way - at[:, None] * ahead, axis=1))
    return np.min(gaps, axis=0)


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6), speed=st.floats(0.0, 2.0))
def test_all_pairs_that_come_near_on_their_way_are_found(finder, seed, speed):
    """Halves that fly together, apart or through each other, while all of it moves: by brute force at five times."""
    rng = np.random.default_rng(seed)
    start = crumpled(rng)
    half = start[:, 0] < 0.5
    end = start + rng.normal(scale=speed, size=3) + half[:, None] * rng.normal(scale=0.5 * speed, size=3)
    end += rng.normal(scale=0.02, size=start.shape)
    triangles = finder[2].tri_indices.numpy()[: finder[2].cloth_tris].tolist()
    found = look(*finder, start, end, fans=False)
    for s in np.linspace(0.0, 1.0, 5):
        points = start + s * (end - start)
        for v, t in itertools.product(range(len(points)), triangles):
            if v in t or np.any(points[v] < points[t].min(0) - MARGIN) or np.any(points[v] > points[t].max(0) + MARGIN):
                continue
            if np.linalg.norm(distance_weights(points[[v, *t]]) @ points[[v, *t]]) < 0.999 * MARGIN:
                assert (0, v, *t) in found


def distance_weights(points: np.ndarray) -> np.ndarray:
    """Weights of point minus closest point of the triangle, by minimising over the triangle's border and inside."""
    p, a, b, c = points
    best, weights = np.inf, None
    system = np.stack([b - a, c - a], axis=1)
    (beta, gamma), *_ = np.linalg.lstsq(system, p - a, rcond=None)
    options = [(1 - beta - gamma, beta, gamma)] if min(beta, gamma, 1 - beta - gamma) >= 0 else []
    for k, (x, y) in enumerate(((a, b), (b, c), (c, a))):
        s = np.clip(np.dot(p - x, y - x) / np.dot(y - x, y - x), 0, 1)
        options.append(np.roll((1 - s, s, 0), k))
    for w in options:
        d = np.linalg.norm(p - np.array(w) @ points[1:])
        if d < best:
            best, weights = d, np.array([1, *(-np.array(w))])
    return weights


@settings(max_examples=25)
@given(columns=st.integers(2, 7), rows=st.integers(2, 7))
def test_fans_of_a_grid_are_closed_but_at_its_border(columns, rows):
    triangles = wc.Cloth.grid(size=(columns - 1, rows - 1), resolution=(columns, rows)).triangles
    fans = fans_of(triangles, columns * rows)
    inner = np.zeros((rows, columns), bool)
    inner[1:-1, 1:-1] = True
    assert np.array_equal(fans.turns == CLOSED, inner.ravel())
    assert np.array_equal(fans.turns == OPEN, ~inner.ravel())
    rings = [fans.ring[first:last].tolist() for first, last in pairwise(fans.start)]
    around = [ring + ring[:1] if turns == CLOSED else ring for ring, turns in zip(rings, fans.turns, strict=True)]
    found = sorted((i, a, b) for i, ring in enumerate(around) for a, b in pairwise(ring))
    assert found == sorted((*np.roll(triangle, -k).tolist(),) for triangle in triangles for k in range(3))


@pytest.mark.parametrize("way", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.5)])
def test_all_fans_of_a_level_sheet_are_flat(finder, way):
    u, v = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9))
    sheet = np.stack([u, v, 0.0 * u], axis=-1).reshape(-1, 3)
    look(*finder, sheet, sheet + way)
    assert finder[0].flat.numpy().all()


def test_fans_that_are_none_are_told():
    assert fans_of(np.array([[0, 1, 2], [0, 3, 4]]), 5).turns[0] == BROKEN  # two that share a vertex
    assert fans_of(np.array([[0, 1, 2], [0, 3, 2]]), 4).turns.tolist() == [BROKEN, OPEN, BROKEN, OPEN]  # turned over


@settings(max_examples=100)
@given(seed=st.integers(0, 10**6))
def test_flat_fans_do_not_touch_themselves_on_their_way(finder, seed):
    """No edge opposite the centre passes a triangle that it shares no vertex with, at any time in between."""
    rng = np.random.default_rng(seed)
    pairs, surface = finder[1:]
    start = crumpled(rng)
    end = start + rng.normal(scale=0.1, size=start.shape) * rng.uniform(0, 1)
    look(finder[0], pairs, surface, start, end)
    triangles = surface.tri_indices.numpy()[: surface.cloth_tris]
    for centre in (40, 4, 8):  # inside, on an edge, in a corner
        fan = [t.tolist() for t in triangles if centre in t]
        apart = [(t, u) for t in fan for u in fan if len({*t} & {*u}) == 1]
        ways = (start + s * (end - start) for s in np.linspace(0, 1, 9))
        crossed = any(_rim_crosses(points, centre, t, u) for points in ways for t, u in apart)
        assert not (finder[0].flat.numpy()[centre] and crossed)


def _rim_crosses(points: np.ndarray, centre: int, t: list[int], u: list[int]) -> bool:
    """Whether the edge of t opposite the centre passes through triangle u."""
    p, q = (points[i] for i in t if i != centre)
    a, b, c = points[u]

    def volume(*x):
        return np.linalg.det(np.array(x[1:]) - x[0])

    if volume(a, b, c, p) * volume(a, b, c, q) >= 0:
        return False
    signs = [volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)]
    return min(signs) > 0 or max(signs) < 0
