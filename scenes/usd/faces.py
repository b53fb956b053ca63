"""The faces of a mesh prim."""

import numpy as np
from pxr import Usd, UsdGeom

from ...meshes.triangulate import triangulate


def mesh_triangles(mesh: UsdGeom.Mesh, points: np.ndarray) -> np.ndarray:
    """Triangles of a mesh, polygons cut up, counter-clockwise seen from the front; int32, shape [m, 3]."""
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(Usd.TimeCode.EarliestTime()) or [], np.int64)
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get(Usd.TimeCode.EarliestTime()) or [], np.int32)
    triangles = corners[triangulate(points, counts, corners)]
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        triangles = triangles[:, ::-1]
    return np.ascontiguousarray(triangles, np.int32)
