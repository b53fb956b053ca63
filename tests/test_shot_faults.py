"""Stages that cannot be simulated: one sentence, exit code 2, and no file."""

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdShade
from shot_files import add_ball, add_cloth, add_mesh, new_stage, pin_points, set_thickness, sheet, to_stage

from warpcloth.cli import run


def plain_mesh(stage):
    add_mesh(stage, "/World/Shirt")


def only_a_ball(stage):
    add_ball(stage)


def changing_faces(stage):
    mesh = add_cloth(stage)
    for code, counts in ((0, [4] * 16), (1, [4] * 15)):
        mesh.GetFaceVertexCountsAttr().Set(counts, code)


def other_faces_at_rest(stage):
    mesh = add_cloth(stage)
    corners = list(mesh.GetFaceVertexIndicesAttr().Get())
    mesh.GetFaceVertexIndicesAttr().Set(corners[4:] + corners[:4], 0)


def changing_points(stage):
    mesh = add_cloth(stage)
    pin_points(mesh, [0])
    points = to_stage(stage, sheet()[0])
    for code, count in ((0, 25), (2, 24)):
        mesh.GetPointsAttr().Set(points[:count], code)


def no_faces(stage):
    add_cloth(stage, mesh=(sheet()[0], [], []))


def nan_points(stage):
    points = sheet()[0]
    points[3, 1] = np.nan
    add_cloth(stage, mesh=(points, *sheet()[1:]))


def nan_sample(stage):
    points = sheet()[0]
    mesh = add_cloth(stage)
    points[3, 1] = np.nan
    mesh.GetPointsAttr().Set(to_stage(stage, points), 0)


def face_out_of_range(stage):
    points, counts, indices = sheet()
    add_cloth(stage, mesh=(points, counts, [*indices[:-1], 25]))


def branching(stage):
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)]
    add_cloth(stage, mesh=(np.array(points, float), [3, 3, 3], [0, 1, 2, 0, 1, 3, 0, 1, 4]))


def flattened(stage):
    add_cloth(stage)
    UsdGeom.XformCommonAPI(stage.GetPrimAtPath("/World/Shirt")).SetScale((1.0, 1.0, 0.0))


def flattened_later(stage):
    scale = UsdGeom.Xformable(add_cloth(stage)).AddScaleOp()
    for code, size in ((0, 1.0), (2, 0.0), (4, 1.0)):
        scale.Set(Gf.Vec3f(size), code)


def turned_inside_out(stage):
    """Between two samples, of which none flattens."""
    scale = UsdGeom.Xformable(add_cloth(stage)).AddScaleOp()
    for code, size in ((1, 1.0), (5, -1.0)):
        scale.Set(Gf.Vec3f(1.0, 1.0, size), code)


def nan_transform(stage):
    UsdGeom.Xformable(add_cloth(stage)).AddTransformOp().Set(Gf.Matrix4d(np.nan))


def nan_transform_later(stage):
    move = UsdGeom.Xformable(add_cloth(stage)).AddTranslateOp()
    for code, height in ((0, 0.0), (2, np.nan), (4, 0.0)):
        move.Set(Gf.Vec3d(0.0, 0.0, height), code)


def nan_ball(stage):
    add_cloth(stage)
    add_ball(stage).GetOrderedXformOps()[0].Set(Gf.Vec3d(0.0, np.inf, 0.0), 2)


def metadata(**values):
    """Something that the stage says of itself."""

    def spoil(stage):
        add_cloth(stage)
        for key, value in values.items():
            stage.SetMetadata(key, value)

    spoil.__name__ = "_".join(f"{key}_{value}" for key, value in values.items())
    return spoil


def stiffer_in_shear(stage):
    add_cloth(stage, surfaceStretchStiffness=10.0, surfaceShearStiffness=100.0)


def pins_out_of_range(stage):
    pin_points(add_cloth(stage), [25])


def pins_of_words(stage):
    primvar = UsdGeom.PrimvarsAPI(add_cloth(stage)).CreatePrimvar("pins", Sdf.ValueTypeNames.StringArray, "vertex")
    primvar.Set(["left"] * 25)


