"""Where Newton's method begins."""

import numpy as np
import pytest
import warp as wp
from test_implicit import NEWTON

import warpcloth as wc
from warpcloth.state import State


@pytest.mark.parametrize("name", NEWTON)
def test_a_change_that_goes_on_is_known_beforehand(name):
    """In free fall each step changes velocities alike: after two the guess is right, and one iteration says so."""
    model = wc.Model.build([wc.Cloth.grid((0.5, 0.5), (5, 5))], precision="float64")
    sim = wc.Simulation(model, name, substeps=1, contact="none")
    iterations = []
    for _ in range(4):
        sim.step(0.01)
        iterations.append(sim.integrator.metrics()["newton_iterations"])
    assert iterations[0] > iterations[-1] == 1
    np.testing.assert_allclose(sim.state.particle_qd.numpy()[:, 2], -9.81 * 0.04, rtol=1e-9)


def test_pressed_layers_take_few_iterations():
    """Contact gives back after each step what the solution takes, again and again; without a guess, 5 to 6 of them."""
    sheets = [wc.Cloth.grid((0.3, 0.3), (9, 9), name=f"c{k}", transform=(0.0, 0.0, 0.02 + 0.01 * k)) for k in range(3)]
    model = wc.Model.build(sheets, [wc.Plane()])
    sim = wc.Simulation(model, "bdf2", substeps=8, contact="all")
    sim.run(20, fps=24)
    before = sim.integrator.metrics()["newton_iterations_total"]
    sim.run(5, fps=24)
    assert sim.integrator.metrics()["newton_iterations_total"] - before < 3 * 5 * 8


@pytest.mark.parametrize(("before", "led"), [(0.5, True), (0.05, True), (-0.05, False), (-0.5, False), (1.05, False)])
def test_only_changes_that_are_alike_are_led_on_with(before, led):
    """The latest is 0.5 m/s; the one before it differs by less than that, or is nothing to go by."""
    model = wc.Model.build([wc.Cloth.grid((0.5, 0.5), (5, 5))])
    sim = wc.Simulation(model, "implicit_euler", substeps=1, contact="none")
    sim.step(0.01)  # tolerances and the number of free particles
    changes = [wp.full(model.particle_count, wp.vec3(0.0, y, 0.0), dtype=wp.vec3) for y in (0.5, before)]
    stage = State.of(model)
    sim.integrator.newton._lead(model.array([1], wp.int32), changes, stage)
    np.testing.assert_allclose(stage.particle_qd.numpy()[:, 1], 0.5 if led else 0.0, rtol=1e-7)


def test_worlds_that_take_no_part_keep_their_guess():
    worlds = [([wc.Cloth.grid((0.5, 0.5), (5, 5))], [])] * 2
    model = wc.Model.build_worlds(worlds)
    sim = wc.Simulation(model, "implicit_euler", substeps=1, contact="none")
    changes = [wp.full(model.particle_count, wp.vec3(0.0, 0.5, y), dtype=wp.vec3) for y in (0.0, 0.1)]
    out = State.of(model)
    scheme, first = sim.integrator, model.particle_world.numpy() == 0
    scheme.launch_base(model, sim.state, sim.state, base_of(scheme, sim.state), out, 0.01)
    scheme.newton.solve(out, sim.forces, 0.01, 0.01, model.array([1, 0], wp.int32), changes)
    tolerance = 1e-3  # of the solution
    np.testing.assert_allclose(changes[0].numpy()[first], [[0.0, 0.0, -0.0981]] * first.sum(), atol=tolerance)
    np.testing.assert_allclose(changes[1].numpy()[first], [[0.0, 0.5, 0.0]] * first.sum(), rtol=1e-7)
    for change, y in zip(changes, (0.0, 0.1), strict=True):
        np.testing.assert_allclose(change.numpy()[~first], [[0.0, 0.5, y]] * (~first).sum(), rtol=1e-7)
    assert not out.particle_qd.numpy()[~first].any()


def base_of(scheme, state: State) -> State:
    """Where the scheme puts what its stage starts from."""
    return State(scheme.newton.position_base, scheme.newton.velocity_base, state.particle_f, state.world_time)
