"""What a stage says of itself, and what of the prims below one that somebody names becomes cloth or collider."""

import pytest
from pxr import Sdf, Usd, UsdGeom, UsdPhysics
from shot_files import add_ball, add_cloth, add_mesh, new_stage, sheet
from warpcloth.scenes import load_scene, simulate
from warpcloth.scenes.shots.export import export_scene
from warpcloth.scenes.shots.shot import read_shot
from warpcloth.scenes.usd import check_cache
from warpcloth.scenes.usd.playback import can_play

from warpcloth.errors import SceneError, UsdError


def add_body(stage, *names):
    """Solids that do not say that they are colliders."""
    stage.DefinePrim("/World/Body", "Xform")
    solids = [add_ball(stage, f"/World/Body/{name}") for name in names]
    for solid in solids:
        solid.GetPrim().RemoveAPI(UsdPhysics.CollisionAPI)
    return solids


def obstacles(path, *colliders):
    return [obstacle.name for obstacle in read_shot(path, ["/World/Shirt"], colliders).obstacles]


@pytest.fixture
def stage(tmp_path):
    stage = new_stage(tmp_path / "shot.usda")
    add_cloth(stage)
    return stage


@pytest.mark.parametrize("hidden", ["guide", "proxy", "invisible"])
def test_what_no_picture_shows_is_no_collider_unless_there_is_no_other(tmp_path, stage, hidden):
    skin, other = add_body(stage, "Skin", "Other")
    if hidden == "invisible":
        other.MakeInvisible()
    else:
        other.CreatePurposeAttr(hidden)
    stage.Save()
    path = tmp_path / "shot.usda"
    assert obstacles(path, "/World/Body") == ["Skin"]
    assert obstacles(path, "/World/Body/Other") == ["Other"]
    skin.MakeInvisible()
    stage.Save()
    assert obstacles(path, "/World/Body") == ["Skin", "Other"]


@pytest.mark.parametrize("kind", ["cloth", "collider"])
def test_inactive_prims_are_said_to_be_inactive(tmp_path, stage, kind):
    """They were said not to be there, with their own neighbours as what may be meant."""
    add_mesh(stage, "/World/Rack/Scarf")
    for path, words in (
        ("/World/Rack/Scarf", "Prim /World/Rack/Scarf in shot.usda is inactive and takes part in nothing; activate it"),
        ("/World/Rack", "In shot.usda, /World/Rack above /World/Rack/Scarf is inactive and takes part in nothing; act"),
    ):
        stage.GetPrimAtPath(path).SetActive(False)
        stage.Save()
        with pytest.raises(UsdError, match=f"^{words}"):
            read_shot(tmp_path / "shot.usda", **{"cloth": ["/World/Shirt"], kind: ["/World/Rack/Scarf"]})
    stage.GetPrimAtPath("/World/Rack").SetActive(True)
    stage.GetPrimAtPath("/World/Rack/Scarf").SetActive(True)
    stage.Save()
    read_shot(tmp_path / "shot.usda", **{"cloth": ["/World/Shirt"], kind: ["/World/Rack/Scarf"]})


def test_a_collider_that_is_no_shape_stands_for_those_below_it(tmp_path, stage):
    """Cloth fell past them, without a word."""
    body = stage.GetPrimAtPath(add_body(stage, "Skin", "Other")[0].GetPath().GetParentPath())
    api = UsdPhysics.CollisionAPI.Apply(body)
    add_cloth(stage, "/World/Body/Scarf")
    stage.Save()
    shot = read_shot(tmp_path / "shot.usda", ["/World/Shirt", "/World/Body/Scarf"])
    assert [obstacle.name for obstacle in shot.obstacles] == ["Skin", "Other"]
    assert list(map(str, shot.colliders)) == ["/World/Body/Skin", "/World/Body/Other"]
    api.CreateCollisionEnabledAttr(False)
    stage.Save()
    assert obstacles(tmp_path / "shot.usda") == []


def test_hair_and_dust_are_no_colliders(tmp_path, stage):
    add_body(stage, "Skin")
    UsdGeom.BasisCurves.Define(stage, "/World/Body/Hair")
    UsdGeom.Points.Define(stage, "/World/Body/Dust")
    stage.Save()
    assert obstacles(tmp_path / "shot.usda", "/World/Body") == ["Skin"]
    with pytest.raises(UsdError, match="Collider /World/Body/Hair is a BasisCurves, which cannot be an obstacle"):
        obstacles(tmp_path / "shot.usda", "/World/Body/Hair")


def test_what_no_picture_shows_is_no_cloth_unless_there_is_no_other(tmp_path, stage):
    for name, purpose in (("render", "render"), ("proxy", "proxy")):
        add_mesh(stage, f"/World/Coat/{name}", sheet(3)).CreatePurposeAttr(purpose)
    stage.Save()
    path = tmp_path / "shot.usda"
    assert [cloth.name for cloth in read_shot(path, ["/World/Coat"]).cloths] == ["render"]
    assert [cloth.name for cloth in read_shot(path, ["/World/Coat/proxy"]).cloths] == ["proxy"]
    stage.GetPrimAtPath("/World/Coat/render").SetActive(False)
    stage.Save()
    assert [cloth.name for cloth in read_shot(path, ["/World/Coat"]).cloths] == ["proxy"]


