"""Triangle meshes as prims: fixed topology, points and all that follows from them sampled."""

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from ...cloth import Cloth
from .roles import CLOTH_ROLE, mark, set_number
from .samples import SAMPLE_OVERHEAD, checked, integers, vectors
from .stage import bind_color
from .surface import VertexNormals


class MeshPrim:
    """A ``UsdGeomMesh`` of triangles whose default value is its rest pose.

    Args:
        stage: to define it on.
        path: of the prim.
        points: rest pose [m], shape [n, 3].
        triangles: counter-clockwise seen from the front, shape [m, 3].
    """

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, points: np.ndarray, triangles: np.ndarray):
        self.mesh = UsdGeom.Mesh.Define(stage, path)
        self.prim = self.mesh.GetPrim()
        self.count = len(points)
        self._normals = VertexNormals(triangles, len(points))
        self.mesh.CreateFaceVertexCountsAttr(integers(np.full(len(triangles), 3)))
        self.mesh.CreateFaceVertexIndicesAttr(integers(triangles))
        self.mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        self.mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
        self.mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        self.set_points(points, Usd.TimeCode.Default())

    def set_points(self, points: np.ndarray, code: Usd.TimeCode | float) -> int:
        """Sets points and the normals and extent that follow from them; returns the bytes held in memory."""
        stored = self.checked(points, "points")
        self.mesh.GetPointsAttr().Set(vectors(stored), code)
        self.mesh.GetNormalsAttr().Set(vectors(self._normals.at(stored)), code)
        rows = np.ascontiguousarray(stored.T)  # ten times as fast
        self.mesh.GetExtentAttr().Set(vectors(np.stack([rows.min(axis=1), rows.max(axis=1)])), code)
        return 2 * stored.nbytes + 3 * SAMPLE_OVERHEAD

    def drop(self, code: float) -> None:
        """Takes back what was set at time ``code``."""
        for attribute in (self.mesh.GetPointsAttr(), self.mesh.GetNormalsAttr(), self.mesh.GetExtentAttr()):
            attribute.ClearAtTime(code)

    def checked(self, values: np.ndarray, what: str) -> np.ndarray:
        """``values`` as stored; UsdError when they are not one vector per vertex."""
        return checked(values, self.count, self.prim.GetName(), what)


class ClothPrim(MeshPrim):
    """A cloth: a mesh in world space with velocities, texture coordinates, pins and a material."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, cloth: Cloth):
        super().__init__(stage, path, cloth.points, cloth.triangles)
        self.mesh.CreateDoubleSidedAttr(True)
        mark(self.prim, CLOTH_ROLE, cloth.name)
        self.prim.SetCustomDataByKey("warpcloth:fabric", cloth.fabric.name)
        set_number(self.prim, "thickness", cloth.fabric.thickness)
        bind_color(self.prim, cloth.fabric.color, roughness=0.9)
        self._set_texture_coordinates(cloth)
        self._set_pins(cloth.pinned)

    def write(self, code: float, points: np.ndarray, velocities: np.ndarray) -> int:
        """Sets one frame: points [m] and velocities [m/s], shape [n, 3]; returns the bytes held in memory."""
        stored = self.checked(velocities, "velocities")
        held = self.set_points(points, code)
        self.mesh.GetVelocitiesAttr().Set(vectors(stored), code)
        return held + stored.nbytes + SAMPLE_OVERHEAD

    def drop(self, code: float) -> None:
        super().drop(code)
        self.mesh.GetVelocitiesAttr().ClearAtTime(code)

    def _set_texture_coordinates(self, cloth: Cloth) -> None:
        if cloth.uvs is None:
            return
        primvar = UsdGeom.PrimvarsAPI(self.mesh).CreatePrimvar(
            "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
        )
        values, indices = _distinct(cloth.uvs, cloth.uv_indices)
        primvar.Set(Vt.Vec2fArray.FromNumpy(values))
        primvar.SetIndices(integers(indices))

    def _set_pins(self, indices: np.ndarray) -> None:
        """The held vertices as a point subset, so that they can be seen and selected in any USD tool."""
        if len(indices) == 0:
            return
        UsdGeom.Subset.CreateGeomSubset(self.mesh, "pins", UsdGeom.Tokens.point, integers(indices), "pins")


def _distinct(pairs: np.ndarray, indices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same values in single precision, each once, in the order of their first, and the indices into these.

    Many writers have a value for each corner of each face, and validators object to values that are there twice.
    """
    stored = np.ascontiguousarray(pairs, np.float32) + np.float32(0.0)  # which makes −0 a 0
    _, first, group = np.unique(stored.view(np.uint64).ravel(), return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return stored[first[order]], place[group][indices]
