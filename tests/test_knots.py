"""Knots: what a step leaves through each other goes on as one, in its own world alone, and heaps come undone."""

import numpy as np
import warp as wp

import warpcloth as wc
from warpcloth.contact.cloth_contact import ClothContact
from warpcloth.state import State

GAP, SPAN = 1e-3, 5e-3
HEAVY = wc.Fabric(areal_density=0.4)


def crossing_sheets(pins: list[str]) -> tuple[ClothContact, State, State]:
    """Two worlds, in each a small sheet above another, and the end of a step in which it has passed through that."""
    below = wc.Cloth.grid((0.02, 0.02), (3, 3), pins=pins, name="below")
    above = wc.Cloth.grid((0.02, 0.02), (3, 3), HEAVY, transform=(0.003, 0.002, GAP), pins=pins)
    model = wc.Model.build_worlds([([below, above], [])] * 2, precision="float64")
    simulation = wc.Simulation(model, "xpbd", contact="all")
    start, end = simulation.state, simulation.state.twin()
    falls = np.tile(np.repeat([0.0, -2.0 * GAP / SPAN], 9), 2)
    velocities = np.column_stack([np.full(36, 0.1), np.zeros(36), falls])
    start.particle_qd.assign(velocities)
    end.particle_qd.assign(velocities)
    end.particle_q.assign(start.particle_q.numpy() + SPAN * velocities)
    cloths = simulation.contact.cloths
    cloths.begin(start, SPAN)
    cloths.before.assign(start.particle_q.numpy())
    return cloths, start, end


def join(cloths: ClothContact, end: State, worlds: list[int]) -> None:
    """As after a step in whose last pass these worlds had pairs through each other."""
    cloths.knots.crossed.world.assign(worlds)
    cloths.knots.crossed.any.fill_(1)
    cloths.knots.join(cloths.before, cloths.now, end)


def test_crossing_cloth_goes_on_as_one_and_keeps_its_momentum():
    """Clusters have velocities that agree with their ways; after that nothing is through anything any more."""
    cloths, start, end = crossing_sheets([])
    mass = cloths.model.particle_mass.numpy()[:18, None]
    wanted, thrown = end.particle_q.numpy().copy(), end.particle_qd.numpy().copy()
    join(cloths, end, [1, 0])
    ends, speeds = end.particle_q.numpy().copy(), end.particle_qd.numpy().copy()
    assert (ends[:18, 2] != wanted[:18, 2]).sum() > 12
    assert np.allclose(speeds[:18], (ends - start.particle_q.numpy())[:18] / SPAN, rtol=0.0, atol=1e-6)  # fixed point
    for before, after in ((wanted, ends), (thrown, speeds)):
        assert np.allclose((mass * before[:18]).sum(axis=0), (mass * after[:18]).sum(axis=0), rtol=1e-8, atol=1e-12)
    assert np.array_equal(ends[18:], wanted[18:])  # the other world, which has noted nothing
    assert np.array_equal(speeds[18:], thrown[18:])
    join(cloths, end, [1, 0])
    assert np.array_equal(end.particle_q.numpy(), ends)


def test_impacts_are_left_to_the_guard():
    """Sheets that meet at a speed of many contact distances a step."""
    cloths, start, end = crossing_sheets([])
    end.particle_q.assign(start.particle_q.numpy() + 4.0 * (end.particle_q.numpy() - start.particle_q.numpy()))
    wanted = end.particle_q.numpy().copy()
    join(cloths, end, [1, 1])
    assert np.array_equal(end.particle_q.numpy(), wanted)


def test_pairs_with_pins_are_left_to_the_guard():
    """Pins go where they must: nothing that is through their triangles joins them."""
    cloths, _, end = crossing_sheets(["left", "right", "top", "bottom"])
    wanted = end.particle_q.numpy().copy()
    join(cloths, end, [1, 1])
    assert np.array_equal(end.particle_q.numpy(), wanted)  # each triangle has a pin


def test_knots_are_joined_for_a_while_in_worlds_in_which_the_guard_has_held_something():
    knots, left = crossing_sheets([])[0].knots, []
    knots.be_wary(wp.array([0, 1], dtype=wp.int32, device="cpu"))
    for _ in range(32):
        left.append(knots.wary.numpy().tolist())
        knots.begin()
    assert left == [[0, 30 - k] for k in range(31)] + [[0, 0]]


def test_how_long_knots_are_joined_goes_along_with_a_world_and_ends_with_a_reset():
    cloth = wc.Cloth.grid((0.02, 0.02), (3, 3))
    both, left = (wc.Simulation(wc.Model.build_worlds([([cloth], [])] * n), "xpbd", contact="all") for n in (2, 1))
    both.contact.cloths.knots.wary.assign([7, 30])
    left.continue_from(both, [1])
    assert left.contact.cloths.knots.wary.numpy().tolist() == [30]
    both.reset(worlds=[False, True])
    assert both.contact.cloths.knots.wary.numpy().tolist() == [7, 0]


def test_what_an_earlier_pass_left_crossing_is_no_knot_if_a_further_one_parts_it():
    """Only worlds that take part in the further pass are looked at again."""
    cloths, _, _ = crossing_sheets([])
    crossed, further = cloths.knots.crossed.world, cloths.further
    crossed.assign([1, 1])
    further.world_next.assign([0, 1])
    kernel = cloths.kernels.contact_load.begin_pass
    wp.launch(kernel, dim=2, outputs=[further, crossed], device=cloths.model.device)
    assert crossed.numpy().tolist() == [1, 0]
    assert further.world_now.numpy().tolist() == [0, 1]
    assert not further.world_next.numpy().any()


def test_a_heap_of_silk_comes_undone():
    """Silk slides off a ball. Without knots particles are held back 94 times, the same again and again, not 4."""
    silk = wc.library_fabric("silk")
    cloth = wc.Cloth.grid((0.4, 0.4), (24, 24), silk, transform=(-0.09, -0.08, 0.33))
    things = [wc.Sphere((0.0, 0.0, 0.12), 0.12, friction=0.13), wc.Plane(friction=0.5)]
    heap = wc.Simulation(wc.Model.build([cloth], things), "xpbd", contact="all")
    heap.run(30, fps=24)
    metrics = heap.metrics()
    assert metrics["intersections"] == 0
    assert 0 < metrics["contact_held"] < 50
    assert metrics["max_strain"] < 0.3
