"""Grabs: a normal force, with the same laws as the others, that follows the host between captured frames."""

import json

import numpy as np
import pytest
import warp as wp

import warpcloth as wc
from warpcloth.errors import InputError
from warpcloth.forces import Linearization
from warpcloth.grab import GrabTape, pick

DT = 1.0 / 60.0
STILL = (0.0, 0.0, 0.0)


def hanging(integrator="xpbd", graph=True, **options):
    """A small cloth that hangs from its upper edge."""
    turn = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 1], [0, 0, 0, 1]])
    cloth = wc.Cloth.grid(size=(0.5, 0.5), resolution=(8, 8), pins="top", transform=turn)
    return wc.Simulation(wc.Model.build([cloth], device="cpu", **options), integrator, graph=graph)


@pytest.mark.parametrize("integrator", ["xpbd", "implicit_euler", "symplectic_euler"])
def test_the_grabbed_particle_follows_and_swings_back(integrator):
    simulation = hanging(integrator)
    simulation.run(3)
    start = simulation.state.particle_q.numpy()[3].copy()
    grab = simulation.grab(3)
    for k in range(30):
        grab.move(start + min(k / 20, 1.0) * np.array([0.0, 0.15, 0.05]))
        simulation.step(DT)
    assert np.linalg.norm(grab.point - grab.target) < 0.02
    assert grab.point[1] > start[1] + 0.12
    assert simulation.energy()["grab"] > 0.0
    grab.release()
    simulation.run(12)
    assert grab.point[1] < start[1] + 0.1
    assert simulation.energy()["grab"] == 0.0


def test_a_mass_on_a_grab_hangs_by_its_weight_over_the_stiffness():
    """Static equilibrium, k (z* − z) = m g, of the point that the weights define."""
    model = wc.Model.from_springs(
        [[0, 0, 0], [1, 0, 0]], 0.1, [[0, 1]], 1.0, 100.0, 1.0, [0], device="cpu", precision="float64"
    )
    simulation = wc.Simulation(model, "implicit_euler", substeps=10)
    grab = simulation.grab(1, stiffness=50.0)
    simulation.run(400, fps=60.0)
    low = grab.target[2] - grab.point[2]
    assert low == pytest.approx(0.1 * 9.81 / 50.0, rel=0.02)


def test_force_is_minus_the_gradient_of_the_energy_and_k_its_derivative():
    simulation = hanging(precision="float64")
    grab = simulation.grab(((0.03, -1.0, 0.82), (0.0, 1.0, 0.0)), stiffness=37.0)
    grab.move((0.1, 0.2, 0.9))
    simulation._grabs.begin_frame(simulation.state, DT, 1e-4)
    term, state = simulation._grabs, simulation.state
    state.world_time.assign(np.array([DT]))
    state.particle_q.assign(state.particle_q.numpy() + 0.01)
    q = state.particle_q.numpy().copy()

    def force(at):
        state.particle_q.assign(at)
        state.particle_f.zero_()
        term.accumulate(state, 0.0)
        return state.particle_f.numpy().copy()

    def energy(at):
        state.particle_q.assign(at)
        return term.energy(state)["grab"]

    velocity = np.asarray(term._grabs.target_to.numpy()[0] - term._grabs.target_from.numpy()[0]) / DT
    state.particle_qd.assign(np.tile(velocity, (len(q), 1)))  # no damping: all moves with the target
    direction = np.random.default_rng(0).normal(size=q.shape)
    here = force(q)
    assert np.abs(here).max() > 0.1
    slope = (energy(q + 1e-6 * direction) - energy(q - 1e-6 * direction)) / 2e-6
    assert -np.sum(here * direction) == pytest.approx(slope, rel=1e-6)
    stretched = (force(q + 1e-6 * direction) - force(q - 1e-6 * direction)) / 2e-6
    state.particle_qd.assign(state.particle_qd.numpy() + direction)
    slowed = force(q) - here
    assert np.abs(slowed).max() > 0.01
    model = simulation.model
    for a, b in ((1.0, 0.0), (0.0, 1.0)):
        at, product = Linearization(state, a, b, model.array([1.0], model.real)), wp.zeros_like(state.particle_q)
        term.hessian_product(at, model.array(direction, model.vec3), product)
        expected = -a * stretched - b * slowed
        np.testing.assert_allclose(product.numpy(), expected, atol=1e-6 * np.abs(expected).max())
        blocks = wp.zeros(model.particle_count, dtype=model.kernels.precision.mat33, device=model.device)
        term.hessian_diagonal(at, blocks)
        weights = np.zeros(model.particle_count)
        np.add.at(weights, list(term.holds[0].particles), term.holds[0].weights)
        strength = a * term.holds[0].stiffness + b * term.holds[0].damping
        np.testing.assert_allclose(blocks.numpy(), (weights**2 * strength)[:, None, None] * np.eye(3), rtol=1e-9)


