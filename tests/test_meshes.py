"""Mesh files through trimesh, and OBJ: every format, polygons, seams; the assets of Warp's wheel."""

import json

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from usd_files import SQUARE

from warpcloth.cloth import Cloth
from warpcloth.errors import FabricWarning, MeshError
from warpcloth.meshes import TriangleMesh, cloth_mesh, load_mesh, read_mesh, resolve_asset
from warpcloth.meshes.topology import EdgeTable
from warpcloth.meshes.triangulate import triangulate
from warpcloth.obstacles import MeshObstacle

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


@pytest.mark.parametrize(("gap", "vertices"), [(0.0, 4), (1e-9, 4), (-1e-9, 4), (1e-6, 4), (1e-4, 6)])
def test_seams_that_are_nearly_closed_are_welded(gap, vertices):
    """Within a millionth of the extent, here 2 m; the first point of each place stays where it is."""
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1 + gap, gap, 0), (2, 0, 0), (1 + gap, 1, gap)], float)
    mesh = load_mesh(trimesh.Trimesh(points, [[0, 1, 2], [3, 4, 5]], process=False))
    assert len(mesh.points) == vertices
    np.testing.assert_array_equal(mesh.points[:3], points[:3])


def test_vertices_that_no_triangle_uses_do_not_make_a_mesh_larger():
    square = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    places = [(0.0, 0.0, 0.0), (1.05, 0.0, 0.0), (1.0 + 1e-7, 1.0, 0.0)]
    panels = np.concatenate([square + np.array(place) for place in places])
    corners = [[0, 1, 2], [0, 2, 3]]
    triangles = np.concatenate([np.array(corners) + 4 * panel for panel in range(3)])
    for stray in ([], [(1e5, 0.0, 0.0)]):
        mesh = TriangleMesh(np.array([*panels.tolist(), *stray]), triangles).welded()
        assert len(mesh.points) == 11


def test_what_is_near_is_not_welded_where_a_triangle_would_shrink_to_a_line():
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 0, 0), (2, 0, 0), (1, 1, 0), (2, 1e-7, 0)], float)
    mesh = load_mesh(trimesh.Trimesh(points, [[0, 1, 2], [3, 4, 5], [4, 6, 5]], process=False))
    assert len(mesh.points) == 5


@pytest.mark.parametrize("gap", [0.0, 1e-9])
def test_layers_a_rounding_error_apart_stay_apart(gap):
    sheet = trimesh.creation.icosphere(1)
    points = np.concatenate([sheet.vertices, sheet.vertices * (1.0 + gap)])
    doubled = trimesh.Trimesh(points, np.concatenate([sheet.faces, sheet.faces + 42]), process=False)
    assert len(load_mesh(doubled).points) == 84


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


def test_gltf_file_with_its_buffers(tmp_path):
    for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.icosphere(1))).items():
        (tmp_path / name).write_bytes(data)
    assert len(read_mesh(tmp_path / "model.gltf").points) == 42


@pytest.mark.parametrize("suffix", ["gltf", "glb"])
@pytest.mark.parametrize(("sparse", "words"), [("POSITION", r"mesh 'ball' .* \(POSITION\)"), ("indices", "indices")])
def test_sparse_accessors_are_refused(tmp_path, suffix, sparse, words):
    """trimesh leaves out what they change, here a vertex, and would read another shape."""
    ball = trimesh.Scene()
    ball.add_geometry(trimesh.creation.icosphere(1), geom_name="ball")

    def made_sparse(tree):
        primitive = tree["meshes"][0]["primitives"][0]
        accessor = primitive["indices"] if sparse == "indices" else primitive["attributes"][sparse]
        views = {"indices": {"bufferView": 0, "componentType": 5125}, "values": {"bufferView": 0}}
        tree["accessors"][accessor]["sparse"] = {"count": 1, **views}

    exporter = trimesh.exchange.gltf
    if suffix == "glb":
        (tmp_path / "model.glb").write_bytes(exporter.export_glb(ball, tree_postprocessor=made_sparse))
    else:
        for name, data in exporter.export_gltf(ball, tree_postprocessor=made_sparse).items():
            (tmp_path / name).write_bytes(data)
    with pytest.raises(MeshError, match=f"'model.{suffix}' holds .*{words}.* export it without these"):
        read_mesh(tmp_path / f"model.{suffix}")


