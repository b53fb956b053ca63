"""Open fans that are flat at the start and at the end, and what turns within them on the way."""

import numpy as np
import pytest
import warp as wp

import warpcloth as wc
from warpcloth.contact.fans import fans_of

ANGLES = (0.0, 60.0, 120.0, 180.0, 240.0, 285.0, 330.0)  # [°] of the spokes of an open fan


def flat(first: float, last: float, rest: float = 0.0) -> bool:
    """Whether it counts as flat while its first and last spoke turn to these angles, all others by ``rest`` [°]."""
    ends = np.array(ANGLES) + rest
    ends[0], ends[-1] = first, last
    triangles = np.array([(0, k, k + 1) for k in range(1, len(ANGLES))])
    fans = fans_of(triangles, len(ANGLES) + 1)
    assert fans.turns[0] == 0
    ways = []
    for angles in (ANGLES, ends):
        turned = np.radians(angles)
        spokes = np.column_stack([np.cos(turned), np.sin(turned), np.zeros(len(angles))])
        ways.append(wp.array(np.concatenate([np.zeros((1, 3)), spokes]), dtype=wp.vec3, device="cpu"))
    model = wc.Model.build([wc.Cloth.grid((0.1, 0.1), (2, 2))], device="cpu")
    start, turns = (wp.array(values, dtype=wp.int32, device="cpu") for values in (fans.start, fans.turns))
    spokes = wp.array(fans.spokes, dtype=wp.vec2i, device="cpu")
    active, found = (wp.full(len(ANGLES) + 1, value, dtype=wp.int32, device="cpu") for value in (1, -1))
    inputs = [0, start, spokes, turns, *ways, active, 1]
    wp.launch(model.kernels.contact_fans.find_flat_fans, 1, inputs=inputs, outputs=[found], device="cpu")
    return bool(found.numpy()[0])


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