@pytest.mark.parametrize(("fps", "frames"), [(24.0, 4), (48.0, 8), (12.0, 2), (1e9, None)])
def test_another_frame_rate_fills_the_same_time(tmp_path, stage, fps, frames):
    stage.Save()
    change = [f"fps={fps}"]
    if frames is None:
        with pytest.raises(SceneError, match=r"fps must be a number from 0.001 to 100,000"):
            load_scene(tmp_path / "shot.usda", change)
        return
    assert load_scene(tmp_path / "shot.usda", change).frames == frames
    assert load_scene(tmp_path / "shot.usda", [*change, "frames=3"]).frames == 3


def test_an_animated_stage_is_no_cache_before_its_cloth_is_simulated(tmp_path, stage):
    walker = add_mesh(stage, "/World/Walker", sheet(3))
    for code in (0.0, 4.0):
        walker.GetPointsAttr().Set(walker.GetPointsAttr().Get(), code)
    stage.Save()
    assert not can_play(tmp_path / "shot.usda")
    simulate(load_scene(tmp_path / "shot.usda"), tmp_path / "out.usda", integrator="xpbd", device="cpu", frames=1)
    assert can_play(tmp_path / "out.usda")
    export_scene(load_scene("hanging"), tmp_path / "exported.usda")
    exported = Usd.Stage.Open(str(tmp_path / "exported.usda"))
    add_mesh(exported, "/World/Walker", sheet(3)).GetPointsAttr().Set(walker.GetPointsAttr().Get(0.0), 1.0)
    exported.Save()
    assert not can_play(tmp_path / "exported.usda")
    stage.RemovePrim("/World/Shirt")
    stage.Save()
    assert can_play(tmp_path / "shot.usda")


def test_cloth_may_have_its_faces_sampled_at_every_frame(tmp_path, stage):
    mesh = add_cloth(stage)
    for attribute in (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()):
        value = attribute.Get()
        attribute.Clear()
        for code in (0.0, 1.0, 2.0):
            attribute.Set(value, code)
    stage.Save()
    result = simulate(load_scene(tmp_path / "shot.usda"), tmp_path / "out.usda", device="cpu", frames=2)
    assert result.triangles == 32
    assert check_cache(result.output).ok


@pytest.mark.parametrize("code", [Usd.TimeCode.Default(), 0.0], ids=["once", "sampled"])
def test_models_that_cloth_is_in_do_not_keep_the_extent_that_they_had(tmp_path, stage, code):
    """The root's hint has the cloth where it starts, 0.5 m high, before it falls; the toy's is as good as it was."""
    toy = stage.DefinePrim("/World/Toy", "Xform")
    add_ball(stage, "/World/Toy/Ball")
    for prim in (stage.GetPrimAtPath("/World"), toy):
        hint = UsdGeom.ModelAPI.Apply(prim).ComputeExtentsHint(UsdGeom.BBoxCache(code, ["default"]))
        UsdGeom.ModelAPI(prim).SetExtentsHint(hint, code)
    stage.Save()
    result = simulate(load_scene(tmp_path / "shot.usda"), tmp_path / "out.usda", device="cpu", frames=2)
    shot = Usd.Stage.Open(str(result.output))
    bounds = UsdGeom.BBoxCache(2.0, ["default"], useExtentsHint=True)
    assert bounds.ComputeWorldBound(shot.GetPrimAtPath("/World")).ComputeAlignedRange().GetMax()[2] < 0.49
    assert UsdGeom.ModelAPI(shot.GetPrimAtPath("/World/Toy")).GetExtentsHintAttr().Get(0.0)


def test_strain_is_that_under_a_scale_that_has_samples_only(tmp_path, stage):
    scale = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Shirt")).AddScaleOp()
    for code in (0.0, 2.0):
        scale.Set((2.0, 2.0, 2.0), code)
    stage.Save()
    result = simulate(load_scene(tmp_path / "shot.usda"), tmp_path / "out.usda", device="cpu", frames=2)
    assert check_cache(result.output).max_strain < 0.01


@pytest.mark.parametrize("mesh", [sheet(2), sheet(5)], ids=["one face", "many"])
@pytest.mark.parametrize("interpolation", ["uniform", "faceVarying", "vertex", "constant"])
def test_one_weight_pins_all_points_whatever_it_is_said_to_be_of(tmp_path, mesh, interpolation):
    stage = new_stage(tmp_path / "shot.usda")
    primvars = UsdGeom.PrimvarsAPI(add_cloth(stage, mesh=mesh))
    primvars.CreatePrimvar("pins", Sdf.ValueTypeNames.FloatArray, interpolation).Set([1.0])
    stage.Save()
    (part,) = read_shot(tmp_path / "shot.usda").parts
    assert len(part.cloth.pinned) == len(part.cloth.points)


def test_strain_is_that_from_the_rest_shape_where_a_mesh_has_one(tmp_path, stage):
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Shirt"))
    attribute = mesh.GetPrim().CreateAttribute("physics:restShapePoints", Sdf.ValueTypeNames.Point3fArray)
    points = mesh.GetPointsAttr().Get()
    attribute.Set(points)
    mesh.GetPointsAttr().Set([point * 1.15 for point in points])
    stage.Save()
    result = simulate(load_scene(tmp_path / "shot.usda"), tmp_path / "out.usda", device="cpu", frames=4)
    assert check_cache(result.output).max_strain == pytest.approx(0.15, rel=0.01)  # in the first frame
    attribute.Set(points[:3])
    stage.Save()
    (error,) = check_cache(result.output).usd_errors
    assert "has 3 physics:restShapePoints for 25 points" in error