def pins_that_let_go(stage):
    primvar = UsdGeom.PrimvarsAPI(add_cloth(stage)).CreatePrimvar("pins", Sdf.ValueTypeNames.FloatArray, "vertex")
    for code, weight in ((0, 1.0), (1, 0.9), (2, 0.0)):
        primvar.Set([weight] * 25, code)


def edge_pins(stage):
    subset = UsdGeom.Subset.Define(stage, add_cloth(stage).GetPath().AppendChild("pins"))
    subset.CreateElementTypeAttr("edge")
    subset.CreateIndicesAttr([0, 1])


def few_pin_weights(stage):
    primvar = UsdGeom.PrimvarsAPI(add_cloth(stage)).CreatePrimvar("pins", Sdf.ValueTypeNames.FloatArray, "vertex")
    primvar.Set([1.0, 0.0])


def few_rest_points(stage):
    prim = add_cloth(stage).GetPrim()
    prim.CreateAttribute("physics:restShapePoints", Sdf.ValueTypeNames.Point3fArray).Set([(0, 0, 0)])


def no_such_grid(stage):
    prim = add_cloth(stage).GetPrim()
    prim.CreateAttribute("warpcloth:shape", Sdf.ValueTypeNames.Token).Set("grid")
    prim.CreateAttribute("warpcloth:size", Sdf.ValueTypeNames.DoubleArray).Set([0.4, 0.4])
    prim.CreateAttribute("warpcloth:resolution", Sdf.ValueTypeNames.IntArray).Set([5, 5])


def missing_reference(stage):
    add_cloth(stage)
    stage.DefinePrim("/World/Set").GetReferences().AddReference("./set.usda")


def missing_sublayer(stage):
    add_cloth(stage)
    stage.GetRootLayer().subLayerPaths = ["./layout.usda"]


def endless_motion(stage):
    subset = UsdGeom.Subset.CreateGeomSubset(add_cloth(stage), "pins", "point", [0], "pins").GetPrim()
    subset.CreateAttribute("warpcloth:motion:times", Sdf.ValueTypeNames.DoubleArray).Set([0.0, 0.0])


def stretched_ball(stage):
    add_cloth(stage)
    UsdGeom.XformCommonAPI(add_ball(stage).GetPrim()).SetScale((1.0, 2.0, 1.0))


def scattered_ball(stage):
    add_cloth(stage)
    scatter = UsdGeom.PointInstancer.Define(stage, "/World/Scatter")
    scatter.CreatePrototypesRel().AddTarget(add_ball(stage, "/World/Scatter/Ball").GetPath())
    scatter.CreateProtoIndicesAttr([0])
    scatter.CreatePositionsAttr([(0, 0, 0)])


