"""The triangle mesh that all readers produce."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import validate
from ..errors import MeshError
from ..transforms import apply
from ..validate import Array, ReadOnly
from .check import areas_only, check_areas, check_manifold, checked_arrays
from .topology import EdgeTable, near_groups, oriented

SEAM = 1e-6  # of a mesh's largest extent: some rounding errors of float32, far below any edge


@dataclass(frozen=True, eq=False)
class TriangleMesh(ReadOnly):
    """Triangles over shared vertices, Z up and in metres.

    Args:
        points: [m], shape [n, 3].
        triangles: counter-clockwise vertex indices, shape [m, 3], int32.
        uvs: texture coordinates, origin at the lower left, shape [k, 2], or None.
        uv_indices: index into ``uvs`` of each corner, shape [m, 3], so that seams do not split vertices, or None.
        name: of the prim or file.

    Raises:
        MeshError: on an empty mesh, non-finite points or an index out of range; InputError: on wrong shapes or types.
    """

    points: Array
    triangles: Array
    uvs: Array = None
    uv_indices: Array = None
    name: str = "mesh"

    def __post_init__(self):
        points, triangles = checked_arrays(self.points, self.triangles, self.label)
        values: dict[str, Any] = {"points": points, "triangles": triangles}
        if self.uvs is None or self.uv_indices is None:
            values |= {"uvs": None, "uv_indices": None}
        else:
            uvs = validate.array(self.uvs, f"{self.label}: uvs", (None, 2))
            corners = validate.array(self.uv_indices, f"{self.label}: uv_indices", (len(triangles), 3), np.int32)
            if corners.min() < 0 or corners.max() >= len(uvs):
                title = validate.sentence(self.label)
                raise MeshError(f"{title}: uv_indices refer to texture coordinates outside 0 to {len(uvs) - 1}.")
            values |= {"uvs": uvs, "uv_indices": corners}
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def label(self) -> str:
        """How messages call the mesh."""
        return f"mesh '{self.name}'"

    def transformed(self, matrix: np.ndarray) -> "TriangleMesh":
        """The mesh moved by a 4 × 4 matrix; fronts stay fronts even when it mirrors."""
        points = apply(matrix, self.points)
        return replace(self.flipped() if np.linalg.det(matrix[:3, :3]) < 0.0 else self, points=points)

    def flipped(self) -> "TriangleMesh":
        """The mesh with front and back exchanged."""
        corners = None if self.uv_indices is None else self.uv_indices[:, ::-1]
        return replace(self, triangles=self.triangles[:, ::-1], uv_indices=corners)

    def welded(self) -> "TriangleMesh":
        """The mesh with vertices in the same place merged, and those that no triangle uses dropped.

        Nearer than :data:`SEAM` times the mesh's largest extent is the same place, as writers round; the first keeps
        its place. Order is kept. Layers that lie in the same place are left apart: nothing is merged when that would
        give an edge more than two triangles. Where merging what is only near would do so, or make a triangle shrink to
        a line, what is exactly in the same place is merged.
        """
        return self.weld()[0]

    def weld(self) -> tuple["TriangleMesh", np.ndarray]:
        """The same, and which vertex of it each of the vertices here has become, −1 for dropped ones; shape [n]."""
        used = np.zeros(len(self.points), bool)
        used[self.triangles] = True
        merged = self._merged()
        keep = np.zeros(len(self.points), bool)
        keep[merged[used]] = True
        if keep.all():
            return self, np.arange(len(self.points))
        number = np.cumsum(keep) - 1
        welded = replace(self, points=self.points[keep], triangles=number[merged[self.triangles]])
        return welded, np.where(keep[merged], number[merged], -1)

    def _merged(self) -> np.ndarray:
        """Which vertex each vertex becomes part of, shape [n]."""
        _, first, group = np.unique(self.points + 0.0, axis=0, return_index=True, return_inverse=True)
        exact = first[group.ravel()]
        near = self._near()
        branches = not EdgeTable.of(self.triangles).is_manifold
        harmless = np.array_equal(_shrunk(near[self.triangles]), _shrunk(exact[self.triangles]))
        if harmless and (branches or EdgeTable.of(near[self.triangles]).is_manifold):
            return near
        if branches or EdgeTable.of(exact[self.triangles]).is_manifold:
            return exact
        return np.arange(len(self.points))

    def _near(self) -> np.ndarray:
        """For each vertex the first of those as near as rounding may part them, shape [n].

        Vertices that no triangle uses, wherever writers have left them, have no say in how large the mesh is.
        """
        used = self.points[self.triangles.ravel()]
        low, high = used.min(axis=0), used.max(axis=0)
        distance = SEAM * float((high - low).max())
        inside = np.flatnonzero(np.all((self.points >= low) & (self.points <= high), axis=1))
        near = np.arange(len(self.points))
        near[inside] = inside[near_groups(self.points[inside], distance)]
        return near

    @staticmethod
    def joined(meshes: Sequence["TriangleMesh"], name: str) -> "TriangleMesh":
        """Several meshes as one; texture coordinates are kept when all have them."""
        if len(meshes) == 1:
            return replace(meshes[0], name=name)
        starts = np.cumsum([0] + [len(mesh.points) for mesh in meshes])
        points = np.concatenate([mesh.points for mesh in meshes])
        triangles = np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)])
        if any(mesh.uvs is None for mesh in meshes):
            return TriangleMesh(points, triangles, name=name)
        starts = np.cumsum([0] + [len(mesh.uvs) for mesh in meshes])
        corners = np.concatenate([mesh.uv_indices + start for mesh, start in zip(meshes, starts, strict=False)])
        return TriangleMesh(points, triangles, np.concatenate([mesh.uvs for mesh in meshes]), corners, name)


def cloth_mesh(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh as cloth: no triangle without area, no branching edge, neighbours facing the same way.

    Raises:
        MeshError: when it has one of the first two, or only one side.
    """
    table = EdgeTable.of(mesh.triangles)
    check_areas(mesh.points, mesh.triangles, mesh.label)
    check_manifold(mesh.triangles, table, mesh.label)
    return _with_triangles(mesh, oriented(mesh.triangles, table, mesh.label))


