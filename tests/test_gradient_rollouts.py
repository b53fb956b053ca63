"""Roll-outs: what they keep, where they leave the simulation, and which calls they refuse."""

import gc
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import warp as wp
from gradient_checks import RandomLoss, crumpled

import warpcloth as wc
from warpcloth.errors import DivergedError, InputError, NotDifferentiableError, StabilityWarning
from warpcloth.gradients import Rollout


@pytest.mark.parametrize("integrator", ["velocity_verlet", "xpbd"])
def test_checkpoints_change_nothing_and_keep_memory_bounded(integrator):
    results, states = [], []
    for segment in (None, 1, 90):
        rollout = Rollout(crumpled(integrator, 30), 3, observe=[1, 3], segment=segment)
        loss = RandomLoss(rollout)
        loss.value()
        results.append(loss.gradients())
        states.append(rollout.kept_states)
    for other in results[1:]:
        for name, gradient in results[0].items():
            assert np.array_equal(gradient, other[name]), name
    assert states == [10 + 9, 90 + 1, 1 + 90]  # 90 steps in segments of 10


@pytest.mark.parametrize("integrator", ["symplectic_euler", "xpbd", "implicit_euler"])
def test_memory_on_the_way_back_does_not_grow_with_the_steps(integrator, monkeypatch):
    """Of the recordings, one step's is alive at a time, without waiting for Python to look for cycles."""
    from warpcloth.gradients import rollout as module

    alive, most = weakref.WeakSet(), []

    class Counted(module.Recording):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            alive.add(self)
            most.append(len(alive))

    monkeypatch.setattr(module, "Recording", Counted)
    loss = RandomLoss(Rollout(crumpled(integrator, 20), 2))
    loss.value()
    gc.disable()
    try:
        loss.gradients()
    finally:
        gc.enable()
    assert len(most) == 40
    assert max(most) == 1


def test_going_back_leaves_the_simulation_where_it_is():
    """At the end of the roll-out, or wherever it has gone since; its clock, what it remembers and its forces, too."""
    rollout, ahead = (Rollout(crumpled("velocity_verlet", 10), 2) for _ in range(2))
    for each, steps in ((rollout, 1), (ahead, 0)):
        each.forward()
        for step in range(2):
            if step < steps:
                each.backward(np.ones((25, 3)))
                np.testing.assert_array_equal(each.simulation.state.particle_q.numpy(), each.end.particle_q.numpy())
            each.simulation.step(1.0 / 60.0)
    mine, plain = rollout.simulation, ahead.simulation
    assert mine.time == pytest.approx(mine.state.world_time.numpy()[0])
    for name in ("particle_q", "particle_qd", "particle_f", "world_time"):
        np.testing.assert_array_equal(getattr(mine.state, name).numpy(), getattr(plain.state, name).numpy())
    gradient = rollout.backward(np.ones((25, 3)))["gravity"].numpy().copy()
    assert mine.time == pytest.approx(mine.state.world_time.numpy()[0]) == pytest.approx(4.0 / 60.0)
    rollout.forward()
    assert np.array_equal(rollout.backward(np.ones((25, 3)))["gravity"].numpy(), gradient)