FAULTS = [
    (scattered_ball, "Collider /World/Scatter/Ball is scattered by a point instancer"),
    (
        plain_mesh,
        "Nothing in shot.usda says that it is cloth by PhysicsSurfaceDeformableSimAPI; choose from its meshes",
    ),
    (
        only_a_ball,
        "Nothing in shot.usda says that it is cloth by PhysicsSurfaceDeformableSimAPI; it has no mesh at all.",
    ),
    (changing_faces, "Cloth /World/Shirt has a faceVertexCounts that changes over time"),
    (other_faces_at_rest, "Cloth /World/Shirt has a faceVertexIndices that changes over time"),
    (changing_points, "Cloth /World/Shirt has 25 points at first but 24 at time code 2"),
    (no_faces, "Mesh '/World/Shirt' is empty: it has 25 vertices and 0 faces."),
    (nan_points, "Mesh '/World/Shirt'"),
    (nan_sample, "Cloth /World/Shirt has points that are not finite numbers at time code 0."),
    (face_out_of_range, "a face refers to vertex 25, which is not one of 0 to 24"),
    (branching, "is not manifold"),
    (flattened, "flattens space"),
    (flattened_later, "Prim /World/Shirt has a transform that flattens space at time code 2; cloth needs a scale"),
    (turned_inside_out, "Prim /World/Shirt has a transform that flattens space at time code 3; cloth needs a scale"),
    (nan_transform, "Prim /World/Shirt has a transform that is not of finite numbers at time code 0."),
    (nan_transform_later, "Prim /World/Shirt has a transform that is not of finite numbers at time code 1."),
    (nan_ball, "Prim /World/Ball has a transform that is not of finite numbers at time code 2."),
    (metadata(upAxis="X"), "Cannot use shot.usda: its upAxis is 'X', but must be 'Y' or 'Z'."),
    (metadata(metersPerUnit=-1.0), "Cannot use shot.usda: its metersPerUnit is -1, but must be a number above 0."),
    (metadata(kilogramsPerUnit=np.nan), "Cannot use shot.usda: its kilogramsPerUnit is nan, but must be a number"),
    (metadata(timeCodesPerSecond=0.0), "Cannot use shot.usda: its timeCodesPerSecond is 0, but must be a number above"),
    (metadata(timeCodesPerSecond=-24.0), "Cannot use shot.usda: its timeCodesPerSecond is -24, but must be a number"),
    (metadata(framesPerSecond=0.0), "shot.usda: fps must be"),
    (metadata(framesPerSecond=np.inf), "shot.usda: fps must be"),
    (metadata(endTimeCode=np.inf), "Cannot use shot.usda: its time codes from 0 to inf have no end."),
    (metadata(endTimeCode=1e300), "shot.usda: frames must be"),
    (metadata(startTimeCode=5.0, endTimeCode=1.0), "shot.usda: its endTimeCode 1 is before its startTimeCode 5."),
    (metadata(endTimeCode=np.nan), "Cannot use shot.usda: its time codes from 0 to nan have no end."),
    (metadata(startTimeCode=-np.inf), "Cannot use shot.usda: its startTimeCode is -inf, but must be a finite number."),
    (stiffer_in_shear, "The fabric of /World/Fabric cannot be used"),
    (pins_out_of_range, "The pins /World/Shirt/pins name point 25, which is not one of 0 to 24."),
    (edge_pins, "The pins /World/Shirt/pins are a subset of edges; make it one of points or faces."),
    (pins_of_words, "Cloth /World/Shirt has primvars:pins of type string[], but pins are numbers."),
    (pins_that_let_go, "Cloth /World/Shirt has primvars:pins that hold other points later; pins hold from beg"),
    (few_pin_weights, "Cloth /World/Shirt has 2 values of primvars:pins, but needs one for each point: 25."),
    (few_rest_points, "physics:restShapePoints must be one for each of its 25 points, and there are 1."),
    (no_such_grid, "says that it is a grid of resolution 5 × 5, but has other triangles"),
    (missing_reference, "Cannot use shot.usda, which is incomplete: could not open asset"),
    (missing_sublayer, "Cannot use shot.usda, which is incomplete: could not load sublayer"),
    (endless_motion, "The motion noted on /World/Shirt/pins cannot be used"),
    (stretched_ball, "Collider /World/Ball is a Sphere stretched out of its shape"),
]


def refused(capfd, folder, sentence, *options) -> None:
    """``simulate`` says one sentence and leaves nothing behind."""
    before = sorted(path.name for path in folder.iterdir())
    capfd.readouterr()  # what OpenUSD said of the spoilt stage when it was made
    assert run(["simulate", str(folder / "shot.usda"), "--device", "cpu", *options]) == 2
    out, err = capfd.readouterr()
    assert sentence in " ".join(err.split())
    assert err.count("\n") == 1
    assert out == ""
    assert sorted(path.name for path in folder.iterdir()) == before


@pytest.mark.parametrize(("spoil", "sentence"), FAULTS, ids=[fault.__name__ for fault, _ in FAULTS])
def test_a_stage_that_cannot_be_simulated_is_one_sentence(tmp_path, monkeypatch, capfd, spoil, sentence):
    monkeypatch.chdir(tmp_path)
    stage = new_stage(tmp_path / "shot.usda")
    spoil(stage)
    stage.Save()
    refused(capfd, tmp_path, sentence)


