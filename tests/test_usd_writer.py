"""Caches as written: everything a production pipeline expects of one, whatever happens while it is written."""

import dataclasses
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade, UsdValidation
from usd_shots import FPS, LAST, frame_of, one_of_each, two_cloths, write_frames, write_shot
from warpcloth.scenes.usd import CacheWriter, check_cache, read_obstacles
from warpcloth.scenes.usd.surface import VertexNormals, summed_area_vectors, vertex_normals

from warpcloth import Cloth

EXPECTED = [float(frame) for frame in range(LAST + 1)]


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> Path:
    return write_shot(tmp_path_factory.mktemp("cache") / "shot.usdc")


@pytest.fixture
def stage(cache) -> Usd.Stage:
    return Usd.Stage.Open(str(cache))


def meshes(stage: Usd.Stage) -> list[UsdGeom.Mesh]:
    return [UsdGeom.Mesh(prim) for prim in stage.GetPrimAtPath("/World/Cloth").GetChildren()]


def test_stage_metadata_is_complete(stage):
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdPhysics.GetStageKilogramsPerUnit(stage) == 1.0
    assert UsdPhysics.StageHasAuthoredKilogramsPerUnit(stage)
    assert UsdGeom.StageHasAuthoredMetersPerUnit(stage)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == FPS
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0.0, LAST)
    for key in ("timeCodesPerSecond", "framesPerSecond", "startTimeCode", "endTimeCode", "upAxis", "kilogramsPerUnit"):
        assert stage.HasAuthoredMetadata(key), key
    root = stage.GetDefaultPrim()
    assert root.GetPath() == Sdf.Path("/World")
    assert Usd.ModelAPI(root).GetKind() == Kind.Tokens.component
    provenance = stage.GetRootLayer().customLayerData["warpcloth"]
    assert provenance["scene"] == "test"
    assert provenance["version"]


def test_each_cloth_is_one_prim_with_its_own_points(stage):
    prims = [mesh.GetPrim() for mesh in meshes(stage)]
    assert [prim.GetName() for prim in prims] == ["red_flag", "red_flag_1"]
    assert [prim.GetCustomDataByKey("warpcloth:name") for prim in prims] == ["red flag", "red-flag"]
    for mesh, cloth in zip(meshes(stage), two_cloths(), strict=True):
        assert len(mesh.GetPointsAttr().Get(0)) == len(cloth.points)
        np.testing.assert_array_equal(np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3), cloth.triangles)


def test_samples_are_on_integer_frames_and_hold_what_was_written(stage):
    for mesh, cloth in zip(meshes(stage), two_cloths(), strict=True):
        sampled = (mesh.GetPointsAttr(), mesh.GetVelocitiesAttr(), mesh.GetNormalsAttr(), mesh.GetExtentAttr())
        assert [attribute.GetTimeSamples() for attribute in sampled] == [EXPECTED] * 4
        for frame in range(LAST + 1):
            points, velocities = frame_of(cloth, frame)
            np.testing.assert_array_equal(np.array(mesh.GetPointsAttr().Get(frame)), points.astype(np.float32))
            np.testing.assert_array_equal(np.array(mesh.GetVelocitiesAttr().Get(frame)), velocities.astype(np.float32))


def test_default_values_are_the_rest_pose(stage):
    for mesh, cloth in zip(meshes(stage), two_cloths(), strict=True):
        rest = cloth.points.astype(np.float32)
        np.testing.assert_array_equal(np.array(mesh.GetPointsAttr().Get()), rest)
        np.testing.assert_allclose(np.array(mesh.GetNormalsAttr().Get()), np.tile((0.0, 0.0, 1.0), (len(rest), 1)))
        np.testing.assert_array_equal(np.array(mesh.GetExtentAttr().Get()), UsdGeom.PointBased.ComputeExtent(rest))


