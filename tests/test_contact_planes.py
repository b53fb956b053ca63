"""Planes that the caller lists: several for a particle, moving ones, rows that are no longer in use, and pins."""

import numpy as np
import pytest

import warpcloth as wc
from warpcloth.state import State

FABRIC = wc.Fabric(thickness=0.002)
RADIUS, DT = 0.001, 0.01


def patch(pins: list[int] | None = None) -> tuple[wc.Model, wc.ContactPlanes, State, State]:
    """Four particles at rest, the first at the origin, and room for three contacts."""
    cloth = wc.Cloth.grid((0.1, 0.1), (2, 2), FABRIC, pins=pins, transform=(0.05, 0.05, 0.0))
    model = wc.Model.build([cloth], device="cpu", precision="float64")
    start = State.of(model)
    return model, wc.ContactPlanes(model, capacity=3), start, start.twin()


def listed(contact: wc.ContactPlanes, normals: list, points: list, velocities: list, particle: int = 0) -> None:
    """One row for each normal, all of one particle, without friction."""
    used = len(normals)
    contact.count.fill_(used)
    for name, values in (("normal", normals), ("point", points), ("velocity", velocities)):
        array = getattr(contact, name)
        rows = array.numpy().copy()
        rows[:used] = values
        array.assign(rows)
    contact.particle.assign([particle] * used + [-1] * (3 - used))


def end_of(contact: wc.ContactPlanes, start: State, end: State, elapsed: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Where particles are, and how fast, at the end of a step of ``DT`` in which they would have stood still."""
    end.particle_q.assign(start.particle_q.numpy())
    end.particle_qd.assign(start.particle_qd.numpy())
    contact.respond(start, end, DT, elapsed)
    return end.particle_q.numpy().copy(), end.particle_qd.numpy().copy()


def test_a_particle_leaves_all_of_its_planes():
    _, contact, start, end = patch()
    before = start.particle_q.numpy().copy()
    listed(contact, np.eye(3), 0.01 * np.eye(3), np.zeros((3, 3)))
    contact.list_all()
    ends, _ = end_of(contact, start, end)
    assert ends[0] - before[0] == pytest.approx(0.01 + RADIUS)
    assert np.array_equal(ends[1:], before[1:])


@pytest.mark.parametrize("elapsed", [0.0, 3.0 * DT])
def test_planes_have_gone_on_at_their_velocity(elapsed):
    """Since they were listed, and in the step: a particle is taken along to where its plane is at the end of it."""
    _, contact, start, end = patch()
    before = start.particle_q.numpy().copy()
    listed(contact, [[0, 0, 1]], [before[0] - [0, 0, RADIUS]], [[0, 0, 0.5]])
    contact.list_all()
    ends, speeds = end_of(contact, start, end, elapsed)
    assert ends[0] - before[0] == pytest.approx([0.0, 0.0, 0.5 * (elapsed + DT)])
    assert speeds[0] == pytest.approx([0.0, 0.0, 0.5])


def test_rows_beyond_the_count_and_of_an_earlier_list_are_none():
    _, contact, start, end = patch()
    before = start.particle_q.numpy().copy()
    listed(contact, [[0, 0, 1]], [[0, 0, 0.01]], [[0, 0, 0]])
    contact.list_all()
    assert end_of(contact, start, end)[0][0, 2] == pytest.approx(0.01 + RADIUS)
    contact.count.zero_()
    contact.list_all()
    assert np.array_equal(end_of(contact, start, end)[0], before)


def test_planes_do_not_move_pins():
    _, contact, start, end = patch(pins=[0])
    before = start.particle_q.numpy().copy()
    listed(contact, [[0, 0, 1]], [[0, 0, 0.01]], [[0, 0, 0.5]])
    contact.list_all()
    ends, speeds = end_of(contact, start, end)
    assert np.array_equal(ends, before)
    assert not speeds.any()
