"""Cloth between obstacles that close on it: where nothing can keep it out of both, that is reported."""

import numpy as np
import pytest
import trimesh

import warpcloth as wc

BALL = trimesh.creation.icosphere(subdivisions=2, radius=1.0)


def simulated(obstacles: list[wc.Sphere | wc.Plane | wc.MeshObstacle], height: float = 0.0) -> wc.Simulation:
    cloth = wc.Cloth.grid((0.4, 0.4), (17, 17), wc.Fabric(stretch_stiffness=2000.0), transform=(0.0, 0.0, height))
    sim = wc.Simulation(wc.Model.build([cloth], obstacles), integrator="xpbd", contact="all")
    sim.run(16)
    return sim


def lowered(distance: float) -> wc.Motion:
    return wc.Motion.keyframes([(0.0, (0.0, 0.0, 0.0)), (0.25, (0.0, 0.0, -distance))])


def growing(name: str, height: float) -> wc.MeshObstacle:
    """A ball of 5 cm that grows to 30 cm in a quarter of a second."""
    points = np.stack([radius * BALL.vertices + (0.0, 0.0, height) for radius in (0.05, 0.3)])
    return wc.MeshObstacle(points[0], BALL.faces, sample_times=[0.0, 0.25], sample_points=points, name=name)


def test_deforming_meshes_that_go_through_cloth_are_told_of():
    """Their points are no obstacles at rest, to which cloth could be held."""
    found = simulated([growing("below", -0.25), growing("above", 0.31)]).metrics()
    assert found["obstacle_intersections"] > 0
    assert found["contact_pinched"] > 0


@pytest.mark.parametrize(("below", "pinched"), [(0.02, True), (-0.01, False)])
def test_particles_left_in_a_solid_are_told_of(below, pinched):
    """A ball comes down on a cloth on the ground, ``below`` [m] the ground or to a height above it."""
    ball = wc.Sphere((0.0, 0.0, 0.25), 0.2, motion=lowered(0.05 + below))
    found = simulated([wc.Plane(), ball], height=0.003).metrics()
    assert (found["max_penetration_m"] > 1e-4) == pinched
    assert (found["contact_pinched"] > 0) == pinched


@pytest.mark.parametrize("depth", [-0.001, 0.05])
def test_pins_led_to_a_box_or_into_it_throw_nothing_away(depth):
    """An edge of the cloth goes down to 1 mm above a box, or into it; contact right beside pins is a lever."""
    down = wc.Motion.keyframes([(0.0, (0.0, 0.0, 0.0)), (0.2, (0.0, 0.0, -0.1 - depth))])
    cloth = wc.Cloth.grid((0.4, 0.4), (9, 9), pins=[wc.pin("left", down)], transform=(0.0, 0.0, 0.2))
    box = wc.Box((-0.2, 0.0, 0.0), (0.2, 0.2, 0.2))
    sim = wc.Simulation(wc.Model.build([cloth], [box]), integrator="xpbd", contact="all")
    speeds = []
    sim.run(14, on_frame=lambda sim, _: speeds.append(sim.metrics()["max_speed"]))
    found = sim.metrics()
    assert max(speeds) < 8.0
    assert (found["obstacle_intersections"] > 0) == (depth > 0.0)
    assert (found["contact_pinched"] > 0) == (depth > 0.0)
