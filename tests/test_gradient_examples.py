"""The examples of gradients reach what they are after, at small size."""

import numpy as np
import pytest

from warpcloth.examples import recover_fabric, throw_onto_target


def test_stiffness_damping_and_bending_are_recovered_to_one_percent():
    """From a first guess that is off by a factor of 3 in each, up or down."""
    result = recover_fabric.recover((3.0, 1.0 / 3.0, 1.0 / 3.0), most=50, resolution=4, frames=10, substeps=14)
    assert result.error < 0.01
    assert result.evaluations < 60


@pytest.mark.parametrize("logarithms", [(0.0, 0.0, 0.0), (0.5, -0.5, 0.2)])
def test_the_misfit_and_its_gradient_agree(logarithms):
    experiment = recover_fabric.Experiment(resolution=4, frames=4, substeps=12)
    seen = experiment.motion(np.array([1.5, 0.7, 2.0]))
    _, gradient = experiment.misfit(np.array(logarithms), seen)
    for k, step in enumerate(1e-5 * np.eye(3)):
        ends = [experiment.misfit(np.array(logarithms) + sign * step, seen)[0] for sign in (1.0, -1.0)]
        assert gradient[k] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-5)


def test_the_throw_lands_on_the_target():
    """Through the floor's contact and friction: at the end the cloth lies there."""
    thrower = throw_onto_target.Thrower((0.9, 0.3), resolution=3, frames=30, substeps=6)
    result = throw_onto_target.throw((0.9, 0.3), most=8, resolution=3, frames=30, substeps=6)
    assert result.first_miss > 0.3
    assert result.miss < 0.005
    thrower.landing(result.velocity)
    assert thrower.rollout.end.particle_q.numpy()[:, 2].max() < 0.05
