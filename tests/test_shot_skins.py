"""Meshes that skeletons and blend shapes move: colliders follow them, and cloth starts and is held where they are."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdSkel
from shot_files import add_cloth, add_mesh, cached_points, new_stage, pin_points, sheet
from warpcloth.scenes import load_scene, simulate
from warpcloth.scenes.shots.shot import read_shot
from warpcloth.scenes.usd import check_cache

from warpcloth.errors import UsdError

RATE = 24.0
ELBOW = (0.0, 0.0, 0.4)


def add_skeleton(stage: Usd.Stage, path: str = "/World/Body") -> UsdSkel.Animation:
    """A skeleton of a root and an elbow at 0.4 m, which goes up by 0.1 m and turns by a quarter within a second."""
    UsdSkel.Root.Define(stage, path)
    skeleton = UsdSkel.Skeleton.Define(stage, f"{path}/Skeleton")
    places = [Gf.Matrix4d(1.0), Gf.Matrix4d().SetTranslate(ELBOW)]
    skeleton.CreateJointsAttr(["root", "root/elbow"])
    skeleton.CreateBindTransformsAttr(places)
    skeleton.CreateRestTransformsAttr(places)
    animation = UsdSkel.Animation.Define(stage, f"{path}/Animation")
    animation.CreateJointsAttr(["root", "root/elbow"])
    animation.CreateScalesAttr([(1.0, 1.0, 1.0)] * 2)
    turned = Gf.Quatf(Gf.Rotation(Gf.Vec3d(0, 0, 1), 90.0).GetQuat())
    for code, height, turn in ((0.0, 0.4, Gf.Quatf(1.0)), (RATE, 0.5, turned)):
        animation.CreateTranslationsAttr().Set([(0.0, 0.0, 0.0), (0.0, 0.0, height)], code)
        animation.CreateRotationsAttr().Set([Gf.Quatf(1.0), turn], code)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    return animation


def hang(mesh: UsdGeom.Mesh, joint: int, path: str = "/World/Body") -> UsdSkel.BindingAPI:
    """Lets all of a mesh follow one joint."""
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([f"{path}/Skeleton"])
    count = len(mesh.GetPointsAttr().Get())
    binding.CreateJointIndicesPrimvar(False, 1).Set([joint] * count)
    binding.CreateJointWeightsPrimvar(False, 1).Set([1.0] * count)
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
    return binding


def add_solid(stage: Usd.Stage, path: str, joint: int = 1) -> UsdSkel.BindingAPI:
    mesh = add_mesh(stage, path, sheet(2, 1.0, 0.45))
    UsdPhysics.CollisionAPI.Apply(mesh.GetPrim())
    return hang(mesh, joint)


def turned(points: np.ndarray, time: float) -> np.ndarray:
    """Points that hang on the elbow, at a time [s]."""
    angle = 0.5 * np.pi * time
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    return points @ turn.T + (0.0, 0.0, 0.1 * time)


def test_a_collider_follows_its_skeleton(tmp_path):
    stage = new_stage(tmp_path / "shot.usda")
    add_cloth(stage)
    add_skeleton(stage)
    add_solid(stage, "/World/Body/Arm")
    move = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Body")).AddTranslateOp()
    move.Set(Gf.Vec3d(1.0, 0.0, 0.0))
    UsdGeom.Xformable(stage.GetPrimAtPath("/World/Body/Arm")).AddTranslateOp().Set((7.0, 7.0, 7.0))  # does not count
    stage.Save()
    (solid,) = read_shot(tmp_path / "shot.usda").obstacles
    for time in np.linspace(0.0, 1.0, 25):
        expected = turned(sheet(2, 1.0, 0.45)[0], time) + np.array([1.0, 0.0, 0.0])
        np.testing.assert_allclose(solid.points_at(time), expected, atol=1e-6)


def test_a_skeleton_in_an_instance_moves_where_the_instance_is(tmp_path):
    body = new_stage(tmp_path / "body.usda")
    add_skeleton(body)
    add_solid(body, "/World/Body/Arm")
    body.Save()
    stage = new_stage(tmp_path / "shot.usda")
    add_cloth(stage)
    actor = stage.DefinePrim("/World/Actor", "Xform")
    actor.GetReferences().AddReference("./body.usda")
    actor.SetInstanceable(True)
    move = UsdGeom.Xformable(actor).AddTranslateOp()
    for code in (0.0, RATE):
        move.Set(Gf.Vec3d(0.0, code / RATE, -0.2), code)
    stage.Save()
    (solid,) = read_shot(tmp_path / "shot.usda").obstacles
    for time in (0.0, 0.25, 1.0):
        expected = turned(sheet(2, 1.0, 0.45)[0], time) + np.array([0.0, time, -0.2])
        np.testing.assert_allclose(solid.points_at(time), expected, atol=1e-6)


def test_a_skeleton_without_animation_is_in_its_rest_pose(tmp_path):
    stage = new_stage(tmp_path / "shot.usda")
    add_cloth(stage)
    add_skeleton(stage)
    add_solid(stage, "/World/Body/Arm")
    skeleton = UsdSkel.Skeleton.Get(stage, "/World/Body/Skeleton")
    stage.RemovePrim("/World/Body/Animation")
    skeleton.GetRestTransformsAttr().Set([Gf.Matrix4d().SetTranslate((0.0, 0.0, 0.2)), Gf.Matrix4d(1.0)])
    stage.Save()
    (solid,) = read_shot(tmp_path / "shot.usda").obstacles
    assert not solid.moves
    np.testing.assert_allclose(solid.points, sheet(2, 1.0, 0.45)[0] - (0.0, 0.0, 0.2), atol=1e-6)


def test_blend_shapes_move_colliders_before_their_skeleton_does(tmp_path):
    stage = new_stage(tmp_path / "shot.usda")
    add_cloth(stage)
    animation = add_skeleton(stage)
    binding = add_solid(stage, "/World/Body/Arm")
    shape = UsdSkel.BlendShape.Define(stage, "/World/Body/Arm/swell")
    shape.CreateOffsetsAttr([(0.0, 0.0, 0.2), (0.2, 0.0, 0.0)])
    shape.CreatePointIndicesAttr([1, 2])
    binding.CreateBlendShapesAttr(["swell"])
    binding.CreateBlendShapeTargetsRel().SetTargets([shape.GetPath()])
    animation.CreateBlendShapesAttr(["other", "swell"])
    for code in (0.0, RATE):
        animation.CreateBlendShapeWeightsAttr().Set([1.0, code / RATE], code)
    stage.Save()
    (solid,) = read_shot(tmp_path / "shot.usda").obstacles
    for time in (0.0, 0.5, 1.0):
        points = sheet(2, 1.0, 0.45)[0].copy()
        points[1, 2] += 0.2 * time
        points[2, 0] += 0.2 * time
        np.testing.assert_allclose(solid.points_at(time), turned(points, time), atol=1e-6)


def test_a_mesh_that_does_not_fit_its_skeleton_is_refused(tmp_path):
    stage = new_stage(tmp_path / "shot.usda")
    add_cloth(stage)
    add_skeleton(stage)
    add_solid(stage, "/World/Body/Arm", joint=2)
    stage.Save()
    with pytest.raises(UsdError, match=r"^Mesh /World/Body/Arm does not fit the skeleton or blend shapes it has\.$"):
        read_shot(tmp_path / "shot.usda")


def test_cloth_on_a_skeleton_starts_in_its_pose_is_held_by_it_and_not_moved_twice(tmp_path):
    stage = new_stage(tmp_path / "shot.usda", start=12.0)
    add_skeleton(stage)
    mesh = add_cloth(stage, "/World/Body/Shirt")
    hang(mesh, 1)
    pin_points(mesh, [0, 4])
    stage.Save()
    result = simulate(load_scene(tmp_path / "shot.usda"), tmp_path / "out.usda", integrator="xpbd", device="cpu")
    points = sheet()[0]
    start = cached_points(result.output, "/World/Body/Shirt", 12.0)
    np.testing.assert_allclose(start, turned(points, 0.5), atol=1e-6)
    assert result.max_strain < 0.02
    for frame in range(5):
        code = 12.0 + frame
        held = cached_points(result.output, "/World/Body/Shirt", code)[[0, 4]]
        np.testing.assert_allclose(held, turned(points, code / RATE)[[0, 4]], atol=1e-6)
    shot = Usd.Stage.Open(str(result.output))
    cache = UsdSkel.Cache()
    cache.Populate(UsdSkel.Root.Get(shot, "/World/Body"), Usd.PrimDefaultPredicate)
    assert not cache.ComputeSkelBindings(UsdSkel.Root.Get(shot, "/World/Body"), Usd.PrimDefaultPredicate)
    assert check_cache(result.output).finite