def test_captured_frames_see_what_the_host_does():
    """The same to the last bit with and without graphs, through take, move and release."""
    results = []
    for graph in (True, False):
        simulation = hanging(graph=graph)
        simulation.run(3)
        grab = simulation.grab(0)
        for k in range(8):
            grab.move((-0.25 + 0.01 * k, 0.05 * k, 0.5))
            simulation.step(DT)
        grab.release()
        simulation.run(4)
        results.append(simulation.state.particle_q.numpy().copy())
    assert np.array_equal(*results)


def test_a_tape_repeats_what_was_done():
    first = hanging()
    first.run(2)
    one, other = first.grab(0), first.grab(((0.1, 5.0, 0.9), (0.0, -1.0, 0.0)))
    for k in range(6):
        one.move((-0.3, 0.02 * k, 0.5))
        one.move((-0.25, 0.03 * k, 0.5))
        first.step(DT)
    other.release()
    first.run(3)
    tape = GrabTape.from_json(first.tape.to_json())
    assert [event.act for event in tape.events].count("move") == 6
    second = hanging()
    player = tape.play(second)
    while second.time < first.time - 1e-9:
        player.before_frame()
        second.step(DT)
    assert np.array_equal(second.state.particle_q.numpy(), first.state.particle_q.numpy())


def test_tapes_that_cannot_be_played_are_refused():
    recorded = hanging()
    recorded.grab(60).release()
    text = recorded.tape.to_json()
    take, release = json.loads(text)
    bad = [
        [release],
        [take, take],
        [{**take, "act": "jump"}],
        [{**take, "time": "soon"}],
        [{**take, "target": None}],
        [{**take, "hold": None}],
        [{**take, "hold": {**take["hold"], "particles": [1, 2]}}],
        [{**take, "hold": {**take["hold"], "weights": "abc"}}],
        [{**take, "hold": {**take["hold"], "stiffness": -5.0}}],
        [{**take, "hold": {**take["hold"], "damping": float("nan")}}],
    ]
    for events in bad:
        with pytest.raises(InputError, match="not a tape"):
            GrabTape.from_json(json.dumps(events))
    smaller = wc.Simulation(wc.Model.build(wc.Cloth.grid(resolution=(5, 5)), device="cpu"))
    with pytest.raises(InputError, match="particle must be a whole number from 0 to 24, got 60"):
        GrabTape.from_json(text).play(smaller).before_frame()


def test_a_ray_takes_the_nearest_cloth():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]])
    triangles = np.array([[0, 1, 2], [3, 4, 5]])
    particles, weights, place = pick(points, triangles, ((0.25, 0.5, 3.0), (0.0, 0.0, -2.0)))
    assert particles == (3, 4, 5)
    assert weights == pytest.approx((0.25, 0.25, 0.5))
    assert place == pytest.approx((0.25, 0.5, 1.0))


