"""The bound on obstacles' speeds, after which contact looks anew, holds for all of their surface."""

import numpy as np
import pytest

import warpcloth as wc
from warpcloth.contact.intervals import fastest

RATE = 2.0  # [rad/s]
SPIN = wc.Motion([0, 1], np.zeros((2, 3)), [[0, 0, 0], [0, 0, RATE]])
AROUND = wc.Motion([0, 1], SPIN.positions, SPIN.rotations, pivot=(0.5, 0, 0))
CORNERS = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.3, 0.4, 0], [0.0, 0.4, 0]])
MESH = wc.MeshObstacle([*CORNERS, CORNERS.mean(axis=0)], [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]], motion=SPIN)


@pytest.mark.parametrize(
    ("obstacle", "reach"),
    [
        (wc.Sphere((0, 0, 0), 0.1, motion=SPIN), 0.1),
        (wc.Sphere((0, 0, 0), 0.1, motion=AROUND), 0.6),  # about a pivot of its own
        (wc.Capsule((-0.3, 0, 0), (0.3, 0, 0), 0.1, motion=SPIN), 0.4),
        (wc.Box((0, 0, 0), (0.6, 0.8, 2.4), motion=SPIN), 1.3),
        (MESH, 0.25),
        (wc.Plane(motion=SPIN), 1.0),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_what_spins_is_as_fast_as_what_is_farthest_from_its_pivot(obstacle, reach):
    assert fastest(obstacle) == pytest.approx(RATE * reach)
