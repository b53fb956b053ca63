"""Mesh files: every format, polygons, seams, axes and units, and each kind of damage with its own message."""

import json
import shutil

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from warpcloth.cloth import Cloth
from warpcloth.errors import InputError, MeshError
from warpcloth.meshes import TriangleMesh, cloth_mesh, load_mesh, read_mesh, resolve_asset
from warpcloth.meshes.topology import EdgeTable
from warpcloth.meshes.triangulate import triangulate
from warpcloth.obstacles import MeshObstacle

SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
# A 2 × 1 strip of two quads whose texture has a seam between them.
SEAM_OBJ = """mtllib none.mtl
v 0 0 0
v 1 0 0
v 2 0 0
v 0 1 0
v 1 1 0
v 2 1 0
vt 0 0
vt .4 0
vt .4 1
vt 0 1
vt .6 0
vt 1 0
vt 1 1
vt .6 1
vn 0 0 1
g left
usemtl a
f 1/1/1 2/2/1 5/3/1 4/4/1
g right
usemtl b
f -5/-4/-1 -4/-3/-1 -1/-2/-1 -2/-1/-1
"""


def area(mesh: TriangleMesh) -> float:
    corners = mesh.points[mesh.triangles]
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()


# Files through trimesh, and OBJ


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off", "glb"])
def test_formats_give_the_closed_surface_back(tmp_path, suffix):
    sphere = trimesh.creation.icosphere(subdivisions=2)
    path = tmp_path / f"ball.{suffix}"
    sphere.export(path)
    mesh = read_mesh(path)
    assert mesh.name == "ball"
    assert mesh.points.shape == sphere.vertices.shape
    assert EdgeTable.of(mesh.triangles).is_closed
    assert trimesh.Trimesh(mesh.points, mesh.triangles).volume == pytest.approx(sphere.volume, rel=1e-6)


def test_gltf_is_y_up_and_its_node_transforms_are_applied(tmp_path):
    tall = trimesh.creation.box(extents=(1, 3, 1))
    scene = trimesh.Scene()
    scene.add_geometry(tall, node_name="tower", transform=trimesh.transformations.translation_matrix((0, 1.5, 2)))
    scene.export(tmp_path / "tower.glb")
    mesh = read_mesh(tmp_path / "tower.glb")
    np.testing.assert_allclose(mesh.points.min(axis=0), (-0.5, -2.5, 0), atol=1e-6)
    np.testing.assert_allclose(mesh.points.max(axis=0), (0.5, -1.5, 3), atol=1e-6)


def test_gltf_with_several_meshes_wants_a_choice(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(), node_name="box", geom_name="box")
    scene.add_geometry(trimesh.creation.icosphere(1), node_name="ball", geom_name="ball")
    path = tmp_path / "two.glb"
    scene.export(path)
    with pytest.raises(MeshError, match=r"'two' holds 2 meshes \(/ball, /box\); choose one"):
        read_mesh(path)
    assert len(read_mesh(path, prim="ball").points) == 42
    assert len(MeshObstacle.from_mesh(path).points) == 50


def test_texture_seams_do_not_split_vertices(tmp_path):
    path = tmp_path / "strip.obj"
    path.write_text(SEAM_OBJ)
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.points[:, 0], [0, 1, 2, 0, 1, 2])  # the file's order
    assert area(mesh) == pytest.approx(2.0)
    assert mesh.uvs.shape == (8, 2)
    placed = mesh.points[mesh.triangles][..., 0]
    expected = np.where(np.arange(4)[:, None] < 2, 0.4 * placed, 0.6 + 0.4 * (placed - 1.0))
    np.testing.assert_allclose(mesh.uvs[mesh.uv_indices][..., 0], expected)
    np.testing.assert_array_equal(Cloth.from_mesh(path).uv_indices, mesh.uv_indices)


def test_split_vertices_of_glb_are_welded_and_texture_coordinates_kept(tmp_path):
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 0, 0), (2, 0, 0), (1, 1, 0)], float)
    uv = np.array([(0, 0), (0.4, 0), (0.4, 1), (0.6, 0), (1, 0), (0.6, 1)])
    split = trimesh.Trimesh(points, [[0, 1, 2], [3, 4, 5]], process=False)
    split.visual = trimesh.visual.TextureVisuals(uv=uv)
    split.export(tmp_path / "split.glb")
    for mesh in (read_mesh(tmp_path / "split.glb"), load_mesh(split)):
        assert len(mesh.points) == 4
        np.testing.assert_allclose(mesh.uvs[mesh.uv_indices], uv.reshape(2, 3, 2), atol=1e-6)


def test_layers_in_the_same_place_stay_apart():
    sheet = trimesh.creation.icosphere(1)
    both = trimesh.util.concatenate([sheet, sheet])
    doubled = trimesh.Trimesh(both.vertices, both.faces, process=False)
    assert len(load_mesh(doubled).points) == 84


def test_unused_vertices_are_dropped_and_order_is_kept():
    loose = trimesh.Trimesh([(9, 9, 9), *SQUARE, (7, 7, 7)], [[1, 2, 3], [1, 3, 4]], process=False)
    cloth = Cloth.from_mesh(loose)
    np.testing.assert_array_equal(cloth.points, SQUARE)
    assert cloth.masses.min() > 0.0


