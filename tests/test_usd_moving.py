"""Transforms with few samples: what moves between them takes the way that it takes in the stage."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Ts, Usd, UsdGeom, UsdPhysics
from shot_files import add_cloth, new_stage, pin_points
from warpcloth.scenes import load_scene, simulate
from warpcloth.scenes.shots.shot import read_shot
from warpcloth.scenes.usd import read_obstacles
from warpcloth.scenes.usd.moving import merged, path_codes, transform_codes

from warpcloth.errors import UsdError
from warpcloth.transforms import apply

RATE = 24.0
TIMES = np.linspace(-0.2, 1.2, 43)
SQUARE = [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.1, 0.2, 0.0), (0.0, 0.2, 0.1)]


def arm(stage: Usd.Stage, kind: type = UsdGeom.Cube) -> UsdGeom.Gprim:
    """A collider half a metre beside the origin of its parent, which is for the test to turn."""
    UsdGeom.Xform.Define(stage, "/Arm")
    shape = kind.Define(stage, "/Arm/Shape")
    if kind is UsdGeom.Mesh:
        shape.CreatePointsAttr(SQUARE)
        shape.CreateFaceVertexCountsAttr([4])
        shape.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    UsdPhysics.CollisionAPI.Apply(shape.GetPrim())
    shape.AddTranslateOp().Set(Gf.Vec3d(0.5, 0.0, 0.1))
    return shape


def new_scene() -> Usd.Stage:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(RATE)
    return stage


def placed(prim: Usd.Prim, time: float) -> np.ndarray:
    """The square where the stage has it [m], shape [4, 3]."""
    return apply(np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(RATE * time)).T, np.array(SQUARE))


def spin(parent, shape):
    turn = parent.AddRotateZOp()
    turn.Set(0.0, 0.0)
    turn.Set(-720.0, RATE)


def quarter(parent, shape):
    turn = parent.AddOrientOp()
    turn.Set(Gf.Quatf(1.0), 0.0)
    turn.Set(Gf.Quatf(0.0, 0.0, 1.0, 0.0), RATE)


def euler(parent, shape):
    parent.AddTranslateOp().Set(Gf.Vec3d(1.0, 2.0, 3.0))
    turn = parent.AddRotateXYZOp()
    turn.Set(Gf.Vec3f(10.0, 0.0, 0.0), 0.0)
    turn.Set(Gf.Vec3f(100.0, -200.0, 40.0), RATE)
    move = shape.AddTranslateOp(opSuffix="more")
    move.Set(Gf.Vec3d(0.0), 6.0)
    move.Set(Gf.Vec3d(0.2, 0.0, 0.0), 18.0)


def around_a_pivot(parent, shape):
    parent.AddTranslateOp(opSuffix="pivot").Set(Gf.Vec3d(0.5, 0.3, 0.0))
    turn = parent.AddRotateZOp()
    turn.Set(0.0, 0.0)
    turn.Set(180.0, RATE)
    parent.AddTranslateOp(opSuffix="pivot", isInverseOp=True)


def eased(parent, shape):
    spline = Ts.Spline("float")
    for time, value in ((0.0, 0.0), (RATE, 270.0)):
        knot = Ts.Knot(typeName="float", time=time, value=value, nextInterp=Ts.InterpCurve)
        spline.SetKnot(knot)
    parent.AddRotateZOp().GetAttr().SetSpline(spline)


@pytest.mark.parametrize("kind", [UsdGeom.Cube, UsdGeom.Mesh])
@pytest.mark.parametrize("animate", [spin, quarter, euler, around_a_pivot, eased])
def test_colliders_take_the_way_that_they_take_in_the_stage(kind, animate):
    stage = new_scene()
    shape = arm(stage, kind)
    animate(UsdGeom.Xformable(shape.GetPrim().GetParent()), shape)
    (solid,) = read_obstacles(stage)
    rest = placed(shape.GetPrim(), solid.motion.times[0])
    gone = 0.0
    for time in TIMES:
        expected = placed(shape.GetPrim(), time)
        found = apply(solid.matrix(time), rest)
        np.testing.assert_allclose(found, expected, atol=5e-4)  # an arm of 1.2 m at the most, over 2900
        gone = max(gone, float(np.abs(expected - rest).max()))
    assert gone > 0.4


def test_what_is_stretched_while_it_turns_takes_its_way_too():
    stage = new_scene()
    shape = arm(stage, UsdGeom.Mesh)
    parent = UsdGeom.Xformable(shape.GetPrim().GetParent())
    spin(parent, shape)
    grow = parent.AddScaleOp()
    grow.Set(Gf.Vec3f(1.0), 0.0)
    grow.Set(Gf.Vec3f(1.5, 1.0, 1.0), RATE)
    (solid,) = read_obstacles(stage)
    for time in TIMES:
        np.testing.assert_allclose(solid.points_at(time), placed(shape.GetPrim(), time), atol=5e-4)


@pytest.mark.parametrize("fps", [24.0, 6.0])
@pytest.mark.parametrize("how", ["parent", "points"])
def test_what_is_scaled_while_it_moves_runs_along_a_parabola(how, fps):
    stage = new_scene()
    stage.SetFramesPerSecond(fps)
    shape = arm(stage, UsdGeom.Mesh)
    grow = UsdGeom.Xformable(shape.GetPrim().GetParent()).AddScaleOp()
    move = shape.AddTranslateOp(opSuffix="more")
    far = np.array([0.4, 0.0, 0.0])
    for code in (0.0, RATE):
        grow.Set(Gf.Vec3f(1.0 + code / RATE, 1.0, 1.0), code)
        if how == "parent":
            move.Set(Gf.Vec3d(*(far * code / RATE).tolist()), code)
        else:
            shape.GetPointsAttr().Set([tuple(point) for point in np.array(SQUARE) + far * code / RATE], code)
    (solid,) = read_obstacles(stage)
    for time in TIMES:
        u = min(1.0, max(0.0, time))
        expected = (np.array(SQUARE) + (0.5, 0.0, 0.1) + far * u) * (1.0 + u, 1.0, 1.0)
        np.testing.assert_allclose(solid.points_at(time), expected, atol=0.11 / min(24.0, fps) ** 2)
    assert len(solid.sample_times) <= 25


def test_held_points_take_the_way_that_their_mesh_takes(tmp_path):
    stage = new_stage(tmp_path / "shot.usda")
    mesh = add_cloth(stage)
    pin_points(mesh, [0, 4])
    spin(UsdGeom.Xformable(stage.GetDefaultPrim()), mesh)
    stage.Save()
    (part,) = read_shot(tmp_path / "shot.usda").parts
    points = np.array(mesh.GetPointsAttr().Get(), float)
    (pin,) = part.cloth.pins
    assert pin.indices.tolist() == [0, 4]
    for time in TIMES:
        matrix = np.array(UsdGeom.Xformable(mesh).ComputeLocalToWorldTransform(RATE * time)).T
        found = pin.motion.evaluate(points[pin.indices], time)
        np.testing.assert_allclose(found, apply(matrix, points[pin.indices]), atol=2e-4)


def test_matrices_are_joined_as_rigid_bodies():
    """Stages mix the entries of two matrices, which squeezes what turns: between samples that is nobody's wish."""
    stage = new_scene()
    shape = arm(stage, UsdGeom.Sphere)
    parent = UsdGeom.Xformable(shape.GetPrim().GetParent())
    turn = parent.AddTransformOp()
    lean = parent.AddRotateXOp()
    for code in (0.0, 6.0):
        turn.Set(Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(0, 0, 1), 5.0 * code)), code)
        lean.Set(2.0 * code, code)
    assert path_codes(shape.GetPrim()) == transform_codes(shape.GetPrim()) == [0.0, 6.0]
    (ball,) = read_obstacles(stage)
    assert ball.moves


