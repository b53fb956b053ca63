"""How undamped rules keep account of what their steps gain: the kernels of ``kernels/step_work.py`` against numpy."""

import numpy as np
import pytest
import warp as wp

import warpcloth as wc
from warpcloth.integrators.conjugate_gradient import ConjugateGradient
from warpcloth.launching import launch

WORLDS = {  # gained and energy before, gain by the rule, energy now, jumped, converged: what is kept of both, damped
    "gains little": ((1.0, 100.0), (4.0, 90.0), (0, 1), (0.5 + 2.0, 90.0), 0),
    "gains too much": ((1.0, 100.0), (100.0, 90.0), (0, 1), (0.5, 50.0), 1),
    "gains too much with what was gained before": ((20.0, 100.0), (4.0, 90.0), (0, 1), (10.0, 50.0), 1),
    "is slow now, and was fast": ((1.0, 400.0), (20.0, 1.0), (0, 1), (0.5 + 10.0, 200.0), 0),
    "loses": ((1.0, 100.0), (-4.0, 90.0), (0, 1), (0.5 - 2.0, 90.0), 0),
    "loses so much that not all of it can be gained later": ((1.0, 100.0), (-400.0, 90.0), (0, 1), (-9.0, 90.0), 0),
    "jumped, whatever its step": ((1.0, 100.0), (4.0, 90.0), (1, 0), (0.5, 50.0), 1),
    "was not solved": ((1.0, 100.0), (4.0, 90.0), (0, 0), (0.5, 50.0), 1),
    "is not finite": ((1.0, 100.0), (np.nan, 90.0), (0, 1), (0.5, 50.0), 1),
}


@pytest.fixture(scope="module")
def model() -> wc.Model:
    """A world of several lanes for each case."""
    cloth = wc.Cloth.grid((0.5, 0.5), (30, 30), pins="left")
    return wc.Model.build_worlds([([cloth], []) for _ in WORLDS], precision="float64")


def test_worlds_that_gain_or_cannot_be_solved_are_damped(model):
    """By half of what the rule differs by, a tenth of the energy being allowed, and half of what was before kept."""
    cg, kernels, count = ConjugateGradient(model, 1), model.kernels.step_work, len(WORLDS)
    before, now, flags, expected, damped = zip(*WORLDS.values(), strict=True)
    gains = kernels.Gains()
    gains.gained, gains.energy = (model.array(column, wp.float64) for column in np.transpose(before))
    lanes = cg.lanes.lane_start.numpy()
    assert (np.diff(lanes) > 1).all()
    sums = [model.array(np.repeat(column / np.diff(lanes), np.diff(lanes)), wp.float64) for column in np.transpose(now)]
    jumped, converged = (model.array(column, wp.int32) for column in np.transpose(flags))
    failures, marked, any_out = (wp.zeros(n, dtype=wp.int32, device=model.device) for n in (count, count, 1))
    failures.fill_(3)
    inputs = [cg.lanes, *sums, jumped, converged, 0.5, 0.1, 0.5]
    launch(kernels.judge, count, inputs, [gains, failures, marked, any_out], model.device)
    np.testing.assert_allclose(np.transpose([gains.gained.numpy(), gains.energy.numpy()]), expected)
    np.testing.assert_array_equal(marked.numpy(), damped)
    np.testing.assert_array_equal(failures.numpy(), [2 if flag == (0, 0) else 3 for flag in flags])
    assert any_out.numpy()[0] == 1


def test_worlds_that_only_jumped_have_been_told_of_already(model):
    cg, kernels, count = ConjugateGradient(model, 1), model.kernels.step_work, model.world_count
    gains = kernels.Gains()
    gains.gained, gains.energy = (wp.zeros(count, dtype=wp.float64, device=model.device) for _ in range(2))
    ones, marked = (wp.full(count, value, dtype=wp.int32, device=model.device) for value in (1, 0))
    any_out = wp.zeros(1, dtype=wp.int32, device=model.device)
    inputs = [cg.lanes, cg.partial, cg.partial, ones, ones, 0.5, 0.1, 0.5]
    launch(kernels.judge, count, inputs, [gains, ones, marked, any_out], model.device)
    assert (marked.numpy() == 1).all()
    assert any_out.numpy()[0] == 0


def test_work_is_that_of_free_particles(model):
    cg, rng, n = ConjugateGradient(model, 1), np.random.default_rng(0), model.particle_count
    start, end, speed, f, middle, later = rng.normal(size=(6, n, 3))
    energy = wp.zeros_like(cg.partial)
    vectors = [model.array(values, model.vec3) for values in (start, end, speed, f, middle, later)]
    inputs = [cg.lanes, model.particle_mass, model.particle_inv_mass, *vectors]
    launch(model.kernels.step_work.measure, cg.lane_count, inputs, [cg.partial, energy], model.device)
    free, mass = model.particle_inv_mass.numpy() > 0.0, model.particle_mass.numpy()
    assert 0 < np.count_nonzero(~free) < n
    work = np.where(free, np.sum((middle - 0.5 * (f + later)) * (end - start), axis=1), 0.0)
    kinetic = np.where(free, 0.5 * mass * np.sum(speed**2, axis=1), 0.0)
    for got, expected in ((cg.partial, work), (energy, kinetic)):
        by_lane = np.add.reduceat(expected, cg.lanes.particle_start.numpy())
        np.testing.assert_allclose(got.numpy(), by_lane, rtol=1e-12, atol=1e-12)