# Polygons


def polygon(radii: list[float]) -> np.ndarray:
    angle = 2 * np.pi * np.arange(len(radii)) / len(radii)
    return np.column_stack([radii * np.cos(angle), radii * np.sin(angle), 0 * angle])


@given(st.lists(st.floats(0.2, 2.0), min_size=3, max_size=12), st.integers(0, 11))
def test_star_shaped_polygons_are_cut_without_overlap(radii, shift):
    points = np.roll(polygon(radii), shift, axis=0)
    triangles = triangulate(points, np.array([len(radii)]), np.arange(len(radii)))
    corners = points[triangles]
    signed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert len(triangles) == len(radii) - 2
    assert signed.min() >= -1e-9
    total = np.cross(points, np.roll(points, -1, axis=0))[:, 2].sum()
    assert signed.sum() == pytest.approx(total, rel=1e-9)


def test_straight_corners_make_no_flat_triangles():
    points = np.array([(0, 0, 0), (0.5, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    for shift in range(5):
        order = np.roll(np.arange(5), shift)
        corners = points[order][triangulate(points, np.array([5]), order)]
        assert np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2].min() > 0.1
    triangle_as_quad = points[[0, 1, 2, 3]]
    for shift in range(4):
        order = np.roll(np.arange(4), shift)
        corners = triangle_as_quad[order][triangulate(triangle_as_quad, np.array([4]), order)]
        assert np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2].min() > 0.1


def test_mixed_polygons_keep_the_order_of_faces():
    points = np.concatenate([polygon([1, 1, 1]), polygon([1] * 6), polygon([1] * 4), polygon([1, 1, 1])])
    counts = np.array([3, 6, 4, 3])
    cuts = triangulate(points, counts, np.arange(16))
    np.testing.assert_array_equal(
        np.searchsorted(np.cumsum(counts), cuts[:, 0], side="right"), [0, 1, 1, 1, 1, 2, 2, 3]
    )


def test_concave_obj_polygon(tmp_path):
    path = tmp_path / "arrow.obj"
    path.write_text("v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 .5 0\nv 0 2 0\nf 1 2 \\\n 3 4 5 # concave\n")
    assert area(read_mesh(path)) == pytest.approx(2.5)


# USD


def write_usd(path, *, up="Z", metres=1.0, points=SQUARE, counts=(4,), indices=(0, 1, 2, 3), prim="/world/sheet"):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    UsdGeom.Xform.Define(stage, "/world")
    mesh = UsdGeom.Mesh.Define(stage, prim)
    mesh.CreatePointsAttr(np.array(points, float).tolist())
    mesh.CreateFaceVertexCountsAttr(list(counts))
    mesh.CreateFaceVertexIndicesAttr(list(indices))
    return stage, mesh


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
    from pxr import UsdUtils

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


# Assets of Warp's wheel


@pytest.mark.parametrize("name", ["bear", "bunny", "cube", "nonuniform", "rocks", "sphere", "square_cloth"])
def test_warp_assets_are_obstacles(name):
    mesh = MeshObstacle.from_mesh(f"warp:{name}.usd")
    assert len(mesh.triangles) >= 12


def test_bunny_stands_upright_and_square_cloth_has_texture():
    bunny = read_mesh("warp:bunny.usd")
    assert bunny.points.shape == (6102, 3)
    assert np.ptp(bunny.points, axis=0)[2] == pytest.approx(1.6189, abs=1e-3)
    cloth = Cloth.from_mesh("warp:square_cloth.usd", transform=np.diag([0.01, 0.01, 0.01, 1.0]))
    assert cloth.area == pytest.approx(1.5, rel=1e-6)
    assert cloth.mass == pytest.approx(0.3, rel=1e-6)
    assert cloth.uv_indices.shape == cloth.triangles.shape
    assert resolve_asset("warp:bunny.usd").is_file()


# Damage


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.obj", "", "'a.obj' is empty: it has 0 bytes"),
        ("a.obj", "# nothing", "is empty: it has 0 vertices and 0 faces"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "is empty: it has 3 vertices and 0 faces"),
        ("a.obj", "v 0 0\n", "a.obj, line 1: cannot read 'v 0 0'"),
        ("a.obj", "v 0 0 0\nf 1 1\n", "line 2: cannot read 'f 1 1'"),
        ("a.obj", "v 0 0 0\nf 1 x 2\n", "line 2: cannot read 'f 1 x 2'"),
        ("a.obj", "v 0 0 0\nf 0 1 1\n", "line 2"),
        ("a.obj", "v 0 0 0\nf -2 -1 -1\n", "line 2"),
        ("a.obj", "v 0 0 0\nf 1 1 5\n", "refers to vertex 5, which is not one of 1 to 1"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n", "1 vertex is not finite .* first vertex 2"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 inf 0\nf 1 2 3\n", "1 vertex is not finite"),
        (
            "a.obj",
            "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n",
            "1 triangle has no area, first triangle 0 with vertices 0, 1, 2",
        ),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 3\n", "1 triangles repeat others, first triangle 1"),
        ("a.ply", "ply", "'a.ply' is damaged or not PLY"),
        ("a.stl", "solid a\nendsolid a\n", "'a' holds no triangle mesh|is damaged or not STL"),
        ("a.off", "OFF", "'a.off' is damaged or not OFF"),
        ("a.glb", "x", "'a.glb' is damaged or not GLB"),
        ("a.gltf", "{", "'a.gltf' is damaged or not GLTF"),
        ("a.usda", "#usda 1.0\n(", "'a.usda' cannot be read"),
        ("a.usda", "#usda 1.0\n", "'a' holds no triangle mesh"),
        ("a.usdc", "PXR-USDC", "'a.usdc' cannot be read"),
        ("a.usdz", "PK", "'a.usdz' cannot be read"),
        ("a.usd", "x", "'a.usd' cannot be read"),
        ("a.fbx", "", "is of no known kind; known are OBJ, PLY"),
    ],
)
def test_damaged_files(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(MeshError, match=words) as caught:
        Cloth.from_mesh(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"points": []}, "is empty"),
        ({"counts": []}, "is empty: it has 4 vertices and 0 faces"),
        ({"counts": [3]}, "its faces have 3 corners, but 4 vertex indices are given"),
        ({"counts": [2, 2]}, "face 0 has 2 corners"),
        ({"indices": [0, 1, 2, 9]}, "refers to vertex 9"),
        ({"points": [(0, 0, float("nan")), *SQUARE[1:]]}, "1 vertex is not finite"),
        ({"points": np.zeros((4, 3))}, "2 triangles have no area"),
    ],
)
def test_damaged_usd_meshes(tmp_path, change, words):
    stage, _ = write_usd(tmp_path / "a.usda", **change)
    stage.Save()
    with pytest.raises(MeshError, match=words):
        Cloth.from_mesh(tmp_path / "a.usda")


