"""Meshes of USD stages: axes, units, transforms, orientation, texture coordinates, instances."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdUtils, Vt
from usd_files import SQUARE, write_usd

from warpcloth.cloth import Cloth
from warpcloth.errors import MeshError
from warpcloth.meshes import TriangleMesh, read_mesh
from warpcloth.obstacles import MeshObstacle


def area(mesh: TriangleMesh) -> float:
    corners = mesh.points[mesh.triangles]
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()


@pytest.mark.parametrize("suffix", ["usda", "usdc", "usd"])
def test_usd_axes_units_and_transforms_are_converted(tmp_path, suffix):
    path = tmp_path / f"sheet.{suffix}"
    stage, mesh = write_usd(path, up="Y", metres=0.01)
    UsdGeom.Xformable(stage.GetPrimAtPath("/world")).AddTranslateOp().Set(Gf.Vec3d(100, 0, 0))
    mesh.AddScaleOp().Set(Gf.Vec3f(10, 20, 1))
    stage.Save()
    read = read_mesh(path)
    assert read.name == "sheet"
    np.testing.assert_allclose(read.points, [(1, 0, 0), (1.1, 0, 0), (1.1, 0, 0.2), (1, 0, 0.2)], atol=1e-12)


def test_usdz_is_read(tmp_path):
    stage, _ = write_usd(tmp_path / "sheet.usda")
    stage.Save()
    UsdUtils.CreateNewUsdzPackage(str(tmp_path / "sheet.usda"), str(tmp_path / "sheet.usdz"))
    assert area(read_mesh(tmp_path / "sheet.usdz")) == pytest.approx(1.0)


@pytest.mark.parametrize("left", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
def test_left_handed_and_mirrored_meshes_keep_their_fronts(tmp_path, left, mirrored):
    path = tmp_path / "up.usda"
    stage, mesh = write_usd(path, indices=(0, 3, 2, 1) if left else (0, 1, 2, 3))
    mesh.CreateOrientationAttr("leftHanded" if left else "rightHanded")
    mesh.AddScaleOp().Set(Gf.Vec3f(-1.0 if mirrored else 1.0, 1, 1))
    stage.Save()
    corners = read_mesh(path).points[read_mesh(path).triangles]
    assert np.all(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] == 1.0)


@pytest.mark.parametrize("interpolation", ["faceVarying", "vertex"])
@pytest.mark.parametrize("indexed", [True, False])
def test_usd_texture_coordinates(tmp_path, interpolation, indexed):
    path = tmp_path / "st.usda"
    points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0), (0, 1, 0)]
    corners = [0, 1, 4, 5, 1, 2, 3, 4]
    stage, mesh = write_usd(path, points=points, counts=(4, 4), indices=corners)
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, interpolation)
    values = np.array(
        [(points[c][0] / 2, points[c][1]) for c in (corners if interpolation == "faceVarying" else range(6))]
    )
    if indexed:
        primvar.Set(Vt.Vec2fArray.FromNumpy(values[::-1].astype(np.float32).copy()))
        primvar.SetIndices(Vt.IntArray.FromNumpy(np.arange(len(values))[::-1].astype(np.int32).copy()))
    else:
        primvar.Set(Vt.Vec2fArray.FromNumpy(values.astype(np.float32)))
    stage.Save()
    read = read_mesh(path)
    np.testing.assert_allclose(read.uvs[read.uv_indices], read.points[read.triangles][..., :2] / (2, 1), atol=1e-6)


def test_several_usd_meshes_want_a_choice(tmp_path):
    path = tmp_path / "shot.usda"
    stage, _ = write_usd(path)
    UsdGeom.Xform.Define(stage, "/world/props")
    other = UsdGeom.Mesh.Define(stage, "/world/props/table")
    for name in ("Points", "FaceVertexCounts", "FaceVertexIndices"):
        value = getattr(UsdGeom.Mesh(stage.GetPrimAtPath("/world/sheet")), f"Get{name}Attr")().Get()
        getattr(other, f"Create{name}Attr")(value)
    other.AddTranslateOp().Set(Gf.Vec3d(0, 0, 3))
    stage.Save()
    with pytest.raises(MeshError, match=r"'shot' holds 2 meshes \(/world/sheet, /world/props/table\); choose one"):
        Cloth.from_mesh(path)
    for prim in ("table", "/world/props/table", "/world/props"):
        assert Cloth.from_mesh(path, prim=prim).points[0, 2] == 3.0
    assert len(read_mesh(path, prim="/world").points) == 8
    assert read_mesh(path, prim="/world").name == "world"
    assert len(MeshObstacle.from_mesh(path).points) == 8
    with pytest.raises(MeshError, match=r"no mesh '/world/sheets' \(did you mean '/world/sheet'\?\)"):
        read_mesh(path, prim="/world/sheets")
    UsdGeom.Imageable(stage.GetPrimAtPath("/world/props")).MakeInvisible()
    stage.Save()
    assert read_mesh(path).name == "sheet"
    assert read_mesh(path, prim="table").points[0, 2] == 3.0


def test_references_instances_and_point_instancers_are_resolved(tmp_path):
    stage, _ = write_usd(tmp_path / "sheet.usda")
    stage.SetDefaultPrim(stage.GetPrimAtPath("/world"))
    stage.Save()
    shot = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    UsdGeom.SetStageUpAxis(shot, "Z")
    UsdGeom.SetStageMetersPerUnit(shot, 1.0)
    for k in range(2):
        copy = UsdGeom.Xform.Define(shot, f"/copy{k}")
        copy.GetPrim().GetReferences().AddReference("./sheet.usda")
        copy.GetPrim().SetInstanceable(True)
        copy.AddTranslateOp().Set(Gf.Vec3d(0, 0, k))
    scatter = UsdGeom.PointInstancer.Define(shot, "/scatter")
    scatter.AddTranslateOp().Set(Gf.Vec3d(10, 0, 0))
    prototype = shot.DefinePrim("/scatter/prototypes/sheet")
    prototype.GetReferences().AddReference("./sheet.usda")
    scatter.CreatePrototypesRel().AddTarget(prototype.GetPath())
    scatter.CreateProtoIndicesAttr([0, 0, 0])
    scatter.CreatePositionsAttr([(0, 0, 5), (0, 0, 6), (0, 0, 7)])
    scatter.InvisId(2, Usd.TimeCode.Default())
    shot.Save()
    joined = read_mesh(tmp_path / "shot.usda", join=True)
    assert len(joined.points) == 16
    assert sorted(set(joined.points[:, 2])) == [0, 1, 5, 6]
    assert joined.points[joined.points[:, 2] == 6, 0].min() == 10
    assert read_mesh(tmp_path / "shot.usda", prim="/copy1").points[0, 2] == 1.0


def test_sampled_points_without_a_default_use_the_first_sample(tmp_path):
    stage, mesh = write_usd(tmp_path / "wave.usda")
    mesh.GetPointsAttr().Clear()
    mesh.GetPointsAttr().Set(np.add(SQUARE, (0, 0, 2.0)).tolist(), 10)
    mesh.GetPointsAttr().Set(np.add(SQUARE, (0, 0, 9.0)).tolist(), 20)
    stage.Save()
    assert read_mesh(tmp_path / "wave.usda").points[0, 2] == 2.0


def test_holes_are_left_open(tmp_path):
    stage, mesh = write_usd(
        tmp_path / "holes.usda", points=[*SQUARE, (2, 0, 0), (2, 1, 0)], counts=(4, 4), indices=(0, 1, 2, 3, 1, 4, 5, 2)
    )
    mesh.CreateHoleIndicesAttr([1])
    stage.Save()
    assert area(read_mesh(tmp_path / "holes.usda")) == pytest.approx(1.0)


def scattered(path, *, positions=2, indices=(0, 0), ids=None, prototypes=("/scatter/sheet",)):
    stage, _ = write_usd(path, prim="/scatter/sheet")
    scatter = UsdGeom.PointInstancer.Define(stage, "/scatter")
    scatter.CreatePositionsAttr([(0, 0, k) for k in range(positions)])
    scatter.CreateProtoIndicesAttr(list(indices))
    scatter.CreatePrototypesRel().SetTargets(list(prototypes))
    if ids is not None:
        scatter.CreateIdsAttr(ids)
        scatter.InvisId(ids[0], Usd.TimeCode.Default())
    stage.Save()
    return path


SCATTERS = [
    ({"positions": 3}, "has 2 protoIndices but 3 positions; it needs as many of each"),
    ({"positions": 0}, "has 2 protoIndices but 0 positions; it needs as many of each"),
    ({"indices": ()}, "has 0 protoIndices but 2 positions; it needs as many of each"),
    ({"ids": [1, 2, 3]}, "has 2 protoIndices but 3 ids; it needs as many of each"),
    ({"indices": (0, 1)}, "refers to prototype 1, but has 1, counted from 0"),
    ({"indices": (0, -1)}, "refers to prototype -1, but has 1, counted from 0"),
    ({"prototypes": ()}, "refers to prototype 0, but has 0, counted from 0"),
    ({"prototypes": ("/scatter",)}, "scatters itself."),
    ({"prototypes": ("/scatter/leaf",)}, "refers to the prototype /scatter/leaf, which does not exist"),
]


@pytest.mark.parametrize(("options", "words"), SCATTERS)
def test_point_instancers_that_do_not_fit_are_refused(tmp_path, options, words):
    assert len(read_mesh(scattered(tmp_path / "good.usda", ids=[7, 8]), join=True).points) == 4
    with pytest.raises(MeshError, match=f"The point instancer /scatter {words}"):
        read_mesh(scattered(tmp_path / "bad.usda", **options), join=True)


def test_point_instancers_may_scatter_others(tmp_path):
    """Trees in a wood, say, each with leaves, of which one is not in its tree's own place."""
    stage, _ = write_usd(tmp_path / "wood.usda", prim="/wood/tree/leaf/sheet")
    UsdGeom.Xform.Define(stage, "/wood/tree/leaf").AddTranslateOp().Set(Gf.Vec3d(0, 0, 0.5))
    for path, prototype, places in (
        ("/wood", "/wood/tree", [(0, 0, 0), (9, 0, 0)]),
        ("/wood/tree", "/wood/tree/leaf", [(0, 0, 0), (0, 0, 7)]),
    ):
        scatter = UsdGeom.PointInstancer.Define(stage, path)
        scatter.CreatePrototypesRel().SetTargets([prototype])
        scatter.CreateProtoIndicesAttr([0, 0])
        scatter.CreatePositionsAttr(places)
        scatter.CreateScalesAttr([(1, 1, 1), (1, 1, 2)])
    stage.Save()
    corners = read_mesh(tmp_path / "wood.usda", join=True).points[::4]
    assert sorted(map(tuple, corners.tolist())) == [(0, 0, 0.5), (0, 0, 8.0), (9, 0, 1.0), (9, 0, 16.0)]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("upAxis", "X", "its upAxis is 'X', but must be 'Y' or 'Z'"),
        ("metersPerUnit", -1.0, "its metersPerUnit is -1, but must be a number above 0"),
        ("metersPerUnit", 0.0, "its metersPerUnit is 0, but must be a number above 0"),
        ("metersPerUnit", np.nan, "its metersPerUnit is nan, but must be a number above 0"),
    ],
)
def test_units_that_are_none_are_refused(tmp_path, key, value, words):
    stage, _ = write_usd(tmp_path / "sheet.usda")
    stage.SetMetadata(key, value)
    stage.Save()
    with pytest.raises(MeshError, match=f"The USD file 'sheet.usda' cannot be used: {words}"):
        read_mesh(tmp_path / "sheet.usda")


