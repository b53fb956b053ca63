"""How Newton's method shortens steps that overshoot: ``judge_step`` of ``kernels/implicit_step.py``, case by case."""

import numpy as np
import warp as wp

import warpcloth as wc
from warpcloth.integrators.newton import OVERSHOOT, SHORTEST_STEP, Newton
from warpcloth.launching import launch

SMALL = 1e-6  # tolerance of the update [m/s]
CASES = {  # slope after the step over the decrease before it, step, update [m/s]: the step then, None where it is taken
    "is at its zero": (0.0, 1.0, 1.0, None),
    "has come half the way": (OVERSHOOT, 1.0, 1.0, None),
    "has not got there yet": (-0.9, 1.0, 1.0, None),
    "goes a little too far": (0.6, 1.0, 1.0, 0.5),
    "goes too far": (3.0, 0.5, 1.0, 0.5 * 0.25),
    "goes far too far": (100.0, 1.0, 1.0, 0.1),
    "is not finite": (np.inf, 1.0, 1.0, 0.1),
    "is no number": (np.nan, 0.5, 1.0, 0.05),
    "is as short as may be": (3.0, SHORTEST_STEP, 1.0, None),
    "is an update that does not matter": (3.0, 1.0, SMALL, None),
}


def test_steps_that_overshoot_are_shortened_to_the_zero_of_the_linear_slope():
    """Each world by itself, of several lanes; one that does not search stays as it is."""
    cloth, count = wc.Cloth.grid((0.5, 0.5), (30, 30)), len(CASES) + 1
    model = wc.Model.build_worlds(count * [([cloth], [])], precision="float64")
    newton, decrease = Newton(model), 0.3
    slopes, steps, updates, expected = zip(*CASES.values(), (3.0, 1.0, 1.0, None), strict=True)  # the last is idle
    worlds, lanes = newton.worlds, np.diff(newton.cg.lanes.lane_start.numpy())
    assert (lanes > 1).all()
    searching = np.ones(count, np.int32)
    searching[-1] = 0
    worlds.searching.assign(searching)
    worlds.at_search.fill_(count - 1)
    worlds.step.assign(np.array(steps))
    worlds.update.assign(np.array(updates))
    worlds.tolerance.fill_(SMALL)
    newton.cg.solves.decrease.fill_(decrease)
    partial = model.array(np.repeat(decrease * np.array(slopes) / lanes, lanes), wp.float64)
    inputs = [newton.cg.lanes, partial, newton.cg.solves, OVERSHOOT + 1e-12, SHORTEST_STEP]  # sums are rounded
    launch(newton.kernels.judge_step, count, inputs, [worlds], model.device)
    goes_on = [step is not None for step in expected]
    np.testing.assert_array_equal(worlds.searching.numpy(), goes_on)
    wanted = [before if step is None else step for before, step in zip(steps, expected, strict=True)]
    np.testing.assert_allclose(worlds.step.numpy(), wanted, rtol=1e-12)
    assert worlds.at_search.numpy()[0] == sum(goes_on)


def test_no_step_is_taken_by_an_indefinite_matrix_and_the_next_one_is_projected():
    """Nor is a world done then, though its update is within the tolerance; one of a definite matrix is."""
    model = wc.Model.build_worlds(2 * [([wc.Cloth.grid((0.1, 0.1), (3, 3))], [])], precision="float64")
    newton = Newton(model)
    worlds, cg = newton.worlds, newton.cg
    for array, value in ((worlds.active, 1), (worlds.tolerance, SMALL), (worlds.mass, 1.0), (worlds.count, 9.0)):
        array.fill_(value)
    worlds.project.fill_(0.25)
    worlds.at_work.fill_(2)
    cg.solves.indefinite.assign(np.array([0, 1], np.int32))
    sums = [wp.zeros_like(cg.partial) for _ in range(2)]
    launch(newton.kernels.start_search_worlds, 2, [cg.lanes, *sums, cg.solves], [worlds], model.device)
    assert worlds.searching.numpy().tolist() == [1, 0]
    assert worlds.step.numpy().tolist() == [1.0, 0.0]
    assert worlds.at_search.numpy()[0] == 1
    launch(newton.kernels.judge_worlds, 2, [cg.solves, 100, 0.1, 1e-3], [worlds], model.device)
    assert worlds.active.numpy().tolist() == [0, 1]
    assert worlds.converged.numpy().tolist() == [1, 0]
    assert worlds.project.numpy().tolist() == [0.125, 1.0]
    assert worlds.at_work.numpy()[0] == 1
