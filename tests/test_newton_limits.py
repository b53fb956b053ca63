"""Newton's method where numbers end: nothing left to solve for, far from the origin, forces that are not finite."""

import numpy as np
import pytest

import warpcloth as wc
from warpcloth.errors import DivergedError, StepSizeError
from warpcloth.integrators import INTEGRATORS

NEWTON = ("implicit_euler", "implicit_midpoint", "implicit_trapezoid", "bdf2")


def hanging(pins="left") -> wc.Cloth:
    return wc.Cloth.grid((0.5, 0.5), (9, 9), pins=pins)


def phase(sim: wc.Simulation) -> np.ndarray:
    return np.hstack([sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()])


@pytest.mark.parametrize("substeps", [1, 2, 4])
@pytest.mark.parametrize("name", NEWTON)
def test_a_sheet_that_falls_freely_takes_few_iterations(name, substeps):
    """After the first there is nothing left but rounding, of which the squares are too small for single precision."""
    for n in (9, 17):
        sim = wc.Simulation(wc.Model.build([wc.Cloth.grid((0.5, 0.5), (n, n))]), name, substeps=substeps)
        sim.step(1.0 / 60.0)
        measures = sim.metrics()
        assert measures["unconverged_steps"] == 0
        assert measures["newton_iterations_total"] <= 4 * substeps + 2
        np.testing.assert_allclose(sim.state.particle_qd.numpy()[:, 2], -9.81 / 60.0, rtol=1e-5)


@pytest.mark.parametrize("name", NEWTON)
def test_cloth_that_is_led_far_away_needs_no_more_iterations_there(name):
    """Positions are rounded as where the cloth is, not as where it was at first; the same motion in double precision,
    where rounding does not matter, with the tolerances of single precision, shows what the motion itself needs."""
    totals = {}
    for precision in ("float32", "float64"):
        motion = wc.Motion.keyframes([(0, (0, 0, 0)), (0.5, (2000.0, 0, 0))], interpolation="smooth")
        model = wc.Model.build([hanging([wc.pin("left", motion=motion)])], precision=precision)
        options = {"tolerance": 1e-3, "cg_tolerance": 0.1}
        sim = wc.Simulation(model, name, substeps=4, integrator_options=options)
        sim.run(60)
        totals[precision] = sim.metrics()["newton_iterations_total"]
        assert sim.metrics()["unconverged_steps"] == 0
    assert totals["float32"] < totals["float64"]


@pytest.mark.parametrize("name", NEWTON)
def test_how_accurate_a_world_is_does_not_depend_on_where_others_are(name):
    far = wc.Cloth.grid((0.5, 0.5), (9, 9), pins="left", transform=(500.0, 0.0, 0.0))
    alone = wc.Simulation(wc.Model.build_worlds([([hanging()], [])]), name, substeps=4)
    beside = wc.Simulation(wc.Model.build_worlds([([hanging()], []), ([far], [])]), name, substeps=4)
    alone.run(10)
    beside.run(10)
    np.testing.assert_array_equal(phase(beside)[: alone.model.particle_count], phase(alone))


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", INTEGRATORS)
def test_forces_that_are_not_finite_stop_the_simulation(name, value):
    """A solver that leaves them out would say that it has converged, and all other forces would be left out, too."""
    model = wc.Model.build([hanging()])
    force = np.zeros((model.particle_count, 3))
    force[40, 2] = value
    applied = wc.AppliedForce(model)
    applied.force.assign(force)
    sim = wc.Simulation(model, name, forces=[applied])
    with pytest.raises((DivergedError, StepSizeError)):
        sim.step(1.0 / 60.0)
