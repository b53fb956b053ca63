"""The faces of a mesh prim."""

import numpy as np
from pxr import Usd, UsdGeom

from ...errors import MeshError
from ...meshes.triangulate import triangulate, without_holes
from .samples import integers


def mesh_triangles(mesh: UsdGeom.Mesh, points: np.ndarray) -> np.ndarray:
    """Triangles of a mesh, polygons cut up, holes left out, counter-clockwise seen from the front; int32, shape [m, 3].

    Raises:
        MeshError: when there are none, or they refer to points that do not exist.
    """
    fault = face_fault(mesh, len(points))
    if fault:
        raise MeshError(f"Mesh {mesh.GetPath()} {fault}.")
    counts, corners = _faces(mesh)
    holes = mesh.GetHoleIndicesAttr().Get(Usd.TimeCode.EarliestTime())
    triangles = corners[without_holes(triangulate(points, counts, corners), counts, holes)]
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        triangles = triangles[:, ::-1]
    return np.ascontiguousarray(triangles, np.int32)


def changing_faces(mesh: UsdGeom.Mesh) -> str | None:
    """Name of an attribute by which the faces of a mesh differ between two times, or None.

    Many writers sample faces at every frame, as they do not look whether these ever change.
    """
    for attribute in (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()):
        codes, said = attribute.GetTimeSamples(), attribute.Get()
        first = attribute.Get(codes[0]) if codes else said
        later = (attribute.Get(code) for code in codes[1:])  # one after the other: they may be many
        if any(value != first for value in later) or (said is not None and said != first):
            return str(attribute.GetName())
    return None


def face_fault(mesh: UsdGeom.Mesh, count: int) -> str | None:
    """Why the faces over ``count`` points cannot be used, or None."""
    counts, corners = _faces(mesh)
    valid, why = UsdGeom.Mesh.ValidateTopology(integers(corners), integers(counts), count)
    if not valid:
        return f"has invalid faces ({why.strip().rstrip('.')})"
    return None if len(counts) and counts.min() >= 3 else "has no faces, or some with less than 3 corners"


def _faces(mesh: UsdGeom.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Corners of each face, and the vertex of each corner."""
    first = Usd.TimeCode.EarliestTime()  # where a value is sampled but has no default
    counts, corners = mesh.GetFaceVertexCountsAttr().Get(first), mesh.GetFaceVertexIndicesAttr().Get(first)
    return np.array([] if counts is None else counts, np.int32), np.array([] if corners is None else corners, np.int32)
