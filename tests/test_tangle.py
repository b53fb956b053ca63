"""What is kept and what is left alone on the way out of intersections, and how far whole pieces go."""

import numpy as np
import pytest
from test_untangle import placed

import warpcloth as wc
from warpcloth.pieces import push_pieces
from warpcloth.state import State
from warpcloth.tangle import Tangle
from warpcloth.untangle import untangle


@pytest.mark.parametrize("height", [0.03, -0.03])
def test_a_whole_piece_takes_the_shortest_way_out_and_its_thickness_more(height):
    """Of a box in its middle, below or above it; found to a 64th of a stride, of which 24 are the sheet's width."""
    sheet, half = wc.Cloth.grid((0.4, 0.4), (8, 8), wc.Fabric(thickness=0.002)), 0.1
    model = wc.Model.build([sheet], [wc.Box((0.01, 0.02, height), (2 * half, 2 * half, 2 * half))], precision="float64")
    tangle = Tangle(model, State.of(model))
    begun = tangle.positions
    assert push_pieces(tangle, 1000) == 1
    assert not tangle.tangled.any()
    way = tangle.positions - begun
    least = half - abs(height)
    assert np.abs(way - [0.0, 0.0, way[0, 2]]).max() < 1e-12
    assert 0.0 <= -np.sign(height) * way[0, 2] - least - 0.002 < 0.4 / 24 / 64


def test_each_world_keeps_the_best_that_was_seen_of_it():
    """Of as many particles too deep in a solid, where they were least deep. Worlds that are left out stay."""
    cloth = wc.Cloth.grid((0.1, 0.1), (2, 2), transform=(0.0, 0.0, -0.02))
    model = wc.Model.build_worlds(3 * [([cloth], [wc.Plane()])], precision="float64")
    tangle = Tangle(model, State.of(model))
    start, world = tangle.positions, model.particle_world.numpy()
    for rise in ((0.01, -0.01, 0.01), (0.005, -0.005, 0.01)):
        moves = np.outer(np.array(rise)[world], (0.0, 0.0, 1.0))
        tangle.place(start + moves, np.array([True, True, False]))
        assert tangle.look().all()
    tangle.back()
    np.testing.assert_array_equal(tangle.positions[:, 2] - start[:, 2], np.array([0.01, 0.0, 0.0])[world])


def test_speeds_neither_count_nor_change():
    """Springs are at work from standstill, however fast cloth is."""
    ends = []
    for velocity in ((0.0, 0.0, 0.0), (0.0, 5.0, 3.0)):
        cloth = wc.Cloth.grid((0.4, 0.4), (9, 9), transform=placed(0.19, 0.0, 0.0), velocity=velocity)
        model = wc.Model.build([cloth], [wc.Sphere((0.0, 0.0, 0.0), 0.2)])
        state = State.of(model)
        done = untangle(model, state)
        assert (done.inside_before > 0, done.inside_after) == (True, 0)
        assert np.array_equal(state.particle_qd.numpy(), model.particle_qd.numpy())
        ends.append(state.particle_q.numpy())
    assert np.array_equal(*ends)


def test_pins_in_a_solid_are_where_they_should_be():
    """As where clothes are fixed to who wears them: nothing to do."""
    cloth = wc.Cloth.grid((0.2, 0.2), (5, 5), pins="bottom", transform=placed(0.09, 0.0, np.pi / 2.0))
    model = wc.Model.build([cloth], [wc.Plane()])
    done = untangle(model, State.of(model))
    assert (done.before, done.inside_before, done.rounds, done.moved_m) == (0, 0, 0, 0.0)