def referring(kind):
    """Makes a prim, or the stage, refer to a file."""

    def refer(prim, file):
        if kind == "sublayer":
            prim.GetStage().GetRootLayer().subLayerPaths.append(file)
        elif kind == "reference":
            prim.GetReferences().AddReference(file)
        else:
            prim.GetPayloads().AddPayload(file)

    return refer


@pytest.mark.parametrize("kind", ["reference", "payload", "sublayer"])
def test_what_a_mesh_file_refers_to_must_be_there(tmp_path, capfd, kind):
    """Part of an obstacle would be missing, and things would fall through where it was."""
    stage, _ = write_usd(tmp_path / "hall.usda")
    referring(kind)(stage.DefinePrim("/world/roof"), "./roof.usda")
    stage.Save()
    capfd.readouterr()
    with pytest.raises(
        MeshError, match=r"^The USD file 'hall.usda' is incomplete: could not .*roof.usda@.*\.$"
    ) as caught:
        read_mesh(tmp_path / "hall.usda", join=True)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""
    with pytest.raises(MeshError, match="is incomplete"):
        read_mesh(tmp_path / "hall.usda", prim="/world/roof")
    roof, _ = write_usd(tmp_path / "roof.usda")
    roof.SetDefaultPrim(roof.GetPrimAtPath("/world"))
    roof.Save()
    assert len(read_mesh(tmp_path / "hall.usda", join=True).points) == (4 if kind == "sublayer" else 8)


@pytest.mark.parametrize("prim", ["/world/sheet", "/world/sheet/"])
def test_a_chosen_mesh_needs_nothing_but_its_own_parts(tmp_path, prim):
    stage, _ = write_usd(tmp_path / "hall.usda")
    stage.DefinePrim("/world/roof").GetReferences().AddReference("./roof.usda")
    stage.Save()
    assert len(read_mesh(tmp_path / "hall.usda", prim=prim).points) == 4
    for name in ("/world", "/", "sheet"):
        with pytest.raises(MeshError, match=r"'hall.usda' is incomplete: could not open asset"):
            read_mesh(tmp_path / "hall.usda", prim=name)
