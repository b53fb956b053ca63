"""glTF files of which trimesh would read nothing, a part, or something else: each is refused in one sentence."""

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
