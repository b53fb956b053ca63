"""Pins of a cloth in a stage: subsets of its mesh, or a primvar; they follow the animation that the mesh comes with."""

from dataclasses import dataclass

import numpy as np
from pxr import UsdGeom

from warpcloth.cloth import PinSpec
from warpcloth.errors import UsdError
from warpcloth.motion import Motion
from warpcloth.transforms import apply

from ..usd.moving import merged, path_codes
from ..usd.opening import world_matrix
from ..usd.rigid import are_rigid, rigid_motion
from ..usd.skins import FIRST, PointSamples
from ..usd.value_types import refuse_other_types
from .motions import noted_motion

FAMILY = "pins"
PRIMVARS = ("pins", "pintoanimation")  # ours, and Houdini's
HELD = 0.5  # of a primvar, from which on a point is held


@dataclass(frozen=True, eq=False)
class MeshAnimation:
    """How a mesh moves by itself in its stage.

    Attributes:
        mesh: it.
        start: time code of second 0.
        codes: time codes at which its points or its transform are sampled, in order; none if it stands still.
        source: its points in its own frame.
    """

    mesh: UsdGeom.Mesh
    start: float
    codes: list[float]
    source: PointSamples

    @staticmethod
    def of(mesh: UsdGeom.Mesh, start: float) -> "MeshAnimation":
        """That of a mesh."""
        source = PointSamples.of(mesh)
        path = path_codes(mesh.GetPrim(), deforms=bool(source.codes))
        codes = merged(mesh.GetPrim().GetStage(), path, source.codes)
        return MeshAnimation(mesh, start, codes, source)

    def points(self, code: float) -> np.ndarray:
        """World positions [m] of the mesh's points, shape [n, 3].

        Raises:
            UsdError: their number changes, or they are not finite.
        """
        values = self.source.at(code if self.source.codes else FIRST)
        count = len(self.mesh.GetPointsAttr().Get(FIRST) or ())
        where = f"Cloth {self.mesh.GetPath()} has"
        if len(values) != count:
            raise UsdError(
                f"{where} {count} points at first but {len(values)} at time code {code:g}; cloth keeps its mesh."
            )
        if not np.isfinite(values).all():
            raise UsdError(f"{where} points that are not finite numbers at time code {code:g}.")
        return apply(world_matrix(self.mesh.GetPrim(), code), values)

    def motions(self, indices: np.ndarray, first: np.ndarray) -> list[PinSpec]:
        """Pins at ``indices`` that follow it from where they are ``first`` [m], shape [k, 3]."""
        prim = self.mesh.GetPrim()
        if not self.codes:
            return [PinSpec(indices)]
        seconds = (np.array(self.codes) - self.start) / prim.GetStage().GetTimeCodesPerSecond()
        matrices = [world_matrix(prim, code) for code in self.codes]
        rest = world_matrix(prim, self.start)
        if not self.source.codes and are_rigid(rest, matrices):
            return [PinSpec(indices, rigid_motion(rest, seconds, matrices))]
        paths = np.stack([self.points(code)[indices] for code in self.codes], axis=1) - first[:, None]
        still = np.zeros((len(seconds), 3))
        return [PinSpec([i], Motion(seconds, path, still)) for i, path in zip(indices.tolist(), paths, strict=True)]


def read_pins(animation: MeshAnimation, first: np.ndarray, particle_of: np.ndarray) -> list[PinSpec]:
    """The pins of a mesh.

    Args:
        animation: of the mesh.
        first: world positions of its points at the start [m], shape [n, 3].
        particle_of: particle of each of its points, −1 for none, shape [n].

    Raises:
        UsdError: they refer to points that do not exist.
    """
    mesh = animation.mesh
    following, led = [_primvar_pins(mesh, len(first))], []
    for subset in UsdGeom.Subset.GetAllGeomSubsets(mesh):
        if subset.GetFamilyNameAttr().Get() == FAMILY or subset.GetPrim().GetName() == FAMILY:
            refuse_other_types(subset.GetPrim())
            indices = _subset_points(mesh, subset, len(first))
            motion = noted_motion(subset.GetPrim(), world_matrix(mesh.GetPrim(), animation.start))
            if motion is None:
                following.append(indices)
            else:
                led.append(PinSpec(_particles(indices, particle_of), motion))
    held = np.unique(np.concatenate(following))
    held = held[particle_of[held] >= 0]
    if held.size == 0:
        return led
    _, once = np.unique(particle_of[held], return_index=True)
    pins = animation.motions(held[once], first[held[once]])
    return [PinSpec(_particles(np.atleast_1d(pin.select), particle_of), pin.motion) for pin in pins] + led


