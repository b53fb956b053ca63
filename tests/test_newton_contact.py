"""Friction and contact of SolverMassSpring by closed forms, with contacts from Newton's own pipeline."""

import math

import newton
import numpy as np
import pytest
import warp as wp
from friction_problems import (
    CAPSTAN_RADIUS,
    EDGE_RADIUS,
    MU,
    THICKNESS,
    Start,
    capstan_start,
    capstan_tension,
    table_start,
)

import warpcloth as wc
from warpcloth.interop.newton import SolverMassSpring, add_cloth

UPRIGHT = wp.quat_identity()
ACROSS = wp.quat_from_axis_angle(wp.vec3(1.0, 0.0, 0.0), 0.5 * math.pi)  # from z to y
FABRIC = wc.Fabric(stretch_stiffness=50.0, shear_stiffness=20.0, damping_time=1e-3)


def material(mu: float) -> newton.ModelBuilder.ShapeConfig:
    return newton.ModelBuilder.ShapeConfig(mu=mu)


class Collisions:
    """Newton's collision pipeline and its buffer."""

    def __init__(self, model: newton.Model):
        self.pipeline = newton.CollisionPipeline(model)
        self.buffer = self.pipeline.contacts()

    def collide(self, state: newton.State) -> None:
        self.pipeline.collide(state, self.buffer)

    def roll_out(self, solver: SolverMassSpring, steps: int, dt: float) -> newton.State:
        now, later = solver.model.state(), solver.model.state()
        for _ in range(steps):
            self.collide(now)
            solver.step(now, later, None, self.buffer, dt)
            now, later = later, now
        return now


@pytest.fixture(scope="module")
def slope():
    """A small cloth on a plane through the origin, with one friction coefficient; the plane tilts with gravity."""
    builder = newton.ModelBuilder()
    cloth = wc.Cloth.grid((0.1, 0.1), (4, 4), FABRIC, transform=(0, 0, 0.5 * FABRIC.thickness))
    add_cloth(builder, cloth)
    builder.add_ground_plane(cfg=material(0.3))
    model = builder.finalize(device="cpu")
    model.soft_contact_mu = 0.3
    return model, Collisions(model)


def slid(slope, angle: float, name: str, steps: int) -> np.ndarray:
    """Ways of all particles down a slope [m] in 0.5 s."""
    model, collisions = slope
    model.set_gravity((9.81 * np.sin(np.radians(angle)), 0.0, -9.81 * np.cos(np.radians(angle))))
    end = collisions.roll_out(SolverMassSpring(model, name), steps, 0.5 / steps)
    way = end.particle_q.numpy() - model.particle_q.numpy()
    assert np.abs(way[:, 2]).max() < 1e-5
    return way[:, 0]


@pytest.mark.parametrize(("name", "steps"), [("symplectic_euler", 500), ("xpbd", 300), ("implicit_euler", 100)])
def test_cloth_slides_on_newtons_contacts_by_coulombs_law(slope, name, steps):
    """s = ½ (g sin θ − μ g cos θ) t² = 0.294536 m; first order in the step, hence the tolerance of one step's speed."""
    assert slid(slope, 30.0, name, steps).mean() == pytest.approx(0.294536, rel=1.5 / steps)


@pytest.mark.parametrize("name", ["symplectic_euler", "xpbd"])
def test_cloth_sticks_below_the_angle_of_friction(slope, name):
    """tan 16.6992° = 0.3: no creep at all below it, and motion above."""
    assert np.abs(slid(slope, 16.5, name, 500)).max() < 1e-6
    assert slid(slope, 17.0, name, 500).min() > 1e-3


def test_cloth_is_carried_by_a_body_that_moves():
    builder = newton.ModelBuilder()
    add_cloth(builder, wc.Cloth.grid((0.1, 0.1), (4, 4), FABRIC, transform=(0, 0, 0.5 * FABRIC.thickness)))
    body = builder.add_body(xform=wp.transform(wp.vec3(0.0, 0.0, -0.1), UPRIGHT))
    builder.add_shape_box(body, hx=0.5, hy=0.5, hz=0.1, cfg=material(0.5))
    model = builder.finalize(device="cpu")
    solver, collisions = SolverMassSpring(model), Collisions(model)
    now, later = model.state(), model.state()
    for k in range(200):
        now.body_q.assign([wp.transform(wp.vec3(0.1 * k * 1e-3, 0.0, -0.1), UPRIGHT)])
        now.body_qd.assign([wp.spatial_vector(0.1, 0.0, 0.0, 0.0, 0.0, 0.0)])
        collisions.collide(now)
        solver.step(now, later, None, collisions.buffer, 1e-3)
        now, later = later, now
    speed = now.particle_qd.numpy()
    np.testing.assert_allclose(speed, np.broadcast_to([0.1, 0.0, 0.0], speed.shape), atol=1e-4)
    np.testing.assert_array_equal(now.body_q.numpy(), later.body_q.numpy())


