"""PLY, STL, OFF and glTF through trimesh."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MeshError
from .choose import Part, chosen
from .trianglemesh import TriangleMesh

GLTF_TO_Z_UP = np.array(
    [[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]]
)  # glTF is Y up by its standard


def read_with_trimesh(path: Path, prim: str | None, join: bool) -> TriangleMesh:
    """The mesh in a PLY, STL, OFF, GLB or glTF file.

    Raises:
        MeshError: when trimesh cannot read it, or it holds several meshes (glTF) and none is chosen.
    """
    import trimesh

    gltf = path.suffix.lower() in (".glb", ".gltf")
    options: dict[str, Any] = {"merge_primitives": True, "skip_materials": True} if gltf else {}
    try:
        if path.suffix.lower() == ".gltf":
            json.loads(path.read_bytes())  # trimesh would fall back to a "model.gltf" beside it
        scene = trimesh.load_scene(path, process=False, **options)
    except Exception as error:  # whatever the parsers of damaged files raise
        reason = (str(error).strip() or type(error).__name__).split("\n")[0]
        kind = path.suffix[1:].upper()
        raise MeshError(f"The mesh file '{path.name}' is damaged or not {kind} (trimesh: {reason}).") from None
    return mesh_of_scene(scene, path.stem, prim, join, GLTF_TO_Z_UP if gltf else np.eye(4))


def mesh_of_scene(scene: Any, name: str, prim: str | None, join: bool, axes: np.ndarray) -> TriangleMesh:
    """The chosen meshes of a ``trimesh.Scene``, placed by its graph and then by ``axes``."""
    parts = []
    for node in scene.graph.nodes_geometry:
        matrix, key = scene.graph.get(node)
        geometry = scene.geometry[key]
        if hasattr(geometry, "faces") and len(geometry.faces):
            parts.append(Part(f"/{node}", partial(_placed, geometry, node, axes @ matrix)))
    if len(parts) == 1 and prim is None:
        return TriangleMesh.joined([parts[0].read()], name)
    return chosen(parts, name, prim, join)


def _placed(geometry: Any, name: str, matrix: np.ndarray) -> TriangleMesh:
    return mesh_of_trimesh(geometry, name).transformed(matrix)


def mesh_of_trimesh(mesh: Any, name: str) -> TriangleMesh:
    """A ``trimesh.Trimesh`` with the texture coordinates of its vertices, if any."""
    faces = np.array(mesh.faces, np.int32).reshape(-1, 3)
    uvs = getattr(getattr(mesh, "visual", None), "uv", None)
    if uvs is None or len(uvs) != len(mesh.vertices):
        return TriangleMesh(np.array(mesh.vertices, float), faces, name=name)
    return TriangleMesh(np.array(mesh.vertices, float), faces, np.array(uvs, float)[:, :2], faces, name)
