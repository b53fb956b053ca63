"""What one pair of cloth does in one pass, by itself: closed forms of its push, its friction, its impact, its load."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from warpcloth.kernels import KernelSet

KERNELS = KernelSet("float64")
MU, DISTANCE = 0.25, 0.004  # [m]
UP = np.array([0.0, 0.0, 1.0])
WEIGHTS = np.array([1.0, -0.5, -0.3, -0.2])  # a vertex over a triangle
INVERSE_MASS = np.array([500.0, 1000.0, 800.0, 0.0])  # [1/kg], one corner is a pin
MOVE_UNIT, KICK_UNIT, SHARE_UNIT = 2.0**50, 2.0**40, 2.0**40


def array(values: Any, dtype: type = wp.float64) -> wp.array:
    return wp.array(values, dtype=dtype, device="cpu")


class Pair:
    """A vertex ``height`` [m] over a triangle, which is at rest, in a list of pairs of one, and its contact."""

    def __init__(self, depth: float, weights: np.ndarray = WEIGHTS, height: float = DISTANCE, others: float = 0.0):
        """``depth`` [m] of the contact; of others that the particles have part in there are so many."""
        corners = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0]])
        self.start = np.concatenate([[np.abs(WEIGHTS[1:]) @ corners + height * UP], corners])
        self.weights, self.vec3 = weights, KERNELS.precision.vec3
        self.pairs, self.contacts = KERNELS.contact_pairs.Pairs(), KERNELS.contact_pairs.Contacts()
        self.pairs.count, self.pairs.kind = array([1], wp.int32), array([0], wp.int32)
        self.pairs.particles = array([[0, 1, 2, 3]], wp.vec4i)
        self.pairs.side, self.pairs.distance = array([UP], self.vec3), array([DISTANCE])
        self.contacts.weights = array([weights], KERNELS.precision.vec4)
        self.contacts.normal, self.contacts.depth = array([UP], self.vec3), array([depth])
        self.share = array(np.rint(SHARE_UNIT * (1.0 + others) * np.abs(weights)).astype(np.int64), wp.int64)
        self.sums = [wp.zeros((4, 3), dtype=wp.int64, device="cpu") for _ in range(2)]
        self.load, self.lack = KERNELS.contact_load.Load(), wp.zeros(4, dtype=wp.int64, device="cpu")
        self.load.length, self.load.radius = array(np.zeros(4)), array(np.full(4, 0.5 * DISTANCE))
        self.load.world = array(np.zeros(4), wp.int32)

    def moved(self, by: Any) -> wp.array:
        """Positions [m] when the vertex has moved so far."""
        return array(self.start + np.outer([1.0, 0.0, 0.0, 0.0], by), self.vec3)

    def changes(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the particles' positions [m] and velocities [m/s]."""
        return self.sums[0].numpy() / MOVE_UNIT, self.sums[1].numpy() / KICK_UNIT

    def relative(self) -> tuple[np.ndarray, np.ndarray]:
        """The same of the vertex relative to the point below it. Free particles keep their momentum."""
        changes = self.changes()
        for change in changes:
            assert (change[3] == 0.0).all()
            assert np.allclose(change[:3] / INVERSE_MASS[:3, None], np.outer(WEIGHTS[:3], change[0] / 500.0))
        return WEIGHTS @ changes[0], WEIGHTS @ changes[1]