def test_rollouts_in_threads_take_turns():
    """With each other and with plain simulations, as there is but one tape in Warp."""
    weights = np.random.default_rng(0).normal(size=(25, 3))

    def gradients(rollout: Rollout) -> list[np.ndarray]:
        for _ in range(3):
            rollout.forward()
            found = [gradient.numpy().copy() for gradient in rollout.backward(weights).values()]
        return found

    rollouts = [Rollout(crumpled("velocity_verlet", 20), 2) for _ in range(3)]
    plain = [crumpled("velocity_verlet", 20) for _ in range(2)]
    expected = gradients(rollouts.pop())
    with ThreadPoolExecutor(3) as threads:
        stepped = threads.submit(plain[0].run, 20)
        found = list(threads.map(gradients, rollouts))
        stepped.result()
    plain[1].run(20)
    np.testing.assert_array_equal(plain[0].state.particle_q.numpy(), plain[1].state.particle_q.numpy())
    for each in found:
        for one, other in zip(each, expected, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.filterwarnings("ignore::warpcloth.errors.StabilityWarning")
def test_bad_input_is_refused():
    model = wc.Model.build([wc.Cloth.grid((0.2, 0.2), (3, 3))], precision="float64", differentiable=True)
    simulation = wc.Simulation(model, substeps=2)
    for options, sentence in [
        ({"frames": 0}, "Frames"),
        ({"frames": 2, "observe": [2, 1]}, "rising order"),
        ({"frames": 2, "observe": []}, "at least one"),
        ({"frames": 2, "observe": [3]}, "Observe"),
        ({"frames": 2, "observe": 2}, "Observe must be a list of integers"),
        ({"frames": 2, "segment": 5}, "Segment"),
    ]:
        with pytest.raises(InputError, match=sentence):
            Rollout(simulation, **options)
    with pytest.raises(InputError, match="Simulation must be a warp"):
        Rollout(None, 1)
    rollout = Rollout(simulation, 1)
    with pytest.raises(InputError, match="forward"):
        rollout.backward(np.ones((9, 3)))
    with pytest.raises(InputError, match="A tape is recording"), wp.Tape():
        rollout.forward()
    rollout.forward()
    with pytest.raises(InputError, match="Particle_q"):
        rollout.backward(np.ones((8, 3)))
    gravity = rollout.parameters["gravity"]
    before = gravity.numpy().copy()
    gravity.fill_(1.0)
    with pytest.raises(InputError, match="Parameter 'gravity' has changed since"):
        rollout.backward(np.ones((9, 3)))
    gravity.assign(before)
    rollout.backward(np.ones((9, 3)))
    gravity.fill_(np.inf)
    with pytest.raises(DivergedError, match="not finite"):
        rollout.forward()
    with pytest.raises(InputError, match="forward first"):
        rollout.backward(np.ones((9, 3)))
    gravity.assign(before)
    with pytest.raises(InputError, match=r"Tape must be a warp\.Tape, got str"):
        rollout.forward("tape")
    simulation.reset()
    simulation.grab(0)
    with pytest.raises(NotDifferentiableError, match="Force 'grab'"):
        rollout.forward()


def test_too_few_substeps_are_warned_of():
    model = wc.Model.build([wc.Cloth.grid((0.2, 0.2), (3, 3))], precision="float64", differentiable=True)
    rollout = Rollout(wc.Simulation(model, substeps=2), 1)
    with pytest.warns(StabilityWarning, match="symplectic_euler is unstable with 2 substeps per frame"):
        rollout.forward()


def test_what_had_settled_before_a_rollout_has_not_after_it():
    model = wc.Model.build([wc.Cloth.grid((0.2, 0.2), (3, 3))], precision="float64", differentiable=True)
    simulation = wc.Simulation(model, gravity=(0, 0, 0))
    simulation.run(20)
    assert simulation.settled
    rollout = Rollout(simulation, 2)
    rollout.start.particle_qd.fill_(1.0)
    rollout.forward()
    assert not simulation.settled


@pytest.mark.parametrize("integrator", ["symplectic_euler", "xpbd"])
def test_single_steps_take_springs_as_they_are(integrator):
    """Also of a scheme that has copies of them."""
    ends = []
    for before in (True, False):
        cloth = wc.Cloth.grid((0.2, 0.2), (5, 5), pins="left", transform=(0, 0, 1))
        model = wc.Model.build([cloth], precision="float64", differentiable=True)
        soft = 0.01 * model.spring_stiffness.numpy()
        if before:
            model.spring_stiffness.assign(soft)
        simulation = wc.Simulation(model, integrator, substeps=10)
        model.spring_stiffness.assign(soft)
        for _ in range(20):
            simulation.substep(1e-3)
        ends.append(simulation.state.particle_q.numpy())
    assert np.array_equal(*ends)


def test_a_tape_of_an_earlier_way_is_refused():
    """There is memory for one way, and what else would be gone back through is another one."""
    rollout = Rollout(crumpled("velocity_verlet", 10), 2)
    tape = wp.Tape()
    rollout.forward(tape)
    rollout.start.particle_qd.fill_(0.1)
    rollout.forward()
    with pytest.raises(InputError, match="called again since this tape noted it"):
        tape.backward(grads={rollout.end.particle_q: wp.ones_like(rollout.end.particle_q)})
    tape = wp.Tape()
    rollout.forward(tape)
    tape.backward(grads={rollout.end.particle_q: wp.ones_like(rollout.end.particle_q)})
    assert np.abs(rollout.gradients["particle_qd"].numpy()).max() > 0.0