def test_normals_are_unit_follow_the_winding_and_extents_are_exact(stage):
    for mesh in meshes(stage):
        triangles = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        assert mesh.GetNormalsInterpolation() == "vertex"
        for frame in range(LAST + 1):
            points, normals = mesh.GetPointsAttr().Get(frame), np.array(mesh.GetNormalsAttr().Get(frame), float)
            np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=2e-7)
            corners = np.array(points, float)[triangles]
            faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            assert np.einsum("tkc,tc->tk", normals[triangles], faces).min() > 0.0
            extent = UsdGeom.PointBased.ComputeExtent(points)
            assert np.array_equal(mesh.GetExtentAttr().Get(frame), extent)


def test_topology_is_fixed_and_complete(stage):
    for mesh, cloth in zip(meshes(stage), two_cloths(), strict=True):
        counts, indices = mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()
        fixed = (counts, indices, mesh.GetSubdivisionSchemeAttr(), mesh.GetOrientationAttr(), mesh.GetDoubleSidedAttr())
        assert all(attribute.HasAuthoredValue() and attribute.GetNumTimeSamples() == 0 for attribute in fixed)
        assert UsdGeom.Mesh.ValidateTopology(indices.Get(), counts.Get(), len(cloth.points))[0]
        assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
        assert mesh.GetOrientationAttr().Get() == "rightHanded"
        assert mesh.GetDoubleSidedAttr().Get()
        st = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st")
        assert st.IsIndexed()
        assert st.GetInterpolation() == "faceVarying"
        np.testing.assert_allclose(np.array(st.ComputeFlattened()), cloth.uvs[cloth.uv_indices.ravel()], atol=1e-7)


def test_texture_coordinates_given_for_each_corner_are_written_once(tmp_path):
    disc = Cloth.disc(radius=0.4, resolution=2)
    given = disc.uvs[disc.uv_indices.ravel()]
    each = dataclasses.replace(disc, uvs=given, uv_indices=np.arange(len(given)).reshape(-1, 3))
    with CacheWriter(tmp_path / "disc.usdc", [each], [], FPS, {}) as writer:
        write_frames(writer, [each], range(2))
    assert check_cache(writer.close()).usd_errors == ()
    stage = Usd.Stage.Open(str(tmp_path / "disc.usdc"))
    st = UsdGeom.PrimvarsAPI(meshes(stage)[0]).GetPrimvar("st")
    assert len(st.Get()) == len(disc.uvs) < len(given)
    np.testing.assert_allclose(np.array(st.ComputeFlattened()), given, atol=1e-7)


def test_cloth_has_its_colour_and_its_pins(stage):
    flag, cloth = meshes(stage)[0], two_cloths()[0]
    material, _ = UsdShade.MaterialBindingAPI(flag).ComputeBoundMaterial()
    shader = material.ComputeSurfaceSource()[0]
    assert shader.GetIdAttr().Get() == "UsdPreviewSurface"
    np.testing.assert_allclose(shader.GetInput("diffuseColor").Get(), cloth.fabric.color, rtol=1e-6)
    (pins,) = UsdGeom.Subset.GetAllGeomSubsets(flag)
    assert pins.GetElementTypeAttr().Get() == "point"
    np.testing.assert_array_equal(pins.GetIndicesAttr().Get(), cloth.pinned)


def test_obstacles_come_back_exactly(stage):
    back = read_obstacles(stage)
    assert [type(o) for o in back] == [type(o) for o in one_of_each()]
    assert len({prim.GetName() for prim in stage.GetPrimAtPath("/World/Obstacles").GetChildren()}) == len(back)
    for read, given in zip(back, one_of_each(), strict=True):
        assert (read.name, read.thickness, read.friction) == (given.name, given.thickness, given.friction)
        assert read.restitution == given.restitution
        assert read.moves == given.moves
        np.testing.assert_allclose(read.color, given.color, rtol=1e-6)
        for field in ("center", "radius", "size", "rotation", "start", "end", "normal", "triangles"):
            if hasattr(given, field):
                np.testing.assert_allclose(getattr(read, field), getattr(given, field), atol=1e-14, err_msg=field)
        if hasattr(given, "point"):
            assert abs((read.point - given.point) @ given.normal) < 1e-14
        for frame in range(LAST + 1):
            if hasattr(given, "points_at"):
                gap = read.points_at(frame / FPS) - given.points_at(frame / FPS)
                assert np.abs(gap).max() < 4e-7  # single precision at 4 m
            else:
                np.testing.assert_allclose(read.matrix(frame / FPS), given.matrix(frame / FPS), atol=1e-13)