def test_a_matrix_may_be_blocked_at_times():
    stage = new_scene()
    shape = arm(stage)
    turn = UsdGeom.Xformable(shape.GetPrim().GetParent()).AddTransformOp()
    for code in (0.0, 12.0):
        turn.Set(Gf.Matrix4d().SetTranslate((code, 0.0, 0.0)), code)
    turn.GetAttr().Set(Sdf.ValueBlock(), 6.0)
    assert path_codes(shape.GetPrim()) == [0.0, 6.0, 12.0]
    (box,) = read_obstacles(stage)
    np.testing.assert_allclose(apply(box.matrix(0.25), box.center), (0.5, 0.0, 0.1), atol=1e-9)


def test_codes_that_rounding_parts_are_one():
    assert merged(new_scene(), [0.0, 1.0, 2.0], [1.0 + 1e-9, 1.5]) == [0.0, 1.0, 1.5, 2.0]


def test_still_and_straight_motions_need_no_more_than_their_samples():
    stage = new_scene()
    shape = arm(stage)
    assert path_codes(shape.GetPrim()) == []
    move = UsdGeom.Xformable(shape.GetPrim().GetParent()).AddTranslateOp()
    for code in (0.0, 10.0, 100.0):
        move.Set(Gf.Vec3d(0.0, 0.0, code), code)
    assert path_codes(shape.GetPrim()) == [0.0, 10.0, 100.0]


def test_turns_that_nobody_can_follow_are_refused():
    stage = new_scene()
    shape = arm(stage)
    turn = UsdGeom.Xformable(shape.GetPrim().GetParent()).AddRotateZOp()
    turn.Set(0.0, 0.0)
    turn.Set(1e9, RATE)
    with pytest.raises(UsdError, match=r"^Prim /Arm/Shape turns by 1e\+09° between time codes 0 and 24, which is too"):
        read_obstacles(stage)


def test_held_points_stand_still_as_seen_from_what_turns_with_them(tmp_path):
    """At 3.6 m/s: velocities are those at the frame, not over much of what follows it."""
    stage = new_stage(tmp_path / "shot.usda")
    pin_points(add_cloth(stage), [0, 1, 2, 3, 4])
    turn = UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddRotateZOp()
    for frame in range(5):
        turn.Set(30.0 * frame, frame)
    stage.Save()
    scene = load_scene(tmp_path / "shot.usda")
    result = simulate(scene, tmp_path / "out.usda", device="cpu", integrator="symplectic_euler")
    shot = Usd.Stage.Open(str(result.output))
    velocities = UsdGeom.Mesh.Get(shot, "/World/Shirt").GetVelocitiesAttr()
    for frame in range(5):
        assert np.abs(np.array(velocities.Get(frame))[:5]).max() < 0.02
    assert np.abs(np.array(velocities.Get(0))[5:]).max() > 1.0  # the others do not turn yet