def test_missing_files_propose_the_closest_name(tmp_path):
    (tmp_path / "shirt.obj").write_text("#")
    with pytest.raises(MeshError, match=r"No mesh file 'shrt.obj' in .* \(did you mean 'shirt.obj'\?\)"):
        read_mesh(tmp_path / "shrt.obj")
    with pytest.raises(MeshError, match=r"No asset 'warp:buny.usd' ships with Warp \(did you mean 'bunny.usd'\?\)"):
        read_mesh("warp:buny.usd")
    for source, words in (
        (tmp_path, "is a folder"),
        (tmp_path / "no" / "a.obj", "folder .* does not exist"),
        (3, "got int"),
    ):
        with pytest.raises(MeshError, match=words):
            read_mesh(source)
    with pytest.raises(MeshError, match="cannot be chosen"):
        read_mesh(tmp_path / "shirt.obj", prim="/shirt")


FACTORY = trimesh.creation.icosphere(1)


@pytest.fixture(scope="module")
def sound_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sound")
    for suffix in ("obj", "ply", "stl", "off", "glb"):
        FACTORY.export(folder / f"a.{suffix}")
    gltf = trimesh.exchange.gltf.export_gltf(trimesh.Scene(FACTORY))
    for name, data in gltf.items():
        (folder / name).write_bytes(data)
    shutil.move(folder / "model.gltf", folder / "a.gltf")
    for suffix in ("usda", "usdc"):
        stage, _ = write_usd(
            folder / f"a.{suffix}", points=FACTORY.vertices, counts=[3] * 80, indices=FACTORY.faces.ravel().tolist()
        )
        stage.Save()
    return folder


@given(data=st.data())
def test_damaged_or_truncated_files_load_or_say_why(sound_files, data):
    suffix = data.draw(st.sampled_from(["obj", "ply", "stl", "off", "glb", "gltf", "usda", "usdc"]))
    content = bytearray((sound_files / f"a.{suffix}").read_bytes())
    flips = 0 if suffix == "usdc" else data.draw(st.integers(0, 4))  # OpenUSD itself can die of flipped bytes in .usdc
    for _ in range(flips):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    end = data.draw(st.one_of(st.just(len(content)), st.integers(0, len(content))))
    path = sound_files / f"damaged.{suffix}"
    path.write_bytes(bytes(content[:end]))
    message = "."
    try:
        Cloth.from_mesh(path)
    except InputError as error:
        message = str(error)
    assert message.endswith(".")
    assert "\n" not in message


def test_gltf_file_with_its_buffers(sound_files):
    assert len(read_mesh(sound_files / "a.gltf").points) == 42
    assert json.loads((sound_files / "a.gltf").read_text())["asset"]["version"] == "2.0"


def test_cloth_mesh_turns_texture_corners_with_the_triangles():
    mesh = TriangleMesh(SQUARE, [[0, 1, 2], [0, 3, 2]], np.array(SQUARE)[:, :2], [[0, 1, 2], [0, 3, 2]])
    turned = cloth_mesh(mesh)
    np.testing.assert_allclose(turned.uvs[turned.uv_indices], turned.points[turned.triangles][..., :2])
