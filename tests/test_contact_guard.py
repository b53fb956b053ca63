"""The guard's kernels one by one: who is carried by what, and how fast what is held back goes on."""

from typing import Any

import numpy as np
import pytest
import warp as wp

import warpcloth as wc

RADIUS = 0.005
TURN = wc.Motion([0.0, 1.0], [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], np.zeros((2, 3)))
FREE, REST = -1, 0  # carriers


def cloth() -> wc.Cloth:
    return wc.Cloth.grid((0.1, 0.1), (2, 2), wc.Fabric(thickness=2.0 * RADIUS))


@pytest.fixture(scope="module")
def model() -> wc.Model:
    """Two worlds: a ball that rests; the same, and one that moves."""
    rests, moves = wc.Sphere((0.0, 0.0, 0.0), 0.2), wc.Sphere((1.0, 0.0, 0.0), 0.2, motion=TURN)
    return wc.Model.build_worlds([([cloth()], [rests]), ([cloth()], [rests, moves])], precision="float64")


def places(model: wc.Model, moved: Any = None) -> wp.array:
    """Of the carriers: of what rests, and of each obstacle, which is ``moved`` by so much [m]."""
    kind = model.kernels.shapes.Placement
    values = np.zeros(1 + model.shapes.count, kind.numpy_dtype())
    values["rotation"] = np.eye(3)
    values["position"][1:] = np.array([(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])[: model.shapes.count]
    if moved is not None:
        values["position"][1:] += moved
    return wp.array(values, dtype=kind, device=model.device)


def limited(model: wc.Model, ends: np.ndarray, fraction: float, carrier: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Fractions, carriers and the number of changes after a look at the shapes."""
    n = model.particle_count
    fractions, carriers = (wp.full(n, v, dtype=t) for v, t in ((fraction, wp.float64), (carrier, wp.int32)))
    changed = wp.zeros(1, dtype=wp.int32)
    wp.launch(
        model.kernels.contact_guard.limit_by_shapes,
        dim=n,
        inputs=[
            model.particle_world, model.particle_radius, model.shapes.shapes,
            wp.array(ends, dtype=model.vec3), wp.clone(fractions), wp.clone(carriers), places(model),
        ],
        outputs=[fractions, carriers, changed],
    )  # fmt: skip
    return fractions.numpy(), carriers.numpy(), int(changed.numpy()[0])


def test_what_would_end_in_a_shape_goes_home_and_then_with_it(model):
    """Of eight particles one in each world ends in a ball, the second world's in the one that moves."""
    ends = np.tile([5.0, 0.0, 0.0], (8, 1))
    ends[1], ends[6] = (0.0, 0.0, 0.2), (1.0, 0.0, 0.2)
    inside = np.isin(np.arange(8), [1, 6])
    fractions, carriers, changed = limited(model, ends, 0.5, FREE)
    assert fractions.tolist() == np.where(inside, 0.0, 0.5).tolist()
    assert (carriers.tolist(), changed) == ([FREE] * 8, 2)
    _, carriers, changed = limited(model, ends, 0.0, FREE)
    assert carriers.tolist() == [FREE, REST, FREE, FREE, FREE, FREE, 3, FREE]
    assert changed == 2
    _, carriers, changed = limited(model, ends, 0.0, REST)
    assert carriers.tolist() == [REST, REST, REST, REST, REST, REST, 3, REST]
    assert changed == 1
    fractions, _, changed = limited(model, ends, 1.0, FREE)  # they meet nothing: obstacles answer later
    assert (fractions.tolist(), changed) == ([1.0] * 8, 0)


def test_half_of_the_contact_distance_is_left(model):
    distance = RADIUS + model.shapes.shapes.thickness.numpy()[0]
    ends = np.tile([5.0, 0.0, 0.0], (8, 1))
    ends[0], ends[1] = ((0.0, 0.0, 0.2 + share * distance) for share in (0.49, 0.51))
    assert limited(model, ends, 0.5, FREE)[0].tolist() == [0.0] + [0.5] * 7


def test_what_is_held_back_keeps_that_share_of_its_speed_and_takes_its_carriers_for_the_rest(model):
    kernels, n, span, way = model.kernels, model.particle_count, 0.01, np.array([0.0, 0.0, 0.03])
    clusters = kernels.contact_clusters.Clusters()
    clusters.root, clusters.size = (wp.zeros(n, dtype=wp.int32) for _ in range(2))
    clusters.mass, clusters.way = wp.zeros(n, dtype=wp.int64), wp.zeros((n, 3), dtype=wp.int64)
    start, speed = model.particle_q.numpy(), np.tile([2.0, 0.0, -4.0], (n, 1))
    ends, counts = start + 0.001, wp.zeros(4, dtype=wp.int32)
    fractions, carriers = np.array([0.25, 0.0, 1.0, 0.5] * 2), [3, 3, 3, REST] * 2
    q, qd = wp.array(start, dtype=model.vec3), wp.array(speed, dtype=model.vec3)
    wp.launch(
        kernels.contact_guard.apply_limit,
        dim=n,
        inputs=[
            0, wp.array(start, dtype=model.vec3), wp.array(ends, dtype=model.vec3),
            wp.array(fractions, dtype=wp.float64), wp.array(carriers, dtype=wp.int32), clusters, places(model),
            places(model, way), span,
        ],
        outputs=[q, qd, counts],
    )  # fmt: skip
    carried = np.where(np.array(carriers)[:, None] == 3, way, 0.0) / span
    share = fractions[:, None]
    assert qd.numpy() == pytest.approx(share * speed + (1.0 - share) * carried)
    assert q.numpy() == pytest.approx(np.where(share < 1.0, ends, start))
    assert counts.numpy().tolist() == [6, 0, 0, 0]


def test_a_cluster_goes_by_the_mean_motion_of_its_mass_be_that_tons():
    """Four particles of 2.5 t each, of which the first three meet, move by 0, 0.1, 0.2 and 0.3 m."""
    heavy = wc.Fabric(areal_density=1e6)
    model = wc.Model.build([wc.Cloth.grid((0.1, 0.1), (2, 2), heavy)], device="cpu", precision="float64")
    clusters = model.kernels.contact_clusters.Clusters()
    clusters.root, clusters.size = (wp.zeros(4, dtype=wp.int32) for _ in range(2))
    clusters.mass, clusters.way = wp.zeros(4, dtype=wp.int64), wp.zeros((4, 3), dtype=wp.int64)
    start, parent = model.particle_q, wp.array([2, 2, 2, 3], dtype=wp.int32)
    moved = start.numpy() + np.outer([0.0, 0.1, 0.2, 0.3], (0.0, 0.0, 1.0))
    now, ends = (wp.array(moved, dtype=model.vec3) for _ in range(2))
    find = model.kernels.contact_clusters.find_clusters
    wp.launch(find, dim=4, inputs=[model.particle_inv_mass, start, now, parent], outputs=[clusters])
    fraction, carrier = wp.zeros(4, dtype=wp.float64), wp.full(4, FREE, dtype=wp.int32)
    rests = [places(model), places(model)]
    inputs = [0, start, now, fraction, carrier, clusters, *rests]
    wp.launch(model.kernels.contact_guard.find_ends, dim=4, inputs=inputs, outputs=[ends])
    way = ends.numpy() - start.numpy()
    assert way[:, 2] == pytest.approx([0.1, 0.1, 0.1, 0.0])


def test_each_group_of_pins_that_moves_is_a_carrier_of_its_own():
    """After the obstacles; about the middle of its pins, at the time of its world."""
    spin = wc.Motion([0.0, 1.0], [[0.0, 0.0, 0.0], [0.2, 0.0, 0.4]], [[0.0, 0.0, 0.0], [0.0, 1.2, 0.0]])
    pins = [wc.pin("left", motion=TURN), wc.pin("right", motion=spin)]
    held = wc.Cloth.grid((0.2, 0.1), (3, 2), transform=(0.0, 0.0, 0.5), pins=pins)
    sim = wc.Simulation(wc.Model.build([held], [wc.Plane()], device="cpu"), "xpbd", contact="all", substeps=4)
    hold, state = sim.contact.cloths.hold, sim.state
    state.world_time.fill_(0.5)
    out = wp.zeros_like(hold._place_from)
    sim.contact.place(state, 0.0)
    hold._place(state, out)
    found = out.numpy()[2:]
    for place, pin in zip(found, held.pins, strict=True):
        matrix = pin.motion.matrix(0.5, held.points[pin.indices].mean(axis=0))
        assert place["position"] == pytest.approx(matrix[:3, 3], abs=1e-6)
        assert place["rotation"] == pytest.approx(matrix[:3, :3], abs=1e-6)


def test_free_particles_in_solids_of_their_world_are_pinched():
    """Pins are led where they are, and rounding is no depth."""
    ball = wc.Sphere((0.0, 0.0, 0.0), 0.2)
    held = wc.Cloth.grid((0.1, 0.1), (2, 2), pins=[[0]])
    model = wc.Model.build_worlds([([held], [ball]), ([held], [])], precision="float64")
    heights = np.array([0.1, 0.1, 0.2 - 0.5e-4, 0.2 - 2e-4] * 2)
    q = wp.array(np.outer(heights, (0.0, 0.0, 1.0)), dtype=model.vec3)
    model.shapes.place(model.tracks, wp.zeros(2, dtype=wp.float64), 0.0)
    counts = wp.zeros(4, dtype=wp.int32)
    solids = [model.particle_inv_mass, model.particle_world, model.shapes.shapes]
    wp.launch(
        model.kernels.contact_guard.count_pinched,
        dim=8,
        inputs=[0, *solids, q, model.shapes.end],
        outputs=[counts],
    )
    assert counts.numpy().tolist() == [0, 2, 0, 0]