def pushed(pair: Pair, moved: Any, carried: Any, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """What a step of dt [s] changes, in which the vertex has moved, and was carried by its velocity, so far [m]."""
    start, inputs = array(pair.start, pair.vec3), [0, array(INVERSE_MASS), array(np.full(4, MU)), pair.pairs, 1]
    inputs += [start, pair.moved(moved), pair.moved(carried), dt, pair.contacts, pair.share, pair.load]
    kernel = KERNELS.contact_response.push_contacts
    wp.launch(kernel, dim=1, inputs=inputs, outputs=[*pair.sums, pair.lack], device="cpu")
    return pair.relative()


def test_a_push_stops_the_approach_and_gives_back_the_rest_of_the_depth_over_time():
    """By a fifth of it in 0.1 ms. Velocities lose what they brought it, whatever other contacts did to positions."""
    move, kick = pushed(Pair(0.002), [0, 0, -0.001], [0, 0, -0.0004], 1e-4)
    assert move == pytest.approx([0, 0, 0.001 + 0.2 * 0.001])
    assert kick == pytest.approx([0, 0, 0.0004 / 1e-4])
    move, kick = pushed(Pair(0.002), [0, 0, 0.001], [0, 0, 0.001], 1e-4)
    assert move == pytest.approx([0, 0, 0.2 * 0.002])  # what leaves is not held, nor thrown
    assert kick == pytest.approx([0, 0, 0])
    move, kick = pushed(Pair(0.002), [0, 0, -0.005], [0, 0, -0.003], 1e-2)
    assert move == pytest.approx([0, 0, 0.002])  # no further than it lacks
    assert kick == pytest.approx([0, 0, 0.002 / 1e-2])


@pytest.mark.parametrize("others", [0.0, 1.0, 3.0])
def test_friction_of_a_push_is_coulombs(others):
    """Up to μ times what stops the approach, and no more than slips; of what gives back depth there is none."""
    part = 1.0 / (1.0 + others)
    for slip, carried in ((0.003, 0.002), (1e-6, 2e-6)):
        move, kick = pushed(Pair(0.008, others=others), [slip, 0, -0.001], [0, carried, -0.0004], 1e-4)
        push, stop = 0.001, 0.0004
        assert move[:2] == pytest.approx([-min(MU * push, part * slip), 0.0], rel=1e-6)
        assert kick[:2] == pytest.approx([0.0, -min(MU * stop, part * carried) / 1e-4], rel=1e-6)
        assert move[2] == pytest.approx(push + 0.2 * (0.008 * part - push))
        assert kick[2] == pytest.approx(stop / 1e-4)


def struck(
    pair: Pair, moved: Any, velocity: Any, *, rounds: int = 0, inverse_mass: np.ndarray = INVERSE_MASS,
    cloth_particles: int = 4, span: float = 0.01,
) -> None:  # fmt: skip
    """An impact of a vertex that has moved so far [m] in an interval of ``span`` [s], and now has this velocity."""
    speeds = array(np.outer([1.0, 0.0, 0.0, 0.0], velocity), pair.vec3)
    start, inputs = array(pair.start, pair.vec3), [0, array(inverse_mass), array(np.full(4, MU)), pair.pairs, 1]
    inputs += [start, pair.moved(moved), speeds, cloth_particles, span, pair.contacts, pair.share]
    inputs += [array([1], wp.int32), array([rounds], wp.int32)]
    wp.launch(KERNELS.contact_impact.bounce, dim=1, inputs=inputs, outputs=pair.sums, device="cpu")


@pytest.mark.parametrize("others", [0.0, 1.0])
def test_friction_of_an_impact_takes_up_to_mu_times_as_much_and_not_more_than_slips(others):
    part = 1.0 / (1.0 + others)
    for slide, slip in ((0.002, 3.0), (1e-5, 0.01)):
        pair = Pair(0.001, others=others)
        struck(pair, [slide, 0, -0.005], [0, slip, -2.0])
        move, kick = pair.relative()
        assert move == pytest.approx([-part * min(MU * 0.001, slide), 0.0, part * 0.001], abs=1e-12)
        assert kick == pytest.approx([0.0, -part * min(MU * 2.0, slip), part * 2.0], abs=1e-9)


def test_an_impact_throws_nothing_back_that_leaves_already():
    pair = Pair(0.001)
    struck(pair, [0, 0, -0.005], [0.5, 0, 2.0])
    assert pair.relative()[1] == pytest.approx([0, 0, 0])


def test_levers_of_impacts_reach_less_far_from_round_to_round():
    """A particle that must move 20 times as far as its pair moves four times the depth or what is in reach."""
    weights, inverse_mass = np.array([1.0, -0.05, -0.55, -0.4]), np.array([0.0, 1000.0, 0.0, 0.0])
    for rounds, depth, within in ((0, 0.001, 0.001), (0, 0.02, DISTANCE), (1, 0.02, DISTANCE / 2), (9, 0.02, 0.0004)):
        pair = Pair(depth, weights)
        struck(pair, [0, 0, -0.005], [0, 0, 0], rounds=rounds, inverse_mass=inverse_mass)
        assert pair.changes()[0][1] == pytest.approx([0, 0, -4.0 * within])


def depth_of_impact(rounds: int, end: float) -> float:
    """By how much a vertex that came through the triangle to this height [m] is to be moved [m]."""
    pair, counts = Pair(0.0), [wp.zeros(n, dtype=wp.int32, device="cpu") for n in (4, 1, 4)]
    inputs = [0, array(INVERSE_MASS), pair.pairs, 1e-6, 0.3, 50.0, 1, array(pair.start, pair.vec3)]
    inputs += [pair.moved([0, 0, end - DISTANCE]), array([rounds], wp.int32)]
    outputs = [pair.contacts, pair.share, *counts]
    wp.launch(KERNELS.contact_impact.find_impacts, dim=1, inputs=inputs, outputs=outputs, device="cpu")
    assert (counts[0].numpy().tolist(), counts[1].numpy()[0]) == ([1] * 4, 1)
    return float(pair.contacts.depth.numpy()[0])


@pytest.mark.parametrize(("rounds", "share"), [(0, 0.3), (25, 0.65), (50, 1.0), (80, 1.0)])
def test_the_clearance_of_impacts_grows_from_round_to_round(rounds, share):
    assert depth_of_impact(rounds, -0.003) == pytest.approx(share * DISTANCE + 0.003)


def looked_at(pair: Pair, height: float, number: int, takes_part: int = 1) -> tuple[float, bool]:
    """Depth [m] of a pair in the pass of this number, 0: one of those of all, and whether it asks for another one."""
    further, crossed = KERNELS.contact_load.FurtherPasses(), KERNELS.contact_knots.Crossed()
    further.number, further.another = array([number], wp.int32), array([0], wp.int32)
    further.world_now, further.world_next = array([takes_part], wp.int32), array([0], wp.int32)
    crossed.world, crossed.any, crossed.wary = (array([0], wp.int32) for _ in range(3))
    inputs = [0, pair.pairs, 1, pair.moved([0, 0, height - DISTANCE]), pair.load]
    outputs = [pair.contacts, pair.share, further, crossed]
    wp.launch(KERNELS.contact_response.find_contacts, dim=1, inputs=inputs, outputs=outputs, device="cpu")
    assert further.another.numpy()[0] == further.world_next.numpy()[0]
    return float(pair.contacts.depth.numpy()[0]), bool(further.another.numpy()[0])


def test_further_passes_are_for_worlds_that_earned_them_and_pairs_within_reach():
    """A pair that was half its distance too far when last looked at is left as it was, with nothing to push."""
    near = 0.75 * DISTANCE
    for number, takes_part, was, is_in in (
        (0, 0, -0.6, True), (1, 1, -0.6, False), (1, 1, -0.4, True), (1, 0, -0.4, False), (1, 0, 0.4, False),
    ):  # fmt: skip
        depth = looked_at(Pair(was * DISTANCE), near, number, takes_part)[0]
        assert depth == pytest.approx(0.25 * DISTANCE if is_in else min(was, 0.0) * DISTANCE)


def test_load_is_aimed_by_up_to_a_quarter_of_the_distance_and_earns_passes():
    """One more pass for each eighth of a thickness."""
    for load, number, aim, another in (
        (0.1, 0, 0.1, False), (0.2, 0, 0.2, True), (0.2, 1, 0.2, False), (0.3, 1, 0.25, True), (0.3, 2, 0.25, False),
    ):  # fmt: skip
        pair = Pair(0.0)
        pair.load.length.fill_(0.5 * load * DISTANCE)  # on either side of the pair
        assert looked_at(pair, DISTANCE, number) == (pytest.approx(aim * DISTANCE), another)


def adapted(pair: Pair, dt: float) -> np.ndarray:
    """Load [m] of the particles after dt [s]."""
    outputs = [pair.load, pair.lack]
    wp.launch(KERNELS.contact_load.adapt_load, dim=4, inputs=[0, dt, pair.share], outputs=outputs, device="cpu")
    return pair.load.length.numpy().copy()


@pytest.mark.parametrize("steps", [1, 5])
def test_load_grows_by_what_pairs_lack_and_fades_whatever_the_steps(steps):
    """In 10 ms by a fifth of it, which is negative once they are further apart than they need to be."""
    dt, lack = 0.01 / steps, 0.25 * DISTANCE
    pair = Pair(0.001, height=DISTANCE - lack)
    for lifted, load in ((0.0, 0.2 * lack), (1.25 * lack, 0.15 * lack)):
        pair.start[0, 2] += lifted
        for _ in range(steps):
            pushed(pair, [0, 0, 0], [0, 0, 0], dt)
            loads = adapted(pair, dt)
        assert loads == pytest.approx(np.full(4, load))
    assert adapted(pair, 0.01) == pytest.approx(np.full(4, 0.8 * load))  # without pairs


def test_load_grows_by_the_mean_of_what_pairs_lack():
    pair = Pair(0.001, height=0.0, others=1.0)
    for height in (0.75, 0.25):
        pair.start[0, 2] = height * DISTANCE
        pushed(pair, [0, 0, 0], [0, 0, 0], 0.01)
    assert adapted(pair, 0.01) == pytest.approx(np.full(4, 0.2 * 0.5 * DISTANCE))
