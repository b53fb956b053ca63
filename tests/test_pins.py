"""Pins: by index, name, box and nearest point; still and moving."""

import numpy as np
import pytest

from warpcloth.cloth import Cloth, pin, pin_box, pin_nearest
from warpcloth.errors import InputError
from warpcloth.model import Model
from warpcloth.motion import Motion
from warpcloth.simulation import Simulation


def test_named_edges_and_corners():
    cloth = Cloth.grid((1, 1), (4, 3), pins=["top_left", "top_right"])
    np.testing.assert_array_equal(cloth.pinned, [8, 11])
    for name, axis, sign in (("left", 0, -1), ("right", 0, 1), ("bottom", 1, -1), ("top", 1, 1)):
        edge = Cloth.grid((1, 1), (4, 3), pins=name)
        np.testing.assert_allclose(edge.points[edge.pinned, axis], sign * 0.5)
        assert len(edge.pinned) == (3 if axis == 0 else 4)
    assert len(Cloth.disc(0.5, 4, pins="rim").pinned) == 24
    np.testing.assert_array_equal(Cloth.disc(0.5, 4, pins="center").pinned, [0])


def test_pins_by_index_box_and_nearest_point():
    lifted = (0, 0, 2.0)
    for pins in (3, [3], np.array([3]), (3, 3), pin([3])):
        np.testing.assert_array_equal(Cloth.grid((1, 1), (4, 4), pins=pins).pinned, [3])
    box = Cloth.grid((1, 1), (5, 5), transform=lifted, pins=pin_box((-0.6, -0.6, 1.9), (-0.4, 0.1, 2.1)))
    np.testing.assert_array_equal(box.pinned, [0, 5, 10])
    near = Cloth.grid((1, 1), (5, 5), transform=lifted, pins=pin_nearest([(0.4, 0.4, 2), (-9, -9, 2)]))
    np.testing.assert_array_equal(near.pinned, [0, 24])
    np.testing.assert_array_equal(Cloth.grid((1, 1), (5, 5), pins=pin_nearest((0, 0, 0))).pinned, [12])


def test_still_pins_are_one_group_and_moving_ones_their_own():
    swing = Motion.keyframes([(0, (0, 0, 0)), (1, (0, 1, 0))])
    cloth = Cloth.grid((1, 1), (4, 4), pins=["bottom_left", 1, "bottom", pin("top_left", swing), pin(15, swing)])
    assert [group.motion for group in cloth.pins] == [None, swing, swing]
    assert [group.indices.tolist() for group in cloth.pins] == [[0, 1, 2, 3], [12], [15]]
    again = Cloth.grid((1, 1), (4, 4), pins=cloth.pins)
    np.testing.assert_array_equal(again.pinned, cloth.pinned)


def test_moving_pins_may_not_overlap_others():
    swing = Motion.keyframes([(0, (0, 0, 0)), (1, (0, 1, 0))])
    with pytest.raises(InputError, match="vertex 12 is in two pins, of which at least one moves"):
        Cloth.grid((1, 1), (4, 4), pins=["left", pin("top", swing)])


def test_each_pin_has_its_own_kind_of_motion():
    """Smooth and linear, looping or not, with as many keys as it likes; whichever comes first."""
    smooth = Motion.keyframes([(0, (0, 0, 0)), (0.5, (0, 0.1, 0.1))], interpolation="smooth")
    loop = Motion.keyframes([(0, (0, 0, 0)), (0.1, (0, 0, 0.1)), (0.15, (0, 0, 0))], loop=True)
    for motions in ((smooth, loop), (loop, smooth)):
        pins = [pin(side, motion=m) for side, m in zip(("left", "right"), motions, strict=True)]
        cloth = Cloth.grid((0.4, 0.4), (4, 4), pins=pins)
        sim = Simulation(Model.build(cloth, precision="float64"))
        sim.run(13)
        x = sim.state.particle_q.numpy()
        for held, motion in zip(cloth.pins, motions, strict=True):
            where = motion.evaluate(cloth.points[held.indices], 13 / 60)
            assert np.allclose(x[held.indices], where, atol=1e-12)