def test_a_stiff_grab_does_not_blow_up_a_coarse_step():
    simulation = hanging("xpbd")
    simulation.substeps, simulation._auto = 2, False
    grab = simulation.grab(0, stiffness=1e7)
    for k in range(30):
        grab.move((-0.25 + 0.2 * np.sin(k), 0.2 * np.cos(k), 0.5))
        simulation.step(DT)
    assert np.abs(simulation.state.particle_q.numpy()).max() < 2.0


@pytest.mark.parametrize("integrator", ["xpbd", "vbd", "symplectic_euler", "velocity_verlet", "rk4", "forward_euler"])
def test_many_hands_on_one_place_do_not_blow_it_up(integrator):
    """They share what the particles can carry, be they held alone or in a triangle."""
    cloth = wc.Cloth.grid((0.5, 0.5), (12, 12), pins="left")
    simulation = wc.Simulation(wc.Model.build(cloth, device="cpu"), integrator)
    start = cloth.points[70]
    hands = [simulation.grab(70) for _ in range(8)]
    hands += [simulation.grab((start + np.array([0.004, 0.003 + 1e-4 * k, 1.0]), (0.0, 0.0, -1.0))) for k in range(8)]
    for k in range(30):
        for hand in hands:
            hand.move(start + np.array([0.0, 0.0, 0.005 * k]))
        simulation.step(DT)
    assert simulation.metrics()["max_speed"] < 6.0  # it swings with some 3 m/s
    assert np.linalg.norm(hands[0].point - hands[0].target) < 0.1


def test_a_hand_may_hold_what_is_pinned_with_steps_of_any_length():
    simulation = wc.Simulation(wc.Model.build(wc.Cloth.grid((0.5, 0.5), (5, 5), pins="left")), substeps=500)
    hand = simulation.grab(0)
    hand.move(hand.point + 1.0)
    with np.errstate(all="raise"):
        simulation.step(DT)
    assert np.array_equal(hand.point, hand.target - 1.0)


@pytest.mark.parametrize("integrator", ["bogacki_shampine", "dormand_prince"])
def test_schemes_that_choose_their_steps_have_the_stiffness_asked_for(integrator):
    """They rest by the weight over it below the target; see above."""
    mass, stiffness = 0.1, 50.0
    model = wc.Model.from_springs([[0, 0, 0], [1, 0, 0]], mass, [[0, 1]], 1.0, 100.0, 1.0, [0], device="cpu")
    simulation = wc.Simulation(model, integrator)
    grab = simulation.grab(1, stiffness=stiffness)
    simulation.run(20, fps=2.0)
    assert grab.target[2] - grab.point[2] == pytest.approx(mass * 9.81 / stiffness, rel=0.03)


def test_mistakes():
    simulation = hanging()
    with pytest.raises(InputError, match="article must be a whole number from 0 to 63"):
        simulation.grab(64)
    with pytest.raises(InputError, match="meets no cloth"):
        simulation.grab(((9.0, 9.0, 9.0), (0.0, 0.0, 1.0)))
    with pytest.raises(InputError, match="by its number, or cloth by a ray"):
        simulation.grab((1.0, 2.0, 3.0))
    with pytest.raises(InputError, match="Ray: direction must be 3 numbers"):
        simulation.grab(((0.0, 0.0, 9.0), (0.0, 1.0)))
    with pytest.raises(InputError, match="tiffness must be"):
        simulation.grab(0, stiffness=0.0)
    larger = wc.Simulation(wc.Model.build([wc.Cloth.grid((1.0, 1.0), (9, 9))]))
    larger.grab(80)
    with pytest.raises(InputError, match="Grabbed particle must be a whole number from 0 to 63, got 80"):
        larger.tape.play(simulation).before_frame()
    assert simulation.grab(np.array([[0.1, 9.0, 1.1], [0.0, -1.0, 0.0]])).held
    simulation = hanging()
    grab = simulation.grab(0)
    with pytest.raises(InputError, match="arget"):
        grab.move((0.0, np.nan, 0.0))
    grab.release()
    grab.release()
    with pytest.raises(InputError, match="has been released"):
        grab.move(STILL)
    for _ in range(32):
        simulation.grab(1)
    with pytest.raises(InputError, match="32 grabs already"):
        simulation.grab(1)
    with pytest.raises(InputError, match="not a tape"):
        GrabTape.from_json("[1]")


