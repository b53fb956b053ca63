"""Newton's law of impact where it has closed forms: obstacles that move, and friction of what bounces.

Meshes are in float32, so velocities are true to 1e-3 m/s.
"""

import numpy as np
import pytest

import warpcloth as wc

E, MU = 0.5, 0.3
FABRIC = wc.Fabric(thickness=0.004, friction=MU, stretch_stiffness=20.0, shear_stiffness=4.0, bend_stiffness=0.2)
SURFACE = {"friction": MU, "restitution": E}
SCHEMES = ("velocity_verlet", "xpbd", "implicit_euler")


def floor(kind: str, speed: float) -> wc.Plane | wc.MeshObstacle:
    """At z = 0, which rises at ``speed`` [m/s]."""
    if kind == "plane":
        motion = wc.Motion.keyframes([(0.0, (0, 0, 0)), (1.0, (0, 0, speed))])
        return wc.Plane(**SURFACE, motion=motion if speed else None)
    points = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    samples = np.stack([points, points + np.array([0, 0, speed])])
    return wc.MeshObstacle(points, [[0, 1, 2], [0, 2, 3]], sample_times=[0, 1], sample_points=samples, **SURFACE)


def bounced(scheme: str, obstacle: wc.Plane | wc.MeshObstacle, velocity: tuple, substeps: int = 10) -> np.ndarray:
    """Velocities [m/s] of cloth that began 2 cm above an obstacle with this one, a tenth of a second later."""
    cloth = wc.Cloth.grid((0.1, 0.1), (3, 3), FABRIC, transform=(0.0, 0.0, 0.02), velocity=velocity)
    model = wc.Model.build([cloth], [obstacle], precision="float64")
    sim = wc.Simulation(model, scheme, gravity=(0, 0, 0), substeps=substeps, contact="obstacles")
    sim.run(6)
    return sim.state.particle_qd.numpy()


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("kind", ["plane", "deforming mesh"])
@pytest.mark.parametrize(("speed", "falls"), [(2.0, 0.0), (-1.0, -3.0)])
def test_an_obstacle_that_moves_throws_back_by_how_fast_they_approach(scheme, kind, speed, falls):
    velocity = bounced(scheme, floor(kind, speed), (0.0, 0.0, falls))
    assert velocity[:, 2] == pytest.approx(speed + E * (speed - falls), abs=1e-3)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("kind", ["plane", "deforming mesh"])
def test_friction_of_a_bounce_is_that_of_all_its_impulse(scheme, kind):
    """What stops it and what throws it back: μ (1 + e) times the speed at which it falls."""
    velocity = bounced(scheme, floor(kind, 0.0), (3.0, 0.0, -2.0))
    assert velocity[:, 2] == pytest.approx(E * 2.0, abs=1e-3)
    assert velocity[:, 0] == pytest.approx(3.0 - MU * (1.0 + E) * 2.0, abs=1e-3)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_what_is_slow_along_the_obstacle_sticks_in_a_bounce(scheme):
    velocity = bounced(scheme, floor("plane", 0.0), (0.8, 0.0, -2.0))
    assert velocity[:, 2] == pytest.approx(E * 2.0, abs=1e-3)
    assert velocity[:, 0] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(("along", "up", "falls"), [(0.5, 0.0, 6.0), (0.5, 6.0, 0.0)])
def test_a_deforming_mesh_takes_along_what_it_meets_far_from_where_the_step_began(along, up, falls):
    """In one step they approach by many contact distances; friction suffices for the mesh's velocity along itself."""
    points = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    samples = np.stack([points, points + np.array([along, 0.0, up])])
    mesh = wc.MeshObstacle(points, [[0, 1, 2], [0, 2, 3]], sample_times=[0, 1], sample_points=samples, friction=MU)
    cloth = wc.Cloth.grid((0.1, 0.1), (3, 3), FABRIC, transform=(0.0, 0.0, 0.02), velocity=(0.0, 0.0, -falls))
    sim = wc.Simulation(wc.Model.build([cloth], [mesh]), "xpbd", gravity=(0, 0, 0), substeps=1, contact="obstacles")
    sim.step(1.0 / 120.0)
    assert sim.state.particle_q.numpy()[:, 2].min() > up / 120.0
    assert sim.state.particle_qd.numpy() == pytest.approx(np.tile([along, 0.0, up], (9, 1)), abs=1e-3)