def obstacle_mesh(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh as obstacle: its triangles with area; closed surfaces are made to face outwards.

    What has no area is left out with a :class:`MeshWarning`, after it has had its say in which way others face.

    Raises:
        MeshError: when no triangle has area.
    """
    table = EdgeTable.of(mesh.triangles)
    if table.is_closed:
        mesh = _with_triangles(mesh, oriented(mesh.triangles, table, mesh.label))
        a, b, c = np.moveaxis(mesh.points[mesh.triangles] - mesh.points.mean(axis=0), 1, 0)
        volume = np.einsum("ti,ti->", a, np.cross(b, c))
        mesh = mesh.flipped() if volume < 0.0 else mesh
    kept = areas_only(mesh.points, mesh.triangles, mesh.label)
    return mesh if len(kept) == len(mesh.triangles) else TriangleMesh(mesh.points, kept, name=mesh.name)


def _shrunk(triangles: np.ndarray) -> np.ndarray:
    """Which triangles have a corner twice."""
    return np.any(triangles == np.roll(triangles, 1, axis=1), axis=1)


def _with_triangles(mesh: TriangleMesh, triangles: np.ndarray) -> TriangleMesh:
    """The mesh with some triangles turned over, as ``triangles`` has them."""
    if triangles is mesh.triangles or mesh.uv_indices is None:
        return replace(mesh, triangles=triangles)
    turned = np.any(triangles != mesh.triangles, axis=1)
    corners = np.where(turned[:, None], mesh.uv_indices[:, ::-1], mesh.uv_indices)
    return replace(mesh, triangles=triangles, uv_indices=corners)
