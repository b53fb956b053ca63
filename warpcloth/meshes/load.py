"""Meshes from anything a user may hand over."""

from pathlib import Path
from typing import Any

import numpy as np

from .. import validate
from ..errors import MeshError
from .assets import resolve_asset
from .trianglemesh import TriangleMesh

USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
TRIMESH_SUFFIXES = (".stl", ".glb", ".gltf")
SUFFIXES = (".obj", ".ply", ".off", *TRIMESH_SUFFIXES, *USD_SUFFIXES)


def read_mesh(path: Any, prim: str | None = None, *, join: bool = False) -> TriangleMesh:
    """A triangle mesh from a file, Z up and in metres.

    USD and glTF keep their axes and units and are converted; OBJ, PLY, STL and OFF have none and are taken as Z up in
    metres. Polygons are triangulated, vertices in the same place, or nearer than a millionth of the mesh's largest
    extent, are merged (so texture seams do not cut the cloth) and unused ones dropped; texture coordinates are kept.

    Args:
        path: file name, or asset name such as ``"warp:bunny.usd"``.
        prim: path or name of a mesh in a USD or glTF file; a parent prim means all meshes below it, joined.
        join: join several meshes when ``prim`` is None, rather than refusing.

    Raises:
        MeshError: when there is no such file or mesh, it cannot be read, is empty, or holds several meshes and none is
            chosen.
    """
    file = resolve_asset(path)
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        known = ", ".join(suffix[1:].upper() for suffix in SUFFIXES)
        raise MeshError(f"The mesh file '{file.name}' is of no known kind; known are {known}.")
    if file.stat().st_size == 0:
        raise MeshError(f"The mesh file '{file.name}' is empty: it has 0 bytes.")
    return _read(file, suffix, _checked_prim(prim, file.name, suffix), join).welded()


def load_mesh(source: Any, prim: str | None = None, *, join: bool = False) -> TriangleMesh:
    """A mesh from a file or asset name, a ``TriangleMesh``, a ``trimesh.Trimesh`` or a ``trimesh.Scene``.

    Arguments and errors as for :func:`read_mesh`; a mesh object keeps its axes.
    """
    if isinstance(source, TriangleMesh):
        _refuse_prim(prim, source)
        return source
    if hasattr(source, "geometry") and hasattr(source, "graph"):
        from .files import mesh_of_scene

        return mesh_of_scene(source, "scene", _checked_prim(prim, "scene", ".glb"), join, np.eye(4)).welded()
    if hasattr(source, "vertices") and hasattr(source, "faces"):
        from .files import mesh_of_trimesh

        _refuse_prim(prim, source)
        return mesh_of_trimesh(source, "mesh").welded()
    return read_mesh(source, prim, join=join)


def _read(file: Path, suffix: str, prim: str | None, join: bool) -> TriangleMesh:
    try:
        if suffix == ".obj":
            from .obj import read_obj

            return read_obj(file)
        if suffix == ".ply":
            from .ply import read_ply

            return read_ply(file)
        if suffix == ".off":
            from .off import read_off

            return read_off(file)
        if suffix in USD_SUFFIXES:
            from .usd import read_usd

            return read_usd(file, prim, join)
        from .files import read_with_trimesh

        return read_with_trimesh(file, prim, join)
    except OSError as error:
        raise MeshError(f"The mesh file '{file.name}' cannot be read: {error.strerror or error}.") from None


def _refuse_prim(prim: Any, mesh: Any) -> None:
    if prim is not None:
        raise MeshError(
            f"A {type(mesh).__name__} is a single mesh, so prim {validate.shown(prim)} cannot be chosen from it."
        )


def _checked_prim(prim: Any, file: str, suffix: str) -> str | None:
    if prim is None:
        return None
    if not isinstance(prim, str) or not prim.strip():
        raise MeshError(f"Prim must be the path or name of a mesh in '{file}', got {validate.shown(prim)}.")
    if suffix not in (*USD_SUFFIXES, ".glb", ".gltf"):
        raise MeshError(f"'{file}' holds a single mesh without a name, so prim '{prim}' cannot be chosen from it.")
    return prim
