"""Points of a mesh over time: as sampled, or as a skeleton and blend shapes move them."""

from dataclasses import dataclass

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel, Vt

from ...errors import UsdError
from ...transforms import apply
from .moving import frame_codes, merged, path_codes
from .opening import local_matrix, world_matrix
from .samples import as_vectors, vectors

FIRST = Usd.TimeCode.EarliestTime()  # where a value is sampled but has no default


@dataclass(frozen=True, eq=False)
class PointSamples:
    """The points of a mesh in its own frame and units.

    Attributes:
        mesh: the prim.
        skin: what moves them besides samples of their own, or None.
        codes: time codes at which they are known, if they ever change; in order.
    """

    mesh: UsdGeom.Mesh
    skin: "Skin | None"
    codes: list[float]

    @staticmethod
    def of(mesh: UsdGeom.Mesh) -> "PointSamples":
        """Those of a mesh."""
        attribute, skin = mesh.GetPointsAttr(), Skin.of(mesh)
        sampled = attribute.GetTimeSamples() if attribute.ValueMightBeTimeVarying() else []
        moved = skin.codes() if skin else []
        return PointSamples(mesh, skin, merged(mesh.GetPrim().GetStage(), sampled, moved))

    def at(self, code: Usd.TimeCode | float) -> np.ndarray:
        """Points at a time, shape [n, 3].

        Raises:
            UsdError: the mesh does not fit its skeleton or blend shapes.
        """
        points = as_vectors(self.mesh.GetPointsAttr().Get(code))
        return points if self.skin is None else self.skin.deformed(points, code)


@dataclass(frozen=True, eq=False)
class Skin:
    """What a skeleton does to a mesh.

    Attributes:
        frame: the skeleton where it is in the stage; its query may know it inside a prototype only.
        skeleton: the same with its animation.
        query: how the mesh hangs on it.
    """

    frame: Usd.Prim
    skeleton: UsdSkel.SkeletonQuery
    query: UsdSkel.SkinningQuery

    @staticmethod
    def of(mesh: UsdGeom.Mesh) -> "Skin | None":
        """The skin that a mesh is, or None."""
        root, cache = UsdSkel.Root.Find(mesh.GetPrim()), UsdSkel.Cache()
        if not root:
            return None
        walk = Usd.TraverseInstanceProxies()
        cache.Populate(root, walk)
        for binding in cache.ComputeSkelBindings(root, walk):
            for query in binding.GetSkinningTargets():
                if query.GetPrim() == mesh.GetPrim() and (query.HasJointInfluences() or query.HasBlendShapes()):
                    skeleton = binding.GetSkeleton()
                    return Skin(skeleton.GetPrim(), cache.GetSkelQuery(skeleton), query)
        return None

    def codes(self) -> list[float]:
        """Time codes of the animation, each frame within it, and those of the skeleton's own way."""
        animation = self.skeleton.GetAnimQuery()
        found = path_codes(self.frame) if self.query.HasJointInfluences() else []
        if animation:
            samples = {*animation.GetJointTransformTimeSamples(), *animation.GetBlendShapeWeightTimeSamples()}
            if len(samples) > 1:
                found = [*found, *frame_codes(self.query.GetPrim().GetStage(), sorted(samples))]
        return found

    def deformed(self, points: np.ndarray, code: Usd.TimeCode | float) -> np.ndarray:
        """Points at rest moved by blend shapes, then by the skeleton, shape [n, 3].

        Raises:
            UsdError: they do not fit.
        """
        moved, prim = vectors(points), self.query.GetPrim()
        fits = self._blend(moved, code)
        if not self.query.HasJointInfluences():
            return self._checked(fits, moved)
        joints = self.skeleton.ComputeSkinningTransforms(Usd.TimeCode(code))
        fits = fits and joints is not None and self.query.ComputeSkinnedPoints(joints, moved, Usd.TimeCode(code))
        to_local = local_matrix(prim, code) @ world_matrix(self.frame, code)
        return apply(to_local, self._checked(fits, moved))

    def _blend(self, points: Vt.Vec3fArray, code: Usd.TimeCode | float) -> bool:
        """Moves points in place by the blend shapes there are; whether these fit."""
        animation = self.skeleton.GetAnimQuery()
        if not (animation and self.query.HasBlendShapes()):
            return True
        weights = animation.ComputeBlendShapeWeights(Usd.TimeCode(code))
        mapper = self.query.GetBlendShapeMapper()
        shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(self.query.GetPrim()))
        return weights is None or shapes.ComputeDeformedPoints(
            *shapes.ComputeSubShapeWeights(mapper.Remap(weights) if mapper else weights),
            shapes.ComputeBlendShapePointIndices(),
            shapes.ComputeSubShapePointOffsets(),
            points,
        )

    def _checked(self, fits: bool, points: Vt.Vec3fArray) -> np.ndarray:
        if not fits:
            raise UsdError(f"Mesh {self.query.GetPrim().GetPath()} does not fit the skeleton or blend shapes it has.")
        return as_vectors(points)
