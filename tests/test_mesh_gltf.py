"""glTF files of which trimesh would read nothing, a part, or something else: each is refused in one sentence."""

import importlib.util
import json

import numpy as np
import pytest
import trimesh

from warpcloth.errors import MeshError
from warpcloth.meshes import load_mesh, read_mesh


def two_balls() -> trimesh.Scene:
    """One below the other."""
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.icosphere(1), node_name="upper", geom_name="first")
    scene.add_geometry(trimesh.creation.icosphere(1), node_name="lower", parent_node_name="upper", geom_name="second")
    return scene


def write_gltf(path, change, scene=None) -> None:
    """A scene, two balls if none is given, of whose JSON ``change`` makes something else."""
    scene, exporter = scene or two_balls(), trimesh.exchange.gltf
    if path.suffix == ".glb":
        path.write_bytes(exporter.export_glb(scene, tree_postprocessor=change))
        return
    for name, data in exporter.export_gltf(scene, tree_postprocessor=change).items():
        path.with_name(path.name if name == "model.gltf" else name).write_bytes(data)


def refused(path, sentence: str, caplog, **options) -> None:
    """``sentence`` is all that is said."""
    with pytest.raises(MeshError) as caught:
        read_mesh(path, **options)
    assert str(caught.value) == sentence
    assert caplog.records == []


# Nodes


@pytest.mark.parametrize("suffix", ["gltf", "glb"])
@pytest.mark.parametrize(("node", "children", "circle"), [(1, [0], "'upper', 'lower'"), (0, [0, 1], "'upper'")])
def test_nodes_in_a_circle_are_refused(tmp_path, caplog, suffix, node, children, circle):
    """Whoever goes from a mesh to the node above, and on, never arrives."""
    write_gltf(tmp_path / f"ring.{suffix}", lambda tree: tree["nodes"][node].update(children=children))
    words = f"its nodes form a circle ({circle}), but must form a tree."
    refused(tmp_path / f"ring.{suffix}", f"'ring' cannot be read: {words}", caplog, join=True)


def test_a_scene_whose_nodes_form_a_circle_is_refused():
    scene = two_balls()
    scene.graph.update(frame_from="lower", frame_to="upper")
    with pytest.raises(MeshError, match=r"^'scene' cannot be read: its nodes form a circle \('upper', 'lower'\), but"):
        load_mesh(scene, join=True)


def test_a_node_below_two_others_is_refused(tmp_path, caplog):
    """trimesh would put it below one of them, and half of what is to be seen would be missing."""

    def add(tree):
        tree["nodes"].append({"name": "aside", "translation": [5, 0, 0], "children": [1]})
        tree["nodes"][0]["children"].append(2)

    write_gltf(tmp_path / "pair.glb", add)
    words = "has node 'lower' below both 'upper' and 'aside', but nodes must form a tree."
    refused(tmp_path / "pair.glb", f"The mesh file 'pair.glb' {words}", caplog, join=True)


# Extensions


def ball() -> trimesh.Scene:
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.icosphere(1), geom_name="ball")
    return scene


def compress(tree) -> None:
    """As if by Draco: all values in one block, and accessors without any."""
    (primitive,) = tree["meshes"][0]["primitives"]
    ids = {"POSITION": 0}
    primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": ids}}
    for accessor in tree["accessors"]:
        accessor.pop("bufferView")
    tree["extensionsUsed"] = tree["extensionsRequired"] = ["KHR_draco_mesh_compression"]


@pytest.mark.parametrize("suffix", ["gltf", "glb"])
def test_compressed_meshes_are_refused(tmp_path, caplog, monkeypatch, suffix):
    """trimesh would log lines of its own and put all points at the origin."""
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    write_gltf(tmp_path / f"ball.{suffix}", compress, ball())
    words = "is compressed with KHR_draco_mesh_compression, which is not read here; export it without compression."
    refused(tmp_path / f"ball.{suffix}", f"The mesh file 'ball.{suffix}' {words}", caplog)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("EXT_meshopt_compression", "is compressed with EXT_meshopt_compression, which is not read here; export it"),
        ("KHR_meshopt_compression", "is compressed with KHR_meshopt_compression, which is not read here; export it"),
        ("EXT_mesh_gpu_instancing", "needs the glTF extension EXT_mesh_gpu_instancing, which is not read here; export"),
    ],
)
def test_extensions_that_change_the_shape_are_refused(tmp_path, name, words):
    write_gltf(
        tmp_path / "ball.glb", lambda tree: tree.update(extensionsRequired=["KHR_materials_unlit", name]), ball()
    )
    with pytest.raises(MeshError, match=f"^The mesh file 'ball.glb' {words}"):
        read_mesh(tmp_path / "ball.glb")


@pytest.mark.parametrize(
    "name",
    ["KHR_mesh_quantization", "KHR_texture_transform", "KHR_texture_basisu", "KHR_materials_unlit", "EXT_texture_webp"],
)
def test_extensions_that_leave_the_shape_as_it_is_are_read(tmp_path, caplog, name):
    """Whether a file requires them or only uses them."""
    for key in ("extensionsUsed", "extensionsRequired"):
        write_gltf(tmp_path / f"{key}.glb", lambda tree, key=key: tree.update({key: [name]}), ball())
        assert len(read_mesh(tmp_path / f"{key}.glb").points) == 42
    unread = "EXT_meshopt_compression"  # may be left alone where there are plain values, too
    write_gltf(tmp_path / "both.glb", lambda tree: tree.update(extensionsUsed=[unread]), ball())
    assert len(read_mesh(tmp_path / "both.glb").points) == 42
    assert caplog.records == []


@pytest.mark.parametrize("normalized", [False, True])
def test_quantized_points_are_read_as_they_are_or_refused(tmp_path, normalized):
    """Normalized, they are fractions of 32767, which trimesh would take for whole metres."""
    corners, faces = np.array([(0, 0, 0, 0), (4, 0, 0, 0), (0, 4, 0, 0)], np.int16), np.arange(3, dtype=np.uint32)
    tree = {
        "asset": {"version": "2.0"},
        "extensionsRequired": ["KHR_mesh_quantization"],
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "leaf", "mesh": 0, "scale": [0.25, 0.25, 0.25]}],
        "meshes": [{"name": "leaf", "primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": 36, "uri": "leaf.bin"}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 24, "byteStride": 8},
            {"buffer": 0, "byteOffset": 24, "byteLength": 12},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5122, "normalized": normalized, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
    }
    (tmp_path / "leaf.bin").write_bytes(corners.tobytes() + faces.tobytes())
    (tmp_path / "leaf.gltf").write_text(json.dumps(tree))
    if normalized:
        with pytest.raises(
            MeshError, match=r"mesh 'leaf' in normalized numbers \(POSITION\), which are not read; expo"
        ):
            read_mesh(tmp_path / "leaf.gltf")
    else:
        np.testing.assert_allclose(read_mesh(tmp_path / "leaf.gltf").points, [(0, 0, 0), (1, 0, 0), (0, 0, 1)])
