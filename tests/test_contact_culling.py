"""Triangles that are told apart: by their gap on all of their way and, where that is only foreseen, by more."""

import numpy as np
import pytest
import warp as wp
from warpcloth.kernels import KernelSet

TRIANGLE = np.array([(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0)])
MARGIN = 0.01
triangles_apart = KernelSet("float32").contact_culling.triangles_apart


@wp.kernel
def tell(
    # State in
    start: wp.array(dtype=wp.vec3),
    end: wp.array(dtype=wp.vec3),
    margin: float,
    leeway: float,
    # Out
    apart_out: wp.array(dtype=wp.int32),
):
    if triangles_apart(wp.vec3i(0, 1, 2), wp.vec3i(3, 4, 5), start, end, margin, leeway):
        apart_out[0] = 1


def apart(begin: float, end: float, leeway: float = 1.0, drift: float = 0.0) -> bool:
    """Of two triangles one above the other, with these gaps [m]; both move by ``drift`` [m] besides."""
    ways = []
    for gap, moved in ((begin, 0.0), (end, drift)):
        ways.append(np.concatenate([TRIANGLE, TRIANGLE + np.array([0.0, 0.0, gap])]) + moved)
    out = wp.zeros(1, dtype=wp.int32, device="cpu")
    arrays = [wp.array(way, dtype=wp.vec3, device="cpu") for way in ways]
    wp.launch(tell, 1, inputs=[*arrays, MARGIN, leeway], outputs=[out], device="cpu")
    return bool(out.numpy()[0])


@pytest.mark.parametrize(("begin", "end"), [(0.05, 0.0101), (0.0101, 0.05)])
def test_what_stays_further_than_the_margin_is_apart(begin, end):
    assert apart(begin, end)
    assert apart(end, begin, drift=0.5)  # what both do is no motion to each other
    assert not apart(begin, 0.0099)
    assert not apart(0.0099, begin)
    assert not apart(begin, -0.05)  # it passes through


@pytest.mark.parametrize("leeway", [0.25, 0.5])
def test_where_the_end_is_foreseen_some_of_the_motion_to_each_other_counts(leeway):
    begin, end = 0.09, 0.03
    needed = MARGIN + leeway * (begin - end)
    assert apart(begin, end)
    assert apart(begin, end, leeway) == (end > needed)
    assert apart(0.03, 0.03, leeway, drift=0.5)
