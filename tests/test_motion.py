"""Keyframed motion: held ends, continuity, whole turns, loops, pivots."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from warpcloth.errors import InputError
from warpcloth.motion import Motion
from warpcloth.transforms import as_matrix, placement, rotation_matrix

coordinate = st.floats(-10.0, 10.0)
triple = st.tuples(coordinate, coordinate, coordinate)


@st.composite
def motions(draw) -> Motion:
    gaps = draw(st.lists(st.floats(0.05, 3.0), min_size=1, max_size=5))
    keys = [(t, draw(triple), draw(triple)) for t in np.cumsum(gaps)]
    return Motion.keyframes(keys, interpolation=draw(st.sampled_from(["linear", "smooth"])))


@given(triple)
def test_rotation_matrix_agrees_with_scipy(rotation):
    np.testing.assert_allclose(
        rotation_matrix(np.array(rotation)), Rotation.from_rotvec(rotation).as_matrix(), atol=1e-13
    )


@given(motions())
def test_keys_are_met_and_ends_are_held(motion):
    for time, position, rotation in zip(motion.times, motion.positions, motion.rotations, strict=True):
        p, r = motion.pose(time)
        np.testing.assert_allclose(p, position, atol=1e-12)
        np.testing.assert_allclose(r, rotation_matrix(rotation), atol=1e-12)
    for time, key in ((motion.times[0] - 5.0, 0), (motion.times[-1] + 5.0, -1)):
        np.testing.assert_array_equal(motion.pose(time)[0], motion.positions[key])


@given(motions(), st.floats(0.0, 1.0))
def test_positions_are_continuous(motion, share):
    time = motion.times[0] + share * (motion.times[-1] - motion.times[0])
    steps = np.diff(motion.positions, axis=0) / np.diff(motion.times)[:, None]
    fastest = 1.5 * np.linalg.norm(steps, axis=1).max(initial=0.0)  # smoothstep is 1.5 times as fast halfway
    h = 1e-4
    assert np.linalg.norm(motion.pose(time + h)[0] - motion.pose(time)[0]) <= fastest * h * (1 + 1e-6) + 1e-12


def test_smooth_rests_at_keys_and_is_half_way_in_the_middle():
    motion = Motion.keyframes([(1.0, (0, 0, 0)), (3.0, (2, 0, 4))], interpolation="smooth")
    h = 1e-5
    for key in (1.0, 3.0):
        velocity = (motion.pose(key + h)[0] - motion.pose(key - h)[0]) / (2 * h)
        np.testing.assert_allclose(velocity, 0.0, atol=1e-4)
    np.testing.assert_allclose(motion.pose(2.0)[0], (1, 0, 2))
    np.testing.assert_allclose(motion.pose(1.5)[0], np.array((2, 0, 4)) * (3 * 0.25**2 - 2 * 0.25**3))


def test_several_turns_are_turned_in_full():
    motion = Motion.keyframes([(0.0, (0, 0, 0)), (4.0, (0, 0, 0), (0, 0, 8 * np.pi))])
    point = np.array([[1.0, 0.0, 0.0]])
    for time in np.linspace(0.0, 4.0, 33):
        angle = 2 * np.pi * time
        expected = [[np.cos(angle), np.sin(angle), 0.0]]
        np.testing.assert_allclose(motion.evaluate(point, time, pivot=(0, 0, 0)), expected, atol=1e-12)


def test_loop_repeats_with_the_time_of_the_last_key():
    motion = Motion.keyframes([(0.5, (1, 0, 0)), (1.0, (2, 0, 0)), (2.0, (1, 0, 0))], loop=True)
    for time in np.linspace(0.0, 1.99, 23):
        np.testing.assert_allclose(motion.pose(time + 6.0)[0], motion.pose(time)[0], atol=1e-12)
    np.testing.assert_allclose(motion.pose(2.25)[0], (1, 0, 0))  # before the first key its pose is held


def test_spin_turns_forever_about_its_axis():
    motion = Motion.spin((0, 0, 2), period=0.5)
    for time in (0.0, 0.1, 0.3, 10.1):
        expected = Rotation.from_rotvec([0, 0, 4 * np.pi * time]).as_matrix()
        np.testing.assert_allclose(motion.pose(time)[1], expected, atol=1e-12)


@given(motions(), triple, st.floats(-1.0, 12.0))
def test_matrix_and_evaluate_agree_and_are_rigid(motion, pivot, time):
    points = np.random.default_rng(1).normal(size=(5, 3))
    matrix = motion.matrix(time, pivot)
    moved = motion.evaluate(points, time, pivot)
    np.testing.assert_allclose(moved, points @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-10)
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.testing.assert_allclose(np.linalg.norm(moved[:, None] - moved[None], axis=2), apart, atol=1e-10)


def test_pivot_is_the_centroid_unless_given():
    points = np.array([[1.0, 0, 0], [3.0, 0, 0]])
    half_turn = ((0, 1), np.zeros((2, 3)), [(0, 0, 0), (0, 0, np.pi)])
    np.testing.assert_allclose(Motion(*half_turn).evaluate(points, 1.0), points[::-1], atol=1e-12)
    own = Motion(*half_turn, pivot=(0, 0, 0))
    np.testing.assert_allclose(own.evaluate(points, 1.0, pivot=(9, 9, 9)), -points, atol=1e-12)


def test_still_motion_does_not_move():
    assert not Motion.still().moves
    np.testing.assert_array_equal(Motion.still().matrix(3.0, (1, 2, 3)), np.eye(4))
    assert Motion.keyframes([(0, (0, 0, 0)), (1, (0, 0, 1))]).moves


def test_arrays_cannot_be_changed_and_do_not_alias_the_input():
    times = np.array([0.0, 1.0])
    motion = Motion(times, np.zeros((2, 3)), np.zeros((2, 3)))
    times[1] = -1.0
    assert motion.times[1] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        motion.times[0] = 2.0


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Motion.keyframes([]), "each key must be"),
        (lambda: Motion.keyframes([(0.0,)]), "each key must be"),
        (lambda: Motion.keyframes(3), "each key must be"),
        (lambda: Motion.keyframes([1, 2]), "each key must be"),
        (lambda: Motion.keyframes([(0, (0, 0))]), "positions must be 1 rows of 3 numbers"),
        (lambda: Motion.keyframes([(1, (0, 0, 0)), (1, (0, 0, 0))]), "1 s is followed by 1 s"),
        (lambda: Motion.keyframes([(0, (0, 0, float("nan")))]), "finite"),
        (lambda: Motion.keyframes([(0, (0, 0, 0))], interpolation="smoth"), "did you mean 'smooth'"),
        (lambda: Motion.keyframes([(0, (0, 0, 0))], loop=True), "a loop needs"),
        (lambda: Motion.keyframes([(0, (0, 0, 0))], loop=1), "true or false"),
        (lambda: Motion((), np.zeros((0, 3)), np.zeros((0, 3))), "at least one key"),
        (lambda: Motion.spin((0, 0, 0), 1.0), "axis must not be zero"),
        (lambda: Motion.spin((0, 0, 1), 0.0), "period must be a number greater than 0"),
    ],
)
def test_bad_motion_is_one_sentence(build, words):
    with pytest.raises(InputError, match=words) as caught:
        build()
    message = str(caught.value)
    assert message.endswith(".")
    assert "\n" not in message


def test_transforms_from_what_users_write():
    np.testing.assert_array_equal(as_matrix(None, "t"), np.eye(4))
    np.testing.assert_array_equal(as_matrix((1, 2, 3), "t")[:3, 3], (1, 2, 3))
    matrix = placement((1, 2, 3), (0, 0, np.pi / 2), 2.0)
    np.testing.assert_allclose(matrix @ (1, 0, 0, 1), (1, 4, 3, 1), atol=1e-12)
    np.testing.assert_array_equal(as_matrix(matrix.tolist(), "t"), matrix)
    for bad in (
        (1, 2),
        "x",
        np.zeros((4, 4)),
        np.diag([1, 1, 0, 1]),
        np.ones((3, 3)),
        [[1], [1, 2]],
        np.full((4, 4), np.nan),
    ):
        with pytest.raises(InputError):
            as_matrix(bad, "transform")
