"""Ways of triangles: boxes that move, whether two of them meet, and what is known of later ones."""

from collections.abc import Callable

import numpy as np
import pytest
import warp as wp
from warpcloth.kernels import KernelSet


@pytest.fixture(scope="module")
def meet() -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    ways = KernelSet("float32").contact_ways
    way_type, may_meet = ways.Way, ways.may_meet

    @wp.kernel(enable_backward=False, module="unique")
    def ask(a: wp.array(dtype=way_type), b: wp.array(dtype=way_type), stray: float, out: wp.array(dtype=wp.int32)):
        i = wp.tid()
        out[i] = wp.where(may_meet(a[i], b[i], stray), 1, 0)

    def asked(a: np.ndarray, b: np.ndarray, stray: float) -> np.ndarray:
        out = wp.zeros(len(a), dtype=wp.int32, device="cpu")
        boxes = [
            wp.array(np.ascontiguousarray(x, np.float32).view(way_type.numpy_dtype()).ravel(), dtype=way_type)
            for x in (a, b)
        ]
        wp.launch(ask, len(a), [*boxes, stray], [out], device="cpu")
        return out.numpy().astype(bool)

    return asked


@pytest.mark.parametrize("stray", [0.0, 0.25])
def test_boxes_meet_if_they_overlap_at_any_time_of_their_ways(meet, stray):
    """Against overlaps at many times; ways that miss each other by less than those tell are left out."""
    rng = np.random.default_rng(0)
    middle, half = rng.uniform(-1.0, 1.0, (2, 20_000, 2, 3)), rng.uniform(0.05, 0.4, (2, 20_000, 2, 3))
    low, high = middle - half, middle + half
    a, b = (
        np.stack([low[k, :, 0], high[k, :, 0], low[k, :, 1], high[k, :, 1]], axis=1).reshape(-1, 12) for k in (0, 1)
    )
    t = np.linspace(0.0, 1.0, 401)[:, None, None]
    lows, highs = ([(1.0 - t) * x[k, :, 0] + t * x[k, :, 1] for k in (0, 1)] for x in (low, high))
    motion = np.diff(middle, axis=2)[:, :, 0]
    nearer = stray * np.linalg.norm(motion[0] - motion[1], axis=-1)
    gaps = np.maximum(lows[0] - highs[1], lows[1] - highs[0]).max(axis=-1) - t[..., 0] * nearer
    gap = gaps.min(axis=0)
    clear = np.abs(gap) > 0.01
    assert np.array_equal(meet(a, b, stray)[clear], gap[clear] < 0.0)
    apart_at_both_ends = gaps[[0, -1]].min(axis=0) > 0.0
    assert 0.1 < (gap[apart_at_both_ends] < 0.0).mean() < 0.9
    assert clear.mean() > 0.9


@pytest.mark.parametrize("ahead", [0.0, 10.0], ids=["moving", "standing"])
def test_ways_that_are_held_meet_only_where_known_ways_do(ahead):
    """Boxes that shrink or shift within what is known, and go at other speeds than it."""
    ways, rng, count, room, stray = KernelSet("float32").contact_ways, np.random.default_rng(0), 1_000_000, 0.05, 0.25
    way_type, holds, known_way, may_meet = ways.Way, ways.holds, ways.known_way, ways.may_meet
    low, size = rng.uniform(0.0, 1.5, (2, count, 2, 3)), rng.uniform(0.4, 0.6, (2, count, 1, 3))
    first = np.stack([low, low + size], axis=3).reshape(2, count, 12)
    inwards = np.repeat([1.0, -1.0, 1.0, -1.0], 3) * rng.choice(
        [-0.99 * room, -0.99 * room, 0.0, room, 0.2], first.shape
    )
    later = first + inwards

    @wp.kernel(enable_backward=False, module="unique")
    def ask(first: wp.array2d(dtype=way_type), later: wp.array2d(dtype=way_type), out: wp.array(dtype=wp.int32)):
        i = wp.tid()
        a = known_way(first[0, i], wp.vec3(), stray, room, ahead)
        b = known_way(first[1, i], wp.vec3(), stray, room, ahead)
        if holds(a, later[0, i], stray, room) and holds(b, later[1, i], stray, room):
            out[i] = wp.where(may_meet(later[0, i], later[1, i], stray), 1, 0) + wp.where(may_meet(a, b, stray), 2, 4)

    out = wp.zeros(count, dtype=wp.int32, device="cpu")
    boxes = [
        wp.array(np.ascontiguousarray(x, np.float32).view(way_type.numpy_dtype())[..., 0], dtype=way_type)
        for x in (first, later)
    ]
    wp.launch(ask, count, boxes, [out], device="cpu")
    tally = np.bincount(out.numpy(), minlength=6)
    assert tally[3] > 100 < tally[4]  # held and meeting, and held and known to be apart
    assert tally[5] == 0
