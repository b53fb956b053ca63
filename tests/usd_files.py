"""Small USD files for tests."""

import numpy as np
from pxr import Usd, UsdGeom

SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


def write_usd(path, *, up="Z", metres=1.0, points=SQUARE, counts=(4,), indices=(0, 1, 2, 3), prim="/world/sheet"):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    UsdGeom.Xform.Define(stage, "/world")
    mesh = UsdGeom.Mesh.Define(stage, prim)
    mesh.CreatePointsAttr(np.array(points, float).tolist())
    mesh.CreateFaceVertexCountsAttr(list(counts))
    mesh.CreateFaceVertexIndicesAttr(list(indices))
    return stage, mesh
