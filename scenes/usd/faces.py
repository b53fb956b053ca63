"""The faces of a mesh prim."""

import numpy as np
from pxr import Usd, UsdGeom, Vt

from ...errors import MeshError
from ...meshes.triangulate import triangulate


def mesh_triangles(mesh: UsdGeom.Mesh, points: np.ndarray) -> np.ndarray:
    """Triangles of a mesh, polygons cut up, counter-clockwise seen from the front; int32, shape [m, 3].

    Raises:
        MeshError: when there are none, or they refer to points that do not exist.
    """
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(Usd.TimeCode.EarliestTime()) or [], np.int32)
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get(Usd.TimeCode.EarliestTime()) or [], np.int32)
    valid, why = UsdGeom.Mesh.ValidateTopology(
        Vt.IntArray.FromNumpy(corners), Vt.IntArray.FromNumpy(counts), len(points)
    )
    if not valid or len(counts) == 0 or counts.min() < 3:
        raise MeshError(f"Mesh {mesh.GetPath()} has no usable faces: {why or 'each needs at least 3 corners'}.")
    triangles = corners[triangulate(points, counts, corners)]
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        triangles = triangles[:, ::-1]
    return np.ascontiguousarray(triangles, np.int32)
