"""USD stages simulated from beginning to end: what comes out beside the stage, which stays as it is."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import warp
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdUtils
from shot_files import (
    add_ball,
    add_cloth,
    add_mesh,
    cached_points,
    new_stage,
    pin_points,
    sheet,
    small_shot,
    to_stage,
)  # fmt: skip
from warpcloth.scenes import export_scene, load_scene, scene_from_toml, simulate
from warpcloth.scenes.usd import check_cache
from warpcloth.scenes.usd.check_stage import validator_errors
from warpcloth.scenes.usd.playback import Playback

from warpcloth.cli import run
from warpcloth.errors import InputError, UsdError

ASSETS = Path(warp.__file__).parent / "examples" / "assets"


def simulated(stage, output=None, cloth=(), collider=(), changes=(), **options):
    """The shot that comes out, checked; it has no errors but those of the assets that it refers to."""
    scene = load_scene(stage, changes, cloth=cloth, collider=collider)
    result = simulate(scene, output or stage.with_name(f"{stage.stem}_sim.usda"), device="cpu", **options)
    report = check_cache(result.output)
    assert set(report.usd_errors) <= set(validator_errors(Usd.Stage.Open(str(stage))))
    assert report.finite
    assert report.max_penetration_m < 1e-3
    assert report.obstacle_intersections == 0
    return result


def test_a_shot_and_an_exported_scene_may_be_usd(tmp_path):
    shot = simulated(small_shot(tmp_path / "shot.usd"), tmp_path / "done.usd").output
    for path in (shot, export_scene(load_scene("hanging"), tmp_path / "hanging.usd")):
        assert Path(path).read_bytes().startswith(b"PXR-USDC")
    assert {"done.usd", "done.usd.cache.usdc", "hanging.usd", "shot.usd"} == {p.name for p in tmp_path.iterdir()}


def test_a_stage_is_simulated_beside_itself(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    asset = small_shot(tmp_path / "shot.usda").read_bytes()
    assert run(["simulate", "shot.usda", "--device", "cpu", "--json"]) == 0
    out, err = capfd.readouterr()
    result = json.loads(out)
    assert (result["scene"], result["frames"], result["particles"]) == ("shot", 4, 25)
    assert result["output"] == str(tmp_path / "shot_sim.usda")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["shot.usda", "shot_sim.cache.usdc", "shot_sim.usda"]
    assert (tmp_path / "shot.usda").read_bytes() == asset
    assert run(["check", "shot_sim.usda"]) == 0
    shot = Sdf.Layer.FindOrOpen(str(tmp_path / "shot_sim.usda"))
    assert list(shot.subLayerPaths) == ["./shot_sim.cache.usdc", "./shot.usda"]
    assert not shot.rootPrims
    cache = Sdf.Layer.FindOrOpen(str(tmp_path / "shot_sim.cache.usdc"))
    assert all(prim.specifier == Sdf.SpecifierOver for prim in cache.rootPrims)
    start, end = (cached_points("shot_sim.usda", "/World/Shirt", code) for code in (0, 4))
    np.testing.assert_allclose(start, sheet()[0], atol=1e-7)
    moved = np.linalg.norm(end - start, axis=1)
    assert np.all(moved[[0, 4]] < 1e-7)
    assert np.all(moved[5:] > 1e-3)
    assert err == ""


def test_axes_units_and_time_codes_of_the_stage_are_kept(tmp_path):
    """The same shot in other words gives the same motion in other words."""
    plain = simulated(small_shot(tmp_path / "a.usda"), substeps=40)
    other = {"up": "Y", "metres": 0.01, "kilograms": 0.001, "rate": 48.0, "fps": 24.0, "start": 1001.0}
    told = simulated(small_shot(tmp_path / "b.usda", **other), substeps=40)
    stage = Usd.Stage.Open(str(told.output))
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1001.0, 1009.0)
    assert (stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()) == (48.0, 24.0)
    assert check_cache(told.output).fps == 24.0
    mesh = UsdGeom.Mesh.Get(stage, "/World/Shirt")
    assert mesh.GetPointsAttr().GetTimeSamples() == [1001.0, 1003.0, 1005.0, 1007.0, 1009.0]
    for frame in range(5):
        expected = to_stage(stage, cached_points(plain.output, "/World/Shirt", frame))
        found = cached_points(told.output, "/World/Shirt", 1001.0 + 2 * frame)
        np.testing.assert_allclose(found, expected, atol=2e-4)  # cm: a few roundings of 0.5 m in single precision


@pytest.mark.filterwarnings("ignore:Fabric 'plain' stretches")  # all diagonals of the asset lie one way
def test_assets_of_other_axes_and_units_composed_by_reference(tmp_path):
    """Warp's square cloth (Z up, 150 m) over its bunny (Y up) in a stage that is Y up and in centimetres."""
    path = tmp_path / "shot.usda"
    stage = new_stage(path, up="Y", metres=0.01, frames=4)
    cloth, bunny = (stage.DefinePrim(f"/World/{name}") for name in ("cloth", "bunny"))
    cloth.GetReferences().AddReference(str(ASSETS / "square_cloth.usd"), "/root/cloth")
    bunny.GetPayloads().AddPayload(str(ASSETS / "bunny.usd"))
    UsdGeom.XformCommonAPI(cloth).SetScale((0.4, 0.4, 0.4))
    UsdGeom.XformCommonAPI(cloth).SetRotate((0.0, 0.0, 0.0))  # in its own file it is turned for Z up
    UsdGeom.XformCommonAPI(cloth).SetTranslate((0.0, 54.5, 0.0))
    UsdGeom.XformCommonAPI(bunny).SetScale((33.0, 33.0, 33.0))
    stage.Save()
    result = simulated(
        path,
        cloth=["/World/cloth"],
        collider=["/World/bunny"],
        changes=["simulation.contact=all"],
        integrator="xpbd",
    )
    assert result.particles == 2500
    start, end = (cached_points(result.output, "/World/cloth/cloth", code) for code in (0, 4))
    np.testing.assert_allclose(np.ptp(start, axis=0), (60.0, 0.0, 40.0), atol=1e-3)
    fallen = start[:, 1] - end[:, 1]
    drop = 100.0 * 0.5 * 9.81 * (4.0 / 24.0) ** 2
    assert np.median(fallen) > 0.2 * drop  # what is not over the bunny falls ...
    assert fallen.min() < 0.05 * drop  # ... and its head holds the middle up
    assert result.max_penetration_m < 1e-3


