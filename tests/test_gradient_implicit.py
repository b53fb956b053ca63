"""Gradients through implicit schemes: the adjoint of their linear systems, against central finite differences."""

import numpy as np
import pytest
from gradient_checks import RandomLoss, assert_slopes_agree, slopes

import warpcloth as wc
from warpcloth.errors import SimulationError
from warpcloth.gradients import Rollout
from warpcloth.gradients.implicit import flexible_gmres

FABRIC = wc.Fabric(
    stretch_stiffness=100.0, shear_stiffness=20.0, bending_rigidity=2e-5, damping_time=2e-3, thickness=0.01
)
TIGHT = {"tolerance": 1e-12}
AIR = wc.Air(wind=(1.0, 2.0, 0.5), gust=0.2, turbulence=0.3)


def small(integrator: str, substeps: int, obstacles: tuple = (), **options) -> wc.Simulation:
    """Nine crumpled vertices in wind, one held and one led."""
    lead = wc.Motion.keyframes([(0.0, (0, 0, 0)), (1.0, (0.3, 0.0, 0.2))])
    pins = [] if obstacles else [wc.pin(0), wc.pin(2, lead)]
    cloth = wc.Cloth.grid((0.2, 0.2), (3, 3), FABRIC, pins, (0, 0, 1), velocity=(0.3, 0.1, 0.0))
    model = wc.Model.build([cloth], obstacles, precision="float64", differentiable=True)
    simulation = wc.Simulation(model, integrator, substeps=substeps, air=AIR, integrator_options=TIGHT, **options)
    free = model.particle_inv_mass.numpy() > 0.0
    noise = 0.005 * np.random.default_rng(0).normal(size=(9, 3)) * free[:, None]
    simulation.state.particle_q.assign(simulation.state.particle_q.numpy() + noise)
    return simulation


def test_implicit_euler_through_200_steps():
    rollout = Rollout(small("implicit_euler", 4), 50, fps=400, observe=[50])
    assert rollout.steps == 200
    assert_slopes_agree(RandomLoss(rollout), together=True)


@pytest.mark.parametrize("integrator", ["implicit_euler", "implicit_midpoint", "implicit_trapezoid"])
def test_every_gradient_of_each_implicit_scheme(integrator):
    assert_slopes_agree(RandomLoss(Rollout(small(integrator, 2), 2, observe=[2])), zero=("bend_friction",))


@pytest.mark.parametrize(("integrator", "frames"), [("implicit_euler", 5), ("implicit_midpoint", 10)])
def test_sliding_on_a_ball(integrator, frames):
    """Implicit Euler takes the ball into its solution, the midpoint rule at the ends of steps."""
    ball = wc.Sphere((0.03, 0.02, 0.797), 0.2, friction=0.1)
    rollout = Rollout(small(integrator, 2, (ball, wc.Plane(friction=0.1))), frames, observe=[frames])
    loss = RandomLoss(rollout)
    loss.value()
    gradients = loss.gradients()
    assert gradients["particle_friction"].any()
    friction = ["particle_friction", "obstacle_friction"]
    others = [name for name in gradients if name not in (*friction, "obstacle_restitution")]
    for names in (friction, others, ["particle_q"], ["particle_mass"]):
        slope, difference = slopes(loss, names, gradients)
        assert abs(difference) > 1e-5
        assert abs(slope - difference) <= 1e-4 * abs(difference), (names, slope, difference)


def test_gmres_equals_a_dense_solve():
    rng = np.random.default_rng(0)
    a = np.eye(30) + 0.3 * rng.normal(size=(30, 30)) / np.sqrt(30)
    b = rng.normal(size=(10, 3))
    x = flexible_gmres(lambda x: (a @ x.reshape(-1)).reshape(-1, 3), lambda x: 0.5 * x, b, 1e-12)
    assert np.abs(a @ x.reshape(-1) - b.reshape(-1)).max() <= 1e-11
    assert not flexible_gmres(lambda x: x, lambda x: x, np.zeros((10, 3)), 1e-12).any()
    with pytest.raises(SimulationError, match="did not converge"):
        flexible_gmres(lambda x: np.roll(x, 1, axis=0), lambda x: x, np.eye(300)[:, :1], 1e-12)