def test_obstacle_prims_are_where_the_obstacles_are(stage):
    """Through OpenUSD's own transforms and extents, not through our reader."""
    cache = UsdGeom.BBoxCache(Usd.TimeCode(5), ["default"])
    sphere, given = stage.GetPrimAtPath("/World/Obstacles/sphere"), one_of_each()[1]
    box = cache.ComputeWorldBound(sphere).ComputeAlignedRange()
    center = (given.matrix(5 / FPS) @ [*given.center, 1.0])[:3]
    np.testing.assert_allclose(box.GetMidpoint(), center, atol=1e-6)
    capsule, given = stage.GetPrimAtPath("/World/Obstacles/capsule"), one_of_each()[2]
    place = np.array(UsdGeom.Xformable(capsule).ComputeLocalToWorldTransform(5)).T
    half = 0.5 * UsdGeom.Capsule(capsule).GetHeightAttr().Get()
    end = (given.matrix(5 / FPS) @ [*given.end, 1.0])[:3]
    np.testing.assert_allclose((place @ [0.0, 0.0, half, 1.0])[:3], end, atol=1e-12)
    plane = UsdGeom.Plane(stage.GetPrimAtPath("/World/Obstacles/plane"))
    up = Gf.Vec3d(UsdGeom.Xformable(plane).ComputeLocalToWorldTransform(0).TransformDir(Gf.Vec3d(0, 0, 1)))
    np.testing.assert_allclose(up, one_of_each()[0].normal, atol=1e-14)


def test_moving_orientations_never_jump_to_the_other_quaternion(stage):
    orient = stage.GetPrimAtPath("/World/Obstacles/capsule").GetAttribute("xformOp:orient")
    quaternions = [orient.Get(frame) for frame in range(LAST + 1)]
    assert min(Gf.Dot(a, b) for a, b in pairwise(quaternions)) > 0.0


@pytest.mark.parametrize("extension", [".usd", ".usdc", ".usda", ".usdz"])
def test_both_validators_are_content(tmp_path, extension):
    from usd_validation_nvidia import ValidationEngine

    path = write_shot(tmp_path / f"shot{extension}", last=2)
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    assert [e.GetMessage() for e in context.Validate(Usd.Stage.Open(str(path)))] == []
    issues = [issue.message for issue in ValidationEngine().validate(str(path)).issues()]
    # Text is what whoever asks for .usda wants.
    assert [m for m in issues if not (extension == ".usda" and "should be stored in crate files" in m)] == []
    assert sorted(p.name for p in tmp_path.iterdir()) == [path.name]
    assert path.read_bytes().startswith(b"PXR-USDC") == (extension in (".usd", ".usdc"))


def test_nvidias_minimal_placeable_visual_is_met(cache):
    from usd_validation_nvidia import FeatureRegistry, ValidationEngine

    registry = FeatureRegistry()
    (feature,) = [f for f in registry.values() if f.id == "com.nvidia.usd.minimal_placeable_visual"]
    assert registry.get_requirements(feature)
    engine = ValidationEngine(init_rules=False)
    engine.enable_feature(feature)
    assert [issue.message for issue in engine.validate(str(cache)).issues()] == []