def test_a_collider_with_sampled_points_lifts_cloth(tmp_path):
    path = tmp_path / "shot.usda"
    stage = new_stage(path, start=10.0, frames=6)
    add_cloth(stage)
    points, counts, indices = sheet(2, 1.0, 0.49)
    lid = add_mesh(stage, "/World/Lid", (points, counts, indices))
    UsdPhysics.CollisionAPI.Apply(lid.GetPrim())
    for frame in range(7):
        lifted = points + np.array((0.0, 0.0, 0.01 * frame))
        lid.GetPointsAttr().Set(to_stage(stage, lifted), 10.0 + frame)
        lid.GetExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(to_stage(stage, lifted)), 10.0 + frame)
    for attribute in (lid.GetPointsAttr(), lid.GetExtentAttr(), lid.GetNormalsAttr()):
        attribute.ClearDefault()  # as most tools write what is sampled
    lid.GetSubdivisionSchemeAttr().Set("catmullClark")
    stage.Save()
    result = simulated(path, integrator="xpbd")
    heights = [cached_points(result.output, "/World/Shirt", 10.0 + frame)[:, 2] for frame in range(7)]
    assert heights[-1].min() > 0.549  # 6 cm higher than the lid was
    assert heights[-1].max() < 0.7


def test_held_points_follow_the_animation_that_the_mesh_comes_with(tmp_path):
    path = tmp_path / "shot.usda"
    stage = new_stage(path)
    cloth = add_cloth(stage)
    pin_points(cloth, [0, 1, 2, 3, 4])
    move = UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddTranslateOp()
    for frame in range(5):
        move.Set(Gf.Vec3d(0.01 * frame, 0.0, 0.0), frame)
    stage.Save()
    result = simulated(path, integrator="symplectic_euler")  # whose pins have the velocity of this instant
    shot = Usd.Stage.Open(str(result.output))
    velocities = UsdGeom.Mesh.Get(shot, "/World/Shirt").GetVelocitiesAttr()
    for frame in range(5):
        assert np.abs(np.array(velocities.Get(frame))[:5]).max() < 1e-5  # seen from where they are held: they stand
        held = cached_points(result.output, "/World/Shirt", frame)[:5]
        np.testing.assert_allclose(held, sheet()[0][:5] + np.array((0.01 * frame, 0.0, 0.0)), atol=1e-6)


@pytest.mark.parametrize(("error", "kept"), [(KeyboardInterrupt, True), (RuntimeError, False)])
def test_an_interrupt_keeps_the_frames_so_far_and_a_failure_nothing(tmp_path, error, kept):
    def stop(frame, frames, simulation):
        if frame == 2:
            raise error

    path = small_shot(tmp_path / "shot.usda")
    output = tmp_path / "out.usda"
    if kept:
        with pytest.raises(KeyboardInterrupt):
            simulate(load_scene(path), output, device="cpu", on_frame=stop)
        assert Usd.Stage.Open(str(output)).GetEndTimeCode() == 2.0
        assert check_cache(output).ok
    else:
        with pytest.raises(RuntimeError):
            simulate(load_scene(path), output, device="cpu", on_frame=stop)
        assert [file.name for file in tmp_path.iterdir()] == ["shot.usda"]