CHOICES = [
    (["--cloth", "/World/Shrt"], "There is no prim /World/Shrt in shot.usda; did you mean /World/Shirt?"),
    (["--cloth", "World Shirt"], "stage.cloth must be a list, each item a USD prim path such as '/World/Shirt'"),
    (["--cloth", "/World/Ball"], "Prim /World/Ball in shot.usda is a Sphere with no mesh in it"),
    (["--cloth", "/"], "There is no prim / in shot.usda"),
    (["--cloth", "/World/Shirt", "--collider", "/World/Fabric"], "Prim /World/Fabric in shot.usda has no shape in it"),
    (
        ["--cloth", "/World/Shirt", "--collider", "/World/Ball", "--collider", "/World"],
        "Prim /World/Shirt in shot.usda cannot be both cloth and collider; give other colliders than /World.",
    ),
    (["--set", "stage.fabric=demin"], "must be a table or the name of a fabric"),
    (["--set", "network.k_s=1"], "shot.usda: the key 'network.positions' is missing"),
    (["--cloth", "/World/Shirt", "-o", "out.abc"], "must end in .usd, .usdc, .usda or .usdz"),
]


@pytest.mark.parametrize(
    ("options", "sentence"), CHOICES, ids=lambda value: " ".join(value) if isinstance(value, list) else ""
)
def test_a_wrong_choice_is_one_sentence(tmp_path, monkeypatch, capfd, options, sentence):
    monkeypatch.chdir(tmp_path)
    stage = new_stage(tmp_path / "shot.usda")
    plain_mesh(stage)
    add_ball(stage)
    UsdShade.Material.Define(stage, "/World/Fabric")
    stage.Save()
    refused(capfd, tmp_path, sentence, *options)


def test_what_a_point_instancer_scatters_is_no_cloth(tmp_path, capfd):
    stage = new_stage(tmp_path / "shot.usda")
    UsdGeom.PointInstancer.Define(stage, "/World/Scatter")
    plain_mesh(stage)
    add_mesh(stage, "/World/Scatter/Leaf")
    stage.Save()
    refused(capfd, tmp_path, "Prim /World/Scatter/Leaf in shot.usda is scattered", "--cloth", "/World/Scatter/Leaf")


@pytest.mark.parametrize("option", ["--cloth", "--collider"])
def test_classes_are_neither_cloth_nor_colliders(tmp_path, capfd, option):
    stage = new_stage(tmp_path / "shot.usda")
    add_cloth(stage)
    stage.CreateClassPrim("/_shirts")
    add_mesh(stage, "/_shirts/Shirt")
    stage.Save()
    refused(capfd, tmp_path, "Prim /_shirts/Shirt in shot.usda is or belongs to a class", option, "/_shirts/Shirt")


@pytest.mark.parametrize("content", [b"", b"#usda 1.0\ndef Mesh {", b"PXR-USDC and so on", b"solid stl"])
def test_a_broken_file_is_one_sentence(tmp_path, monkeypatch, capfd, content):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shot.usda").write_bytes(content)
    refused(capfd, tmp_path, "Cannot read")


def test_scenes_export_explains_itself(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    mistakes = (
        (["export"], "`scenes export` needs the scene to export"),
        (["export", "flag", "-o", "flag.obj"], "must end in .usd, .usdc, .usda or .usdz"),
        (["explode"], "There is no `scenes explode`"),
        (["list", "flag"], "`scenes list` takes neither a scene nor options"),
    )
    for arguments, sentence in mistakes:
        assert run(["scenes", *arguments]) == 2
        assert sentence in " ".join(capfd.readouterr().err.split())
    assert run(["simulate", "flag", "--cloth", "/World/Cloth"]) == 2
    assert "flag.toml is not a USD stage" in capfd.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_thickness_without_meaning_is_left_out(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    stage = new_stage(tmp_path / "shot.usda", frames=1)
    set_thickness(add_cloth(stage, density=-1.0), float("inf"))
    stage.Save()
    assert run(["simulate", "shot.usda", "--device", "cpu"]) == 0


def test_a_transform_may_flatten_cloth_when_it_is_not_simulated(tmp_path):
    scale = UsdGeom.Xformable(add_cloth(stage := new_stage(tmp_path / "shot.usda"))).AddScaleOp()
    for code, size in ((-5, 0.0), (0, 1.0), (4, 1.0), (9, 0.0)):
        scale.Set(Gf.Vec3f(size), code)
    stage.Save()
    assert run(["simulate", str(tmp_path / "shot.usda"), "-o", str(tmp_path / "out.usda"), "--device", "cpu"]) == 0