def test_rest_pose_alone_is_valid(cache, tmp_path):
    """Several validators skip animated meshes, so show them the default values without samples."""
    from usd_validation_nvidia import ValidationEngine

    layer = Sdf.Layer.CreateAnonymous()
    layer.TransferContent(Sdf.Layer.FindOrOpen(str(cache)))
    still = Usd.Stage.Open(layer)
    for prim in still.Traverse():
        for attribute in prim.GetAttributes():
            for code in attribute.GetTimeSamples():
                attribute.ClearAtTime(code)
    still.Export(str(tmp_path / "rest.usdc"))
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    assert [e.GetMessage() for e in context.Validate(still)] == []
    assert list(ValidationEngine().validate(str(tmp_path / "rest.usdc")).issues()) == []


def test_formats_hold_the_same_samples(tmp_path):
    stages = [Usd.Stage.Open(str(write_shot(tmp_path / f"shot.{e}", last=2))) for e in ("usdc", "usda", "usdz")]
    points = [np.array(meshes(stage)[0].GetPointsAttr().Get(2)) for stage in stages]
    np.testing.assert_array_equal(points[0], points[1])
    np.testing.assert_array_equal(points[0], points[2])
    assert [stage.GetEndTimeCode() for stage in stages] == [2.0] * 3


@pytest.mark.parametrize("name", ["9 lives", "Über/cloth", "a b", "a-b", "..", "目"])
def test_any_name_becomes_a_prim(tmp_path, name):
    cloth = Cloth.grid(resolution=(2, 2), name=name)
    with CacheWriter(tmp_path / "shot.usdc", [cloth]) as writer:
        writer.write(0, {name: cloth.points}, {name: 0.0 * cloth.points})
    stage = Usd.Stage.Open(str(tmp_path / "shot.usdc"))
    (mesh,) = meshes(stage)
    assert mesh.GetPrim().GetCustomDataByKey("warpcloth:name") == name


def test_provenance_takes_what_python_has(tmp_path):
    facts = {"seed": 2**80, "path": Path("a"), "gravity": np.array([0.0, 0.0, -9.81]), "none": None}
    facts |= {"settings": {"substeps": np.int64(8), "tags": ["x", 1], "captured": np.bool_(True)}, "damping": 0.5}
    cloth = Cloth.grid(resolution=(2, 2))
    with CacheWriter(tmp_path / "shot.usdc", [cloth], provenance=facts) as writer:
        writer.write(0, {"cloth": cloth.points}, {"cloth": cloth.points})
    kept = Sdf.Layer.FindOrOpen(str(tmp_path / "shot.usdc")).customLayerData["warpcloth"]
    assert kept["seed"] == str(2**80)
    assert kept["path"] == "a"
    assert "none" not in kept
    assert list(kept["gravity"]) == [0.0, 0.0, -9.81]
    assert (kept["settings"]["substeps"], kept["settings"]["captured"], kept["damping"]) == (8, True, 0.5)
    assert list(kept["settings"]["tags"]) == ["x", "1"]


def test_cloth_normals_of_degenerate_triangles_are_unit():
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    normals = vertex_normals(points, np.array([[0, 1, 2]]))
    np.testing.assert_array_equal(normals, np.tile((0.0, 0.0, 1.0), (4, 1)))


@pytest.mark.parametrize("size", [1e-12, 1.0, 1e18])
def test_cloth_normals_are_area_vectors_of_unit_length(size):
    cloth = Cloth.grid((1.0, 1.0), (9, 7))
    normals, rng = VertexNormals(cloth.triangles, len(cloth.points)), np.random.default_rng(5)
    for _ in range(2):  # the second frame must not see the first
        points = (size * (cloth.points + 0.05 * rng.normal(size=cloth.points.shape))).astype(np.float32)
        expected = summed_area_vectors(points, cloth.triangles)
        expected /= np.linalg.norm(expected, axis=1, keepdims=True)
        np.testing.assert_allclose(normals.at(points), expected, rtol=0.0, atol=2e-7)
