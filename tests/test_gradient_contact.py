"""Gradients through contact with obstacles, with friction, against central finite differences."""

import numpy as np
import pytest
from gradient_checks import RandomLoss, assert_slopes_agree

import warpcloth as wc
from warpcloth.gradients import Rollout

FABRIC = wc.Fabric(stretch_stiffness=100.0, shear_stiffness=20.0, thickness=0.01, damping_time=2e-3, friction=0.4)
TURN = wc.Motion.keyframes([(0.0, (0, 0, 0)), (1.0, (0.2, 0, 0), (0, 0, 1.5))])
SHAPES = {
    "plane": wc.Plane((0, 0, -0.02), (0.2, 0.1, 1.0), friction=0.01, restitution=0.3),
    "sphere": wc.Sphere((0.02, 0.01, -0.32), 0.3, friction=0.01, restitution=0.3),
    "capsule": wc.Capsule((-0.5, 0.03, -0.12), (0.5, 0.0, -0.13), 0.1, friction=0.01, restitution=0.3),
    "box": wc.Box((0.03, 0.0, -0.12), (0.9, 0.8, 0.2), (0.1, 0.2, 0.3), friction=0.01, restitution=0.3),
    "moving": wc.Sphere((0.02, 0.01, -0.32), 0.3, friction=0.01, restitution=0.3, motion=TURN),
}


@pytest.mark.parametrize("integrator", ["symplectic_euler", "xpbd"])
def test_sliding_over_a_ball_onto_a_plane_through_200_steps(integrator):
    cloth = wc.Cloth.grid((0.4, 0.4), (5, 5), FABRIC, transform=(0, 0, 0.36), velocity=(0.3, 0.1, -1.0))
    obstacles = [wc.Plane((0, 0, 0.2), (0.1, 0, 1), friction=0.3), wc.Sphere((0.03, 0.02, 0.1), 0.2, friction=0.3)]
    model = wc.Model.build([cloth], obstacles, precision="float64", differentiable=True)
    rollout = Rollout(wc.Simulation(model, integrator, substeps=20), 10)
    assert rollout.steps == 200
    loss = RandomLoss(rollout)
    assert_slopes_agree(loss, h=1e-7, zero=("obstacle_restitution",))
    loss.value()
    gradients = loss.gradients()
    assert gradients["particle_friction"].any()
    assert gradients["obstacle_friction"].all()  # both were touched


@pytest.mark.parametrize("shape", SHAPES)
def test_thrown_onto_each_shape(shape):
    """So fast that the way of one step, 25 mm, is far longer than the contact distance: paths are swept."""
    soft = wc.Fabric(stretch_stiffness=1.0, shear_stiffness=0.2, bend_stiffness=0.0, thickness=0.01, damping_time=2e-3)
    cloth = wc.Cloth.grid((0.2, 0.2), (3, 3), soft, transform=(0, 0, 0.2), velocity=(1.0, 0.5, -6.0))
    model = wc.Model.build([cloth], [SHAPES[shape]], precision="float64", differentiable=True)
    rollout = Rollout(wc.Simulation(model, substeps=4), 6)
    start = rollout.start.particle_q.numpy()
    rollout.start.particle_q.assign(start + 0.01 * np.random.default_rng(2).normal(size=start.shape))
    assert_slopes_agree(RandomLoss(rollout), h=1e-7)


@pytest.mark.parametrize(
    "obstacle", [wc.Box((0, 0, -0.01), (4, 4, 0.02), restitution=0.3), wc.Capsule((-2, 0, -0.1), (2, 0, -0.1), 0.1)]
)
def test_thrown_at_a_flat_angle(obstacle):
    """At a tenth, and as far as marching towards the surface does not get in the steps that it has."""
    soft = wc.Fabric(stretch_stiffness=1.0, shear_stiffness=0.2, bend_stiffness=0.0, thickness=0.01, friction=0.1)
    cloth = wc.Cloth.grid((0.02, 0.02), (2, 2), soft, transform=(-0.5, 0.003, 0.02), velocity=(20.0, 0.1, -2.0))
    model = wc.Model.build([cloth], [obstacle], precision="float64", differentiable=True)
    rollout = Rollout(wc.Simulation(model, "xpbd", gravity=(0, 0, 0), substeps=1), 1)
    assert_slopes_agree(RandomLoss(rollout), h=1e-7, together=True)
    assert rollout.end.particle_q.numpy()[:, 2].min() > 0.0


def test_what_sticks_keeps_its_place():
    """With much friction the end is the start: ∂x/∂x₀ is the identity, and ∂x/∂g is zero."""
    fabric = wc.Fabric(thickness=0.01, friction=2.0)
    cloth = wc.Cloth.grid((0.2, 0.2), (3, 3), fabric, transform=(0, 0, 0.006))
    model = wc.Model.build([cloth], [wc.Plane(friction=2.0)], precision="float64", differentiable=True)
    rollout = Rollout(wc.Simulation(model, gravity=(2.0, 0.0, -9.81), substeps=10), 5)
    rollout.forward()
    assert np.array_equal(rollout.end.particle_q.numpy(), rollout.start.particle_q.numpy())
    weights = np.random.default_rng(0).normal(size=(9, 3))
    gradients = rollout.backward(weights)
    assert np.abs(gradients["particle_q"].numpy() - weights).max() <= 1e-12
    assert not gradients["gravity"].numpy().any()