def test_parts_of_a_gltf_mesh_are_one_mesh_with_texture_coordinates(tmp_path):
    corners, faces = np.array(SQUARE, np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    data = corners.tobytes() + corners[:, :2].tobytes() + faces.tobytes()
    views = [(0, 48), (48, 32), (80, 12), (92, 12)]
    kinds = [(5126, 4, "VEC3"), (5126, 4, "VEC2"), (5125, 3, "SCALAR"), (5125, 3, "SCALAR")]
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "shirt", "mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": k} for k in (2, 3)]}],
        "buffers": [{"byteLength": len(data), "uri": "shirt.bin"}],
        "bufferViews": [{"buffer": 0, "byteOffset": start, "byteLength": size} for start, size in views],
        "accessors": [
            {"bufferView": k, "componentType": kind, "count": count, "type": shape}
            for k, (kind, count, shape) in enumerate(kinds)
        ],
    }
    (tmp_path / "shirt.bin").write_bytes(data)
    (tmp_path / "shirt.gltf").write_text(json.dumps(tree))
    mesh = read_mesh(tmp_path / "shirt.gltf")
    assert mesh.name == "shirt"
    assert len(mesh.points) == 4
    placed = mesh.points[mesh.triangles]
    np.testing.assert_allclose(placed[..., 1], 0.0)  # Y up became Z up
    np.testing.assert_allclose(mesh.uvs[mesh.uv_indices], np.stack([placed[..., 0], 1.0 - placed[..., 2]], axis=-1))


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


@pytest.mark.parametrize("wrong", [[0], [0, 5, 6], [3]])
def test_most_triangles_of_a_cloth_keep_their_side(wrong):
    flat = Cloth.grid((1.0, 1.0), (4, 4))
    triangles = flat.triangles.copy()
    triangles[wrong] = triangles[wrong, ::-1]
    facing = cloth_mesh(TriangleMesh(flat.points, triangles)).triangles
    np.testing.assert_array_equal(np.sort(facing, axis=1), np.sort(triangles, axis=1))
    a, b, c = (flat.points[facing[:, k]] for k in range(3))
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0.0)


def test_cloth_mesh_turns_texture_corners_with_the_triangles():
    mesh = TriangleMesh(SQUARE, [[0, 1, 2], [0, 3, 2]], np.array(SQUARE)[:, :2], [[0, 1, 2], [0, 3, 2]])
    turned = cloth_mesh(mesh)
    np.testing.assert_allclose(turned.uvs[turned.uv_indices], turned.points[turned.triangles][..., :2])


# Assets of Warp's wheel


@pytest.mark.parametrize("name", ["bear", "bunny", "cube", "nonuniform", "rocks", "sphere", "square_cloth"])
def test_warp_assets_are_obstacles(name):
    mesh = MeshObstacle.from_mesh(f"warp:{name}.usd")
    assert len(mesh.triangles) >= 12


def test_bunny_stands_upright_and_square_cloth_has_texture():
    bunny = read_mesh("warp:bunny.usd")
    assert bunny.points.shape == (6102, 3)
    assert np.ptp(bunny.points, axis=0)[2] == pytest.approx(1.6189, abs=1e-3)
    with pytest.warns(FabricWarning, match="2.2 times as easily in one direction"):  # all its diagonals run one way
        cloth = Cloth.from_mesh("warp:square_cloth.usd", transform=np.diag([0.01, 0.01, 0.01, 1.0]))
    assert cloth.area == pytest.approx(1.5, rel=1e-6)
    assert cloth.mass == pytest.approx(0.3, rel=1e-6)
    assert cloth.uv_indices.shape == cloth.triangles.shape
    assert resolve_asset("warp:bunny.usd").is_file()
