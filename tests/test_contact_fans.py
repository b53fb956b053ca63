"""Fans that are flat at the start and at the end, and what turns within them on the way."""

import numpy as np
import pytest
import warp as wp
from warpcloth.kernels import KernelSet

from warpcloth.contact.fans import fans_of

ANGLES = (0.0, 60.0, 120.0, 180.0, 240.0, 285.0, 330.0)  # [°] of the spokes of an open fan


def stays_flat(begin: np.ndarray, end: np.ndarray, closed: bool) -> bool:
    """Whether a fan counts as flat while its spokes, of unit length, turn from some angles to others [°]."""
    n = len(begin)
    triangles = np.array([(0, k, k + 1) for k in range(1, n)] + ([(0, n, 1)] if closed else []))
    fans = fans_of(triangles, n + 1)
    assert fans.turns[0] == int(closed)
    ways = []
    for angles in (begin, end):
        turned = np.radians(angles)
        spokes = np.column_stack([np.cos(turned), np.sin(turned), np.zeros(n)])
        ways.append(wp.array(np.concatenate([np.zeros((1, 3)), spokes]), dtype=wp.vec3, device="cpu"))
    arrays = [wp.array(values, dtype=wp.int32, device="cpu") for values in (fans.start, fans.ring, fans.turns)]
    active, found = (wp.full(n + 1, value, dtype=wp.int32, device="cpu") for value in (1, -1))
    inputs = [0, *arrays, *ways, active, 1]
    kernel = KernelSet("float32").contact_fans.find_flat_fans
    wp.launch(kernel, 1, inputs=inputs, outputs=[found], device="cpu")
    return bool(found.numpy()[0])


def flat(first: float, last: float, rest: float = 0.0) -> bool:
    """Of an open fan, whose first and last spoke turn to these angles, all others by ``rest`` [°]."""
    ends = np.array(ANGLES) + rest
    ends[0], ends[-1] = first, last
    return stays_flat(np.array(ANGLES), ends, closed=False)


@pytest.mark.parametrize(
    ("first", "last", "expected"),
    [
        (0.0, 330.0, True),  # it rests
        (-20.0, 330.0, True),  # what is open gets narrower
        (0.0, 350.0, True),
        (20.0, 350.0, True),
        (0.0, 375.0, False),  # the last spoke comes to where the first one is
        (-50.0, 330.0, False),  # the first one to where the last one is, which they might pass at any time
        (-50.0, 300.0, False),  # likewise, although they do not
        (30.0, 375.0, False),
        (-40.0, 345.0, False),
    ],
)
def test_spokes_of_an_open_fan_do_not_pass_its_ends(first, last, expected):
    assert flat(first, last) is expected


def test_an_open_fan_that_turns_as_a_whole_does_not_pass_where_it_began():
    assert flat(45.0, 375.0, 45.0) is False
    assert flat(20.0, 350.0, 20.0) is True
    assert flat(-95.0, 235.0, -95.0) is False


@pytest.mark.parametrize(("turn", "expected"), [(0.0, True), (60.0, True), (105.0, False), (150.0, False)])
def test_a_closed_fan_that_turns_far_is_turned_over_on_its_straight_way(turn, expected):
    """By more than a right angle, though it is flat at both ends."""
    angles = 60.0 * np.arange(6)
    assert stays_flat(angles, angles + turn, closed=True) is expected


@pytest.mark.parametrize(("first", "expected"), [(80.0, True), (100.0, False)])
def test_the_first_spoke_of_an_open_fan_turns_by_less_than_a_right_angle(first, expected):
    begin, end = np.array([0.0, 110.0, 170.0]), np.array([first, 150.0, 200.0])
    assert stays_flat(begin, end, closed=False) is expected