def test_one_instance_is_simulated_and_the_other_is_left_alone(tmp_path):
    shirt = new_stage(tmp_path / "shirt.usda")
    add_cloth(shirt, "/World/Shirt")
    shirt.Save()
    stage = new_stage(tmp_path / "shot.usda")
    for name, x in (("a", 0.0), ("b", 1.0)):
        prim = stage.DefinePrim(f"/World/{name}", "Xform")
        prim.GetReferences().AddReference("./shirt.usda")
        prim.SetInstanceable(True)
        UsdGeom.XformCommonAPI(prim).SetTranslate((x, 0.0, 0.0))
    stage.Save()
    result = simulated(tmp_path / "shot.usda", cloth=["/World/b"])
    assert result.particles == 25
    shot = Usd.Stage.Open(str(result.output))
    assert shot.GetPrimAtPath("/World/a").IsInstance()
    assert not shot.GetPrimAtPath("/World/b").IsInstance()
    still = [cached_points(result.output, "/World/a/Shirt", code) for code in (0, 4)]
    assert np.array_equal(*still)
    assert np.all(cached_points(result.output, "/World/b/Shirt", 4)[:, 2] < 0.45)


def test_a_collider_inside_an_instance_is_one_in_the_shot_too(tmp_path):
    ball = new_stage(tmp_path / "ball.usda")
    add_ball(ball, "/World/Ball").GetPrim().RemoveAPI(UsdPhysics.CollisionAPI)
    ball.Save()
    stage = new_stage(tmp_path / "shot.usda")
    add_cloth(stage)
    prim = stage.DefinePrim("/World/Set", "Xform")
    prim.GetReferences().AddReference("./ball.usda")
    prim.SetInstanceable(True)
    stage.Save()
    result = simulated(tmp_path / "shot.usda", collider=["/World/Set"])
    assert check_cache(result.output).obstacles == 1


@pytest.mark.parametrize("scheme", ["catmullClark", None])
def test_smooth_meshes_have_no_stale_normals_nor_accelerations(tmp_path, scheme):
    stage = new_stage(tmp_path / "shot.usda")
    mesh = add_cloth(stage)
    mesh.GetPrim().RemoveProperty("subdivisionScheme")
    if scheme:
        mesh.CreateSubdivisionSchemeAttr(scheme)
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", Sdf.ValueTypeNames.Normal3fArray, "vertex")
    primvar.Set([(0.0, 0.0, 1.0)] * 25)
    mesh.CreateAccelerationsAttr([(0.0, 0.0, 1.0)] * 25)
    stage.Save()
    result = simulate(load_scene(tmp_path / "shot.usda"), tmp_path / "out.usda", integrator="xpbd", device="cpu")
    assert check_cache(result.output).usd_errors == ()
    shot = Usd.Stage.Open(str(result.output))
    shirt = UsdGeom.Mesh.Get(shot, mesh.GetPath())
    assert shirt.GetSubdivisionSchemeAttr().Get() == "catmullClark"
    assert shirt.GetNormalsAttr().Get(4) is None
    assert shirt.GetAccelerationsAttr().Get(4) is None


@pytest.mark.parametrize("ending", [".usdc", ".usdz"])
def test_packages_in_and_out(tmp_path, ending):
    export_scene(scene_from_toml(NAPKIN), tmp_path / "napkin.usdz")
    (tmp_path / "out").mkdir()
    result = simulated(tmp_path / "napkin.usdz", tmp_path / "out" / f"napkin{ending}")
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == (["napkin.usdz"] if ending == ".usdz" else ["napkin.usdc", "napkin.usdc.cache.usdc"])
    assert result.particles == 81
    start, end = (cached_points(result.output, "/World/Cloth/napkin/mesh", code) for code in (0, 3))
    assert np.all(end[:, 2] < start[:, 2])


NAPKIN = """
frames = 3
[simulation]
integrator = "xpbd"
[[cloth]]
name = "napkin"
shape = "grid"
resolution = [9, 9]
size = [0.4, 0.4]
position = [0.1, 0.2, 0.42]
rotation = [20.0, 10.0, 30.0]
fabric = "cotton"
[[obstacle]]
shape = "sphere"
radius = 0.2
center = [0.1, 0.2, 0.05]
motion.interpolation = "smooth"
motion.keys = [{ time = 0.0 }, { time = 0.2, position = [0.0, 0.0, 0.1] }]
"""


