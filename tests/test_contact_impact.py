"""Impacts: the friction that acts in them, what is counted, and that what they push into solids is put back."""

import numpy as np
import pytest
import warp as wp
from warpcloth.kernels import KernelSet

import warpcloth as wc
from warpcloth.contact.cloth_contact import ClothContact
from warpcloth.state import State

SPAN = 0.01  # [s]


def test_only_what_was_pushed_into_a_solid_of_its_world_is_put_back():
    """Two worlds with a sheet of four particles each; the ball is in the first one."""
    cloth, ball = wc.Cloth.grid((0.1, 0.1), (2, 2), wc.Fabric(thickness=0.01)), wc.Sphere((0.0, 0.0, 1.0), 0.2)
    model = wc.Model.build_worlds([([cloth], [ball]), ([cloth], [])], device="cpu", precision="float64")
    reach = 0.2 + 0.005 + model.shapes.shapes.thickness.numpy()[0]
    offset = reach - 0.2
    heights = np.array([0.1, 0.1, 0.2 + 0.9 * offset, 0.2 + 0.995 * offset, 0.1, 0.1, 0.1, 0.1])
    now = np.column_stack([np.zeros(8), np.zeros(8), 1.0 + heights])
    before = now + np.array([0.0, 0.0, 0.01])
    before[1] = now[1]  # was not pushed
    model.shapes.place(model.tracks, wp.zeros(2, dtype=wp.float64, device="cpu"), 0.0)
    out = wp.array(now, dtype=model.vec3, device="cpu")
    wp.launch(
        model.kernels.contact_impact.keep_out,
        dim=8,
        inputs=[
            0, model.particle_world, model.particle_radius, model.shapes.shapes,
            wp.array(before, dtype=model.vec3, device="cpu"), model.shapes.end,
        ],
        outputs=[out],
        device="cpu",
    )  # fmt: skip
    expected = heights.copy()
    expected[[0, 2]] = reach  # the fourth one is near enough to its surface
    assert out.numpy()[:, 2] - 1.0 == pytest.approx(expected)


def rounds_after(rounds: int, impacts: int, most: int = 100) -> tuple[int, int, int, list[int]]:
    """Impacts and rounds after a round, what remains, and the metrics, where 5 impacts and 7 rounds have been."""
    counted, remaining, number = (wp.array([n], dtype=wp.int32, device="cpu") for n in (impacts, -1, rounds))
    counts = wp.array([1, 2, 5, 7], dtype=wp.int32, device="cpu")
    kernel = KernelSet("float64").contact_impact.count_round
    wp.launch(kernel, dim=1, inputs=[most], outputs=[counted, remaining, number, counts], device="cpu")
    return (*(int(array.numpy()[0]) for array in (counted, number, remaining)), counts.numpy().tolist())


def test_metrics_tell_all_impacts_and_the_most_rounds_at_once():
    assert rounds_after(1, 3) == (3, 2, 3, [1, 2, 8, 7])
    assert rounds_after(7, 3) == (3, 8, 3, [1, 2, 8, 8])
    assert rounds_after(7, 0) == (0, 7, 0, [1, 2, 5, 7])  # the end of it
    assert rounds_after(100, 3) == (0, 101, 3, [1, 2, 8, 101])  # what remains is held back


def struck(thrown: tuple[float, float, float], pins: list[str]) -> tuple[ClothContact, State]:
    """A sheet with this velocity [m/s] at the end of an interval of 10 ms in which a plate has come through it."""
    corners = np.array([[-0.5, -0.5, -0.05], [0.5, -0.5, -0.05], [0.5, 0.5, -0.05], [-0.5, 0.5, -0.05]])
    up = wc.Motion([0, 1], [[0, 0, 0], [0, 0, 6.0]], np.zeros((2, 3)))
    plate = wc.MeshObstacle(corners, [[0, 1, 2], [0, 2, 3]], friction=0.4, motion=up)
    sheet = wc.Cloth.grid((0.4, 0.4), (6, 6), wc.Fabric(thickness=0.004, friction=0.1), pins=pins)
    model = wc.Model.build([sheet], [plate], precision="float64")
    sim = wc.Simulation(model, "xpbd", gravity=(0, 0, 0), substeps=1, contact="all")
    cloths, state = sim.contact.cloths, sim.state
    state.particle_qd.assign(np.where(model.particle_inv_mass.numpy()[:, None] > 0.0, thrown, 0.0))
    cloths.begin(state, SPAN)
    state.particle_q.assign(model.particle_q.numpy() + SPAN * state.particle_qd.numpy())
    model.shapes.place(model.tracks, state.world_time, SPAN)
    cloths.surface.place(state.particle_q, model.shapes.end, cloths.now)
    return cloths, state


def test_friction_of_an_impact_is_coulombs():
    """By the geometric mean of both coefficients, 0.2, and what the plate at 6 m/s gives."""
    cloths, state = struck((2.0, 0.0, 0.0), [])
    cloths.end(state, SPAN)
    velocity = state.particle_qd.numpy().mean(axis=0)
    assert velocity[2] == pytest.approx(6.0, rel=0.02)
    assert (2.0 - velocity[0]) / velocity[2] == pytest.approx(0.2, rel=0.02)
    found = cloths.metrics()
    assert found["contact_rounds"] == cloths.rounds.numpy()[0] < found["contact_impacts"]


def test_pairs_without_a_free_side_are_counted_once_in_all_rounds():
    cloths, state = struck((0.0, 0.0, 0.0), ["left"])
    cloths.finder.measure_drift(cloths.start, cloths.now)
    counts = []
    for _ in range(3):
        cloths.met.fill_(1)
        cloths._part(state, SPAN)
        counts.append(cloths.metrics()["contact_pinched"])
    assert counts[0] > 0
    assert counts == [counts[0]] * 3
    assert cloths.metrics()["contact_rounds"] > 1
