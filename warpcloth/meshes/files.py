"""STL and glTF through trimesh."""

from collections import defaultdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MeshError
from .choose import SHOWN, Part, chosen
from .gltf import Y_UP_TO_Z_UP, gltf_texture, with_texture_attribute
from .trianglemesh import TriangleMesh


def read_with_trimesh(path: Path, prim: str | None, join: bool) -> TriangleMesh:
    """The mesh in an STL, GLB or glTF file.

    Raises:
        MeshError: when trimesh cannot read it or finds nothing in it, or it holds several meshes (glTF) and none is
            chosen, or a sparse one.
    """
    import trimesh

    kind = path.suffix[1:].lower()
    gltf = kind in ("glb", "gltf")
    try:
        if gltf:
            resolver = trimesh.resolvers.FilePathResolver(str(path))
            content = with_texture_attribute(path)
            scene = trimesh.load_scene(content, kind, resolver, process=False, skip_materials=True)
        else:
            scene = trimesh.load_scene(path, process=False)
    except MeshError:
        raise
    except Exception as error:  # whatever the parsers of damaged files raise
        lines = str(error).strip().splitlines() or [type(error).__name__]
        raise MeshError(
            f"The mesh file '{path.name}' is damaged or not {kind.upper()} (trimesh: {lines[0]})."
        ) from None
    if not gltf and not any(len(geometry.faces) for geometry in scene.geometry.values()):
        # What trimesh makes of a file that is shorter than its header says, too.
        raise MeshError(f"The mesh file '{path.name}' holds no triangle that can be read: it is cut off or not STL.")
    whole = join or not gltf  # solids of an STL file are parts of one thing, as groups of an OBJ file are
    return mesh_of_scene(scene, path.stem, prim, whole, Y_UP_TO_Z_UP if gltf else np.eye(4))


def mesh_of_scene(scene: Any, name: str, prim: str | None, join: bool, axes: np.ndarray) -> TriangleMesh:
    """The chosen meshes of a ``trimesh.Scene``, placed by its graph and then by ``axes``.

    Raises:
        MeshError: when its nodes form a circle, or it holds several meshes and none is chosen.
    """
    groups: dict[str, list[tuple[Any, np.ndarray]]] = defaultdict(list)
    for node in scene.graph.nodes_geometry:
        upwards = _upwards(scene.graph, node, name)  # first, as in a circle there is no matrix
        matrix, key = scene.graph.get(node)
        geometry = scene.geometry[key]
        if hasattr(geometry, "faces") and len(geometry.faces):
            groups[_path(upwards, geometry)].append((geometry, axes @ matrix))
    parts = [Part(path, partial(_joined, group, path)) for path, group in groups.items()]
    if len(parts) == 1 and prim is None:
        return TriangleMesh.joined([parts[0].read()], name)
    return chosen(parts, name, prim, join)


def mesh_of_trimesh(mesh: Any, name: str) -> TriangleMesh:
    """A ``trimesh.Trimesh`` with the texture coordinates of its vertices, if any."""
    points, faces = np.array(mesh.vertices, float), np.array(mesh.faces, np.int32).reshape(-1, 3)
    uvs = gltf_texture(mesh)
    if uvs is None:
        uvs = getattr(getattr(mesh, "visual", None), "uv", None)
    if uvs is None or np.shape(uvs)[:1] != points.shape[:1] or not np.isfinite(uvs).all():
        return TriangleMesh(points, faces, name=name)
    return TriangleMesh(points, faces, np.array(uvs, float)[:, :2], faces, name)


def _upwards(graph: Any, node: str, name: str) -> list[str]:
    """A node of the scene graph and those above it, up to the base, which is left out."""
    parents, names = graph.transforms.parents, [node]
    while (above := parents.get(names[-1])) not in (None, graph.base_frame):
        if above in names:
            circle = ", ".join(repr(each) for each in names[names.index(above) :][:SHOWN])
            raise MeshError(f"'{name}' cannot be read: its nodes form a circle ({circle}), but must form a tree.")
        names.append(above)
    return names


def _path(upwards: list[str], geometry: Any) -> str:
    """Path of a mesh in the scene graph. trimesh adds a node of random name for each part of a glTF mesh: left out."""
    part = geometry.metadata.get("from_gltf_primitive") and len(upwards) > 1
    return "/" + "/".join(reversed(upwards[1:] if part else upwards))


def _joined(group: list[tuple[Any, np.ndarray]], path: str) -> TriangleMesh:
    name = path.rsplit("/", 1)[-1]
    return TriangleMesh.joined([mesh_of_trimesh(geometry, name).transformed(m) for geometry, m in group], name)