def test_an_exported_scene_moves_like_the_scene(tmp_path):
    """Model and steps are the same; local coordinates in single precision are what tells them apart."""
    scene = scene_from_toml(NAPKIN, name="napkin")
    path = export_scene(scene, tmp_path / "napkin.usda")
    assert validator_errors(Usd.Stage.Open(str(path))) == []
    told = simulated(path)
    plain = simulate(scene, tmp_path / "plain.usdc", device="cpu")
    for frame in range(4):
        expected = cached_points(plain.output, "/World/Cloth/napkin", frame)
        found = cached_points(told.output, "/World/Cloth/napkin/mesh", frame)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7)


def test_shots_of_one_name_have_layers_of_their_own(tmp_path):
    """What another shot becomes changes nothing about the first."""
    stage, files = small_shot(tmp_path / "shot.usda"), {}
    for name, frames in (("k.usda", 3), ("k.usdc", 2), ("k.usdz", 1)):
        result = simulated(stage, tmp_path / name, frames=frames)
        assert check_cache(result.output).frames == frames + 1
        assert all(path.read_bytes() == before for path, before in files.items())
        files = {path: path.read_bytes() for path in tmp_path.iterdir()}
    names = ["k.cache.usdc", "k.usda", "k.usdc", "k.usdc.cache.usdc", "k.usdz", "shot.usda"]
    assert sorted(path.name for path in files) == names
    packed = zipfile.ZipFile(tmp_path / "k.usdz").namelist()
    assert (packed[0], {Path(name).name for name in packed}) == ("k.usda", {"k.usda", "k.cache.usdc", "shot.usda"})


def test_a_package_that_fails_is_kept_unpacked(tmp_path, monkeypatch):
    stage = small_shot(tmp_path / "shot.usda")
    monkeypatch.setattr(UsdUtils, "CreateNewUsdzPackage", lambda *_: False)
    with pytest.raises(UsdError, match=r"^Cannot write k.usdz: the stage cannot be packed; the shot and its") as caught:
        simulate(load_scene(stage), tmp_path / "k.usdz", device="cpu", frames=2)
    folder = Path(str(caught.value).split(" kept in ")[1].rstrip("."))
    assert check_cache(folder / "k.usda").frames == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == [folder.name, "shot.usda"]


def test_output_must_spare_what_the_stage_consists_of(tmp_path):
    add_ball(stage := new_stage(tmp_path / "set.usda"))
    stage.Save()
    path = small_shot(tmp_path / "shot.usda")
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.subLayerPaths = ["./set.usda"]
    layer.Save()
    before = [(tmp_path / name).read_bytes() for name in ("set.usda", "shot.usda")]
    for output in ("shot.usda", "set.usda"):
        assert run(["simulate", str(path), "-o", str(tmp_path / output)]) == 2
    assert [(tmp_path / name).read_bytes() for name in ("set.usda", "shot.usda")] == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["set.usda", "shot.usda"]


def test_a_network_of_springs_swings_like_its_scene(tmp_path):
    scene = load_scene("pendulum", ["frames=6"])
    told = simulated(export_scene(scene, tmp_path / "pendulum.usda"))
    plain = simulate(scene, tmp_path / "plain.usdc", device="cpu")
    stages = [Usd.Stage.Open(str(result.output)) for result in (told, plain)]
    for part in ("particles", "springs"):
        shapes = [UsdGeom.PointBased.Get(stage, f"/World/Cloth/pendulum/{part}") for stage in stages]
        for frame in range(7):
            assert np.array_equal(*(np.array(shape.GetPointsAttr().Get(frame)) for shape in shapes))
            assert np.array_equal(*(np.array(shape.GetVelocitiesAttr().Get(frame)) for shape in shapes))


def test_a_stage_is_not_exported_again(tmp_path):
    with pytest.raises(InputError, match=r"Scene 'shot' is a USD stage already, shot.usda."):
        export_scene(load_scene(small_shot(tmp_path / "shot.usda")), tmp_path / "again.usda")


def test_a_shot_is_played_from_its_first_frame_on_with_obstacles_where_they_are(tmp_path):
    stage = new_stage(tmp_path / "shot.usda", start=1001.0)
    add_cloth(stage)
    move = add_ball(stage).GetOrderedXformOps()[0]
    for code in (1001.0, 1005.0):
        move.Set(Gf.Vec3d(0.0, 0.0, 0.1 + 0.01 * (code - 1001.0)), code)
    stage.Save()
    playback = Playback(simulated(tmp_path / "shot.usda").output)
    assert [playback.time(frame) for frame in (0, 3)] == [0.0, 0.125]
    (ball,) = playback.obstacles
    height = ball.center[2] + ball.matrix(playback.time(3))[2, 3]
    assert height == pytest.approx(0.13, abs=1e-9)