def _particles(points: np.ndarray, particle_of: np.ndarray) -> np.ndarray:
    found = np.unique(particle_of[points])
    return found[found >= 0]


def _primvar_pins(mesh: UsdGeom.Mesh, count: int) -> np.ndarray:
    """Points at which a primvar of pins is at least one half."""
    held = np.zeros(count, bool)
    for name in PRIMVARS:
        primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(name)
        if not primvar or not primvar.HasAuthoredValue():
            continue
        first, *later = (_weights(mesh, primvar, code, count) >= HELD for code in _codes(primvar))
        if any(not np.array_equal(first, other) for other in later):
            rule = "pins hold from beginning to end"
            raise UsdError(f"Cloth {mesh.GetPath()} has primvars:{name} that hold other points later; {rule}.")
        held |= first
    return np.flatnonzero(held)


def _codes(primvar: UsdGeom.Primvar) -> list[float]:
    """Time codes at which a primvar may have different values."""
    return (primvar.GetTimeSamples() if primvar.ValueMightBeTimeVarying() else []) or [FIRST]


def _weights(mesh: UsdGeom.Mesh, primvar: UsdGeom.Primvar, code: float, count: int) -> np.ndarray:
    """A primvar's value at each point, shape [count]; 0 where it has none.

    Of values for each face, or for each of its corners, a point has the largest.
    """
    where, values = f"Cloth {mesh.GetPath()} has", primvar.ComputeFlattened(code)
    weights = np.atleast_1d(np.array([0.0] if values is None else values))
    if weights.ndim > 1 or weights.dtype.kind not in "biuf":
        raise UsdError(f"{where} {primvar.GetName()} of type {primvar.GetTypeName()}, but pins are numbers.")
    if weights.shape == (1,):  # for all, whatever it is said to be of
        return np.full(count, float(weights[0]))
    counts, corners = _faces(mesh)
    sizes = {"uniform": ("face", len(counts)), "faceVarying": ("corner of a face", len(corners))}
    each, wanted = sizes.get(primvar.GetInterpolation(), ("point", count))
    if weights.shape != (wanted,):
        raise UsdError(
            f"{where} {len(weights)} values of {primvar.GetName()}, but needs one for each {each}: {wanted}."
        )
    if each == "point":
        return weights.astype(float)
    largest = np.full(count, -np.inf)
    np.maximum.at(largest, corners, np.repeat(weights, counts) if each == "face" else weights)
    return largest


def _subset_points(mesh: UsdGeom.Mesh, subset: UsdGeom.Subset, count: int) -> np.ndarray:
    """Points of a subset of points or faces."""
    where = subset.GetPath()
    indices = np.array(subset.GetIndicesAttr().Get(FIRST) or [], np.int64)
    kind, (counts, corners) = subset.GetElementTypeAttr().Get(), _faces(mesh)
    if kind == UsdGeom.Tokens.face:
        limit = len(counts)
    elif kind == UsdGeom.Tokens.point:
        limit = count
    else:
        raise UsdError(f"The pins {where} are a subset of {kind}s; make it one of points or faces.")
    wrong = indices[(indices < 0) | (indices >= limit)]
    if wrong.size:
        raise UsdError(f"The pins {where} name {kind} {wrong[0]}, which is not one of 0 to {limit - 1}.")
    if kind == UsdGeom.Tokens.point:
        return np.unique(indices)
    return np.unique(corners[np.isin(np.repeat(np.arange(limit), counts), indices)])


def _faces(mesh: UsdGeom.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Corners of each face, and the point of each corner."""
    attributes = (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
    counts, corners = (np.array(attribute.Get(FIRST), np.int64) for attribute in attributes)
    return counts, corners
