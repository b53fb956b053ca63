"""A simulated cloth as an opinion over the mesh it comes from."""

from collections.abc import Sequence

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdSkel

from warpcloth.transforms import apply

from ..usd.faces import mesh_triangles
from ..usd.moving import transform_codes
from ..usd.opening import local_matrix
from ..usd.roles import CLOTH_ROLE, mark, set_number
from ..usd.samples import SAMPLE_OVERHEAD, as_vectors, checked, vectors
from ..usd.skins import Skin
from ..usd.surface import VertexNormals, vertex_normals
from .cloth_reader import ShotCloth

DEFAULT = Usd.TimeCode.Default()
STALE = {  # what the mesh has of its own that would be wrong now, by whether it is made of facets
    True: {"primvars:normals": Sdf.ValueTypeNames.Normal3fArray},  # would be stronger than normals
    False: dict.fromkeys(("normals", "primvars:normals"), Sdf.ValueTypeNames.Normal3fArray),  # follow from its points
}


class ClothOver:
    """Points, velocities, extent and, on polygonal meshes, normals of one mesh, in its own frame and units.

    Args:
        layer: a stage of nothing but the layer to write to.
        part: the cloth and its mesh.
        codes: time codes of the frames to come.
        instant: a time much shorter than a frame, in time codes.

    Raises:
        UsdError: at one of these times the mesh is in a frame that flattens space.
    """

    def __init__(self, layer: Usd.Stage, part: ShotCloth, codes: Sequence[float], instant: float):
        self.source, self.part, self.instant = part.mesh, part, instant
        prim = part.mesh.GetPrim()
        self.over = UsdGeom.Mesh(layer.OverridePrim(prim.GetPath()))
        single_out(layer, prim)
        _forget_bounds(layer, prim)
        if Skin.of(part.mesh):  # it would be moved once more
            UsdSkel.BindingAPI(self.over.GetPrim()).CreateSkeletonRel().SetTargets([])
        self.moves = bool(transform_codes(prim))
        self.rate = prim.GetStage().GetTimeCodesPerSecond()
        self.to_local, *_ = (local_matrix(prim, code) for code in (codes if self.moves else codes[:1]))
        first = as_vectors(part.mesh.GetPointsAttr().Get(Usd.TimeCode(codes[0])))
        self.local = first if len(first) else as_vectors(part.mesh.GetPointsAttr().Get(Usd.TimeCode.EarliestTime()))
        self.used = part.particle_of >= 0
        self.triangles = mesh_triangles(part.mesh, self.local)
        self.faceted = part.mesh.GetSubdivisionSchemeAttr().Get() == UsdGeom.Tokens.none
        self._normals = VertexNormals(self.triangles, len(self.local)) if self.faceted else None
        self._annotate()
        self._set_rest()

    def write(self, code: float, points: np.ndarray, velocities: np.ndarray) -> int:
        """Sets one frame: world positions [m] and velocities [m/s], shape [n, 3]; returns the bytes held in memory."""
        to_local = local_matrix(self.source.GetPrim(), code) if self.moves else self.to_local
        world = self.checked(points, "points").astype(float)
        speeds = self.checked(velocities, "velocities").astype(float)
        local = apply(to_local, world)
        rates = speeds @ to_local[:3, :3].T + self._drift(code, world)
        self.local[self.used] = local[self.part.particle_of[self.used]]
        spread = np.zeros_like(self.local)
        spread[self.used] = rates[self.part.particle_of[self.used]]
        self.over.GetVelocitiesAttr().Set(vectors(spread), code)
        held = self._set_points(np.asarray(self.local, np.float32), code)
        return held + spread.nbytes // 2 + SAMPLE_OVERHEAD

    def drop(self, code: float) -> None:
        """Takes back what was set at time ``code``."""
        mesh = self.over
        for attribute in (
            mesh.GetPointsAttr(), mesh.GetNormalsAttr(), mesh.GetExtentAttr(), mesh.GetVelocitiesAttr()
        ):  # fmt: skip
            if attribute:
                attribute.ClearAtTime(code)

    def checked(self, values: np.ndarray, what: str) -> np.ndarray:
        """``values`` as stored; UsdError when they are not one vector per particle."""
        return checked(values, len(self.part.cloth.points), self.part.cloth.name, what)

    def _set_points(self, points: np.ndarray, code: Usd.TimeCode | float) -> int:
        self.over.CreatePointsAttr().Set(vectors(points), code)
        self.over.CreateExtentAttr().Set(vectors(np.stack([points.min(axis=0), points.max(axis=0)])), code)
        if self._normals is not None:
            self.over.CreateNormalsAttr().Set(vectors(self._normals.at(points)), code)
        return 2 * points.nbytes + 3 * SAMPLE_OVERHEAD

    def _drift(self, code: float, world: np.ndarray) -> np.ndarray:
        """What a moving frame adds to velocities as seen from it [units/s].

        Differences look ahead, as the velocity of a held point at a key is that with which it leaves.
        """
        if not self.moves:
            return np.zeros(3)
        prim = self.source.GetPrim()
        now, soon = (local_matrix(prim, code + shift) for shift in (0.0, self.instant))
        return (apply(soon, world) - apply(now, world)) * (self.rate / self.instant)

    def _annotate(self) -> None:
        prim, cloth = self.over.GetPrim(), self.part.cloth
        mark(prim, CLOTH_ROLE, cloth.name)
        prim.SetCustomDataByKey("warpcloth:fabric", cloth.fabric.name)
        set_number(prim, "thickness", cloth.fabric.thickness)
        self.over.CreateVelocitiesAttr()
        if self.faceted:
            self.over.CreateNormalsAttr()
            self.over.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        elif not self.source.GetSubdivisionSchemeAttr().HasAuthoredValue():
            self.over.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)  # as it is when nobody says
        for attribute in (self.source.GetFaceVertexCountsAttr(), self.source.GetFaceVertexIndicesAttr()):
            if attribute.GetNumTimeSamples():  # always the same, which nobody else looks for
                once = prim.CreateAttribute(attribute.GetName(), attribute.GetTypeName(), custom=False)
                once.Set(attribute.Get(Usd.TimeCode.EarliestTime()))
        for name, kind in (STALE[self.faceted] | {"accelerations": Sdf.ValueTypeNames.Vector3fArray}).items():
            attribute = self.source.GetPrim().GetAttribute(name)
            if attribute and attribute.HasAuthoredValue():
                prim.CreateAttribute(name, kind, custom=False).Block()

    def _set_rest(self) -> None:
        """A rest pose where the mesh has none, and what goes with it: an extent, and as many normals as points."""
        rest = as_vectors(self.source.GetPointsAttr().Get())
        stored = np.asarray(rest if len(rest) else self.local, np.float32)
        if len(rest):
            self.over.CreateExtentAttr().Set(vectors(np.stack([stored.min(axis=0), stored.max(axis=0)])), DEFAULT)
            if self.faceted:
                self.over.CreateNormalsAttr().Set(vectors(vertex_normals(stored, self.triangles)), DEFAULT)
        else:
            self._set_points(stored, DEFAULT)


def single_out(layer: Usd.Stage, prim: Usd.Prim) -> None:
    """Lets the instances that a prim is in be no instances any more, as nothing can be said of parts of these."""
    stage = prim.GetStage()
    for path in prim.GetPath().GetPrefixes():
        if stage.GetPrimAtPath(path).IsInstance():
            layer.OverridePrim(path).SetInstanceable(False)


def _forget_bounds(layer: Usd.Stage, prim: Usd.Prim) -> None:
    """Takes from the models that a prim is in what they say of their extent, for it to follow from their meshes."""
    stage = prim.GetStage()
    for path in prim.GetPath().GetPrefixes():
        hint = UsdGeom.ModelAPI(stage.GetPrimAtPath(path)).GetExtentsHintAttr()
        if hint and hint.HasAuthoredValue():
            over = layer.OverridePrim(path)
            over.CreateAttribute(hint.GetName(), hint.GetTypeName(), custom=False).Block()