def test_a_hand_leads_worlds_that_were_reset_as_others():
    """The clock of a world is younger then than the simulation's."""
    ways = []
    for early in (False, True):
        cloths = [wc.Cloth.grid((0.3, 0.3), (6, 6), pins="left", transform=(0, 0, 0.3))]
        simulation = wc.Simulation(wc.Model.build_worlds([(cloths, []), (cloths, [])]), "implicit_euler", substeps=10)
        if early:
            simulation.run(4)
            simulation.reset(np.array([True, False]))
        grab = simulation.grab(35, stiffness=2000.0)
        start, way = grab.target, []
        for k in range(1, 5):
            grab.move(start + np.array([0.0, 0.0, 0.02 * k]))
            simulation.step(DT)
            way.append(grab.point[2] - start[2])
        ways.append(way)
    assert ways[0] == pytest.approx([0.02, 0.04, 0.06, 0.08], abs=1e-3)
    assert ways[1] == pytest.approx(ways[0], abs=1e-6)


@pytest.mark.parametrize("integrator", ["xpbd", "implicit_euler", "rk4"])
def test_a_target_that_was_reached_stays_there_in_replays_of_the_callers(integrator):
    ends = []
    for replayed in (True, False):
        simulation = hanging(integrator, graph=False)
        simulation.step(DT)
        hand = simulation.grab(3)
        hand.move(hand.point + np.array([0.0, 0.05, 0.0]))
        simulation.step(DT)
        if replayed:
            with wp.ScopedCapture(device="cpu") as capture:
                simulation.step(DT)
        for _ in range(5):
            if replayed:
                wp.capture_launch(capture.graph)
            else:
                simulation.step(DT)
        ends.append(simulation.state.particle_q.numpy())
    np.testing.assert_array_equal(*ends)


def test_energy_of_grabs_is_that_of_those_held_now():
    simulation = hanging()

    def energy() -> float:
        return simulation.energy()["grab"]

    hand = simulation.grab(3, stiffness=10.0)
    assert energy() == 0.0
    hand.move(hand.point + np.array([0.0, 0.05, 0.0]))
    simulation.step(DT)
    away = np.linalg.norm(hand.target - hand.point)
    assert energy() == pytest.approx(0.5 * 10.0 * away**2, rel=1e-4)
    simulation.reset()
    away = np.linalg.norm(hand.target - hand.point)
    assert energy() == pytest.approx(0.5 * 10.0 * away**2, rel=1e-4)
    before = energy()
    hand.move(hand.target + 1.0)
    assert energy() == before
    hand.release()
    assert energy() == 0.0


def test_the_tape_begins_again_when_all_is_reset():
    """With what is held by then, on its way to where it was being led; a tape of before would have times that fall."""
    model = wc.Model.build([wc.Cloth.grid((0.5, 0.5), (5, 5), pins=["top_left", "top_right"])])
    sim = wc.Simulation(model, "xpbd", substeps=5)
    released, held = sim.grab(2), sim.grab(4)
    sim.run(3)
    released.release()
    held.move(np.add(held.point, (0.0, 0.1, 0.1)))
    before = sim.tape
    sim.reset()
    assert len(before.events) == 4
    assert sim.tape is not before
    sim.run(3)
    held.move(np.add(held.point, (0.1, 0.0, 0.1)))
    sim.run(2)
    again = wc.Simulation(model, "xpbd", substeps=5)
    player = GrabTape.from_json(sim.tape.to_json()).play(again)
    for _ in range(5):
        player.before_frame()
        again.step(1.0 / 60.0)
    np.testing.assert_array_equal(again.state.particle_q.numpy(), sim.state.particle_q.numpy())