@pytest.mark.parametrize("moves", [False, True])
def test_cloth_lies_a_margin_off_shapes_that_have_one(moves):
    """Newton's margin is how much further out than its surface a shape acts; here on a box that lies on its side."""
    builder, place = newton.ModelBuilder(), wp.transform(wp.vec3(0.0, 0.0, -0.1), ACROSS)
    add_cloth(builder, wc.Cloth.grid((0.1, 0.1), (4, 4), FABRIC, transform=(0, 0, 0.01)))
    body = builder.add_body(xform=place, mass=1.0) if moves else -1
    shape = newton.ModelBuilder.ShapeConfig(mu=0.5, margin=0.004)
    builder.add_shape_box(body, xform=None if moves else place, hx=0.5, hy=0.1, hz=0.5, cfg=shape)
    model = builder.finalize(device="cpu")
    end = Collisions(model).roll_out(SolverMassSpring(model), 200, 1e-3)
    np.testing.assert_allclose(end.particle_q.numpy()[:, 2], 0.004 + 0.5 * FABRIC.thickness, atol=1e-5)


def finished(builder: newton.ModelBuilder, start: Start, friction: float) -> newton.Model:
    add_cloth(builder, start.cloth)
    model = builder.finalize(device="cpu")
    model.particle_qd.assign(start.velocities)
    model.soft_contact_mu = friction
    return model


def test_capstan():
    """Tensions of a strip drawn over half a cylinder stand as exp(μ π); its ends are massless and keep going."""
    start, builder = capstan_start(moving=False), newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    place = wp.transform(wp.vec3(0.0, 0.0, 0.0), ACROSS)
    radius = CAPSTAN_RADIUS - 0.5 * THICKNESS
    builder.add_shape_capsule(-1, xform=place, radius=radius, half_height=0.5, cfg=material(MU))
    model = finished(builder, start, MU)
    solver, collisions = SolverMassSpring(model), Collisions(model)
    now, later, ratios = model.state(), model.state(), []
    for step in range(900):
        collisions.collide(now)
        solver.step(now, later, None, collisions.buffer, 1.0 / 600.0)
        now, later = later, now
        if step >= 450:
            x = now.particle_q.numpy().astype(np.float64)
            ratios.append(capstan_tension(x, start.cloth, 1.0) / capstan_tension(x, start.cloth, -1.0))
    assert np.mean(ratios) == pytest.approx(math.exp(MU * math.pi), rel=0.02)
    assert np.hypot(*x[x[:, 2] > 0.0][:, [0, 2]].T).min() > CAPSTAN_RADIUS - 1e-4


@pytest.mark.parametrize(("share", "slides"), [(0.97, False), (1.03, True)])
def test_strip_over_the_edge_of_a_table(share, slides):
    """It slides off when overhang over length exceeds μ/(1 + μ); friction of a pair is the mean of 2 μ, or 0, and 0."""
    start, builder = table_start(share * MU / (1.0 + MU)), newton.ModelBuilder()
    skin = 0.5 * THICKNESS
    table = wp.transform(wp.vec3(-1.0, 0.0, -skin - 0.5), UPRIGHT)
    builder.add_shape_box(-1, xform=table, hx=1.0, hy=0.5, hz=0.5, cfg=material(2.0 * MU))
    edge = wp.transform(wp.vec3(0.0, 0.0, -EDGE_RADIUS), ACROSS)
    builder.add_shape_capsule(-1, xform=edge, radius=EDGE_RADIUS - skin, half_height=0.5, cfg=material(0.0))
    model = finished(builder, start, 0.0)
    end = Collisions(model).roll_out(SolverMassSpring(model), 600, 1.0 / 600.0)
    drop = float(start.cloth.points[:, 2].min() - end.particle_q.numpy()[:, 2].min())
    assert drop > 0.05 if slides else abs(drop) < 1e-3
