"""Meshes of a USD stage. This module imports ``pxr``; import it only to read USD."""

import re
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom, UsdUtils

from ..errors import MeshError
from ..validate import is_utf8
from .check import refuse_non_finite
from .choose import Part, chosen
from .stage_parts import incomplete
from .stage_units import si_matrix, unit_fault
from .trianglemesh import TriangleMesh
from .triangulate import triangulate, without_holes

TIME = Usd.TimeCode.EarliestTime()  # where a value is sampled but has no default


def read_usd(path: Path, prim: str | None, join: bool) -> TriangleMesh:
    """The mesh of a USD stage, polygons triangulated, in metres and Z up, with its texture coordinates.

    References, instances and point instancers are resolved. Invisible meshes and those for guides or proxies are left
    out, unless there are no others or ``prim`` names one.

    Raises:
        MeshError: when the file cannot be read, has no usable units, or refers to what is not there, of which the mesh
            may be part, or when it holds several meshes and none is chosen.
    """
    collected = UsdUtils.CoalescingDiagnosticDelegate()  # keeps warnings about damaged files off stderr
    try:
        return _chosen(path, prim, join)
    except Tf.ErrorException as error:
        raise MeshError(f"The USD file '{path.name}' cannot be read: {_reason(error)}.") from None
    except (UnicodeDecodeError, RuntimeError):  # text of a damaged file, which Python cannot hold
        raise MeshError(f"The USD file '{path.name}' cannot be read: it is damaged.") from None
    finally:
        del collected


def _chosen(path: Path, prim: str | None, join: bool) -> TriangleMesh:
    if not is_utf8(path.absolute()):
        raise MeshError(f"The USD file {str(path.absolute())!r} cannot be read: USD needs a path that is UTF-8 text.")
    stage = Usd.Stage.Open(str(path.absolute()))
    stage.Reload()  # this process may hold an older state of the file
    fault = unit_fault(stage)
    if fault:
        raise MeshError(f"The USD file '{path.name}' cannot be used: {fault}.")
    missing = incomplete(stage, prim and prim.rstrip("/"))
    if missing:
        raise MeshError(f"The USD file '{path.name}' is incomplete: {missing}.")
    cache = UsdGeom.XformCache(TIME)
    parts, shown = [], []
    for mesh, matrix in _meshes_below(stage.GetPseudoRoot(), cache):
        where = str(mesh.GetPath())
        part = Part(where, partial(_placed, mesh, where.rsplit("/", 1)[-1], si_matrix(stage) @ matrix))
        parts.append(part)
        if is_shown(mesh):
            shown.append(part)
    return chosen(shown if shown and prim is None else parts, path.stem, prim, join)


def _reason(error: Tf.ErrorException) -> str:
    """The first thing USD complains about, without the places in its source."""
    try:
        said = re.findall(r" : '([^\n]*)", str(error))
    except UnicodeDecodeError:
        said = []
    telling = [line.rstrip("' .") for line in said if not line.startswith("Failed to open layer")]
    return telling[0] if telling else "it is damaged or not USD"


def _meshes_below(
    top: Usd.Prim, cache: UsdGeom.XformCache, above: tuple[Sdf.Path, ...] = ()
) -> Iterator[tuple[UsdGeom.Mesh, np.ndarray]]:
    """Every mesh with its 4 × 4 matrix to the frame of ``top``, once for each instance.

    Args:
        top: the root, or the prototype of a point instancer.
        cache: of transforms.
        above: paths of the point instancers that scatter it.
    """
    walk = iter(Usd.PrimRange(top, Usd.TraverseInstanceProxies()))
    for prim in walk:
        if prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()
            for mesh, matrix in _scattered_meshes(UsdGeom.PointInstancer(prim), cache, above):
                yield mesh, _matrix_to(top, prim, cache) @ matrix
        elif prim.IsA(UsdGeom.Mesh):
            yield UsdGeom.Mesh(prim), _matrix_to(top, prim, cache)


def _matrix_to(top: Usd.Prim, prim: Usd.Prim, cache: UsdGeom.XformCache) -> np.ndarray:
    """From the frame of ``prim`` to that of ``top``, which it is or is below, 4 × 4."""
    if prim == top:
        return np.eye(4)
    far = cache.GetLocalToWorldTransform(prim) if top.IsPseudoRoot() else cache.ComputeRelativeTransform(prim, top)[0]
    return _columns(far)


def _scattered_meshes(
    scatter: UsdGeom.PointInstancer, cache: UsdGeom.XformCache, above: tuple[Sdf.Path, ...]
) -> Iterator[tuple[UsdGeom.Mesh, np.ndarray]]:
    """What a point instancer scatters, with matrices to its own frame."""
    prototypes = [scatter.GetPrim().GetStage().GetPrimAtPath(p) for p in scatter.GetPrototypesRel().GetTargets()]
    which = scatter.GetProtoIndicesAttr().Get(TIME) or []
    _check_scatter(scatter, prototypes, which)
    if scatter.GetPath() in above:
        raise MeshError(f"The point instancer {scatter.GetPath()} scatters itself.")
    transforms = scatter.ComputeInstanceTransformsAtTime(TIME, TIME, applyMask=UsdGeom.PointInstancer.IgnoreMask)
    mask = scatter.ComputeMaskAtTime(TIME) or [True] * len(transforms)
    for index, transform, visible in zip(which, transforms, mask, strict=True):
        if visible:
            for mesh, local in _meshes_below(prototypes[index], cache, (*above, scatter.GetPath())):
                yield mesh, _columns(transform) @ local


def _check_scatter(scatter: UsdGeom.PointInstancer, prototypes: Sequence[Usd.Prim], which: Sequence[int]) -> None:
    """Whether each instance has a place, and a prototype that there is."""
    label = f"The point instancer {scatter.GetPath()}"
    ids = scatter.GetIdsAttr().Get(TIME)
    sizes = {"positions": len(scatter.GetPositionsAttr().Get(TIME) or [])} | ({"ids": len(ids)} if ids else {})
    for name, size in sizes.items():
        if size != len(which):
            raise MeshError(f"{label} has {len(which)} protoIndices but {size} {name}; it needs as many of each.")
    for index in set(which):
        if not 0 <= index < len(prototypes):
            raise MeshError(f"{label} refers to prototype {index}, but has {len(prototypes)}, counted from 0.")
        if not prototypes[index]:
            path = scatter.GetPrototypesRel().GetTargets()[index]
            raise MeshError(f"{label} refers to the prototype {path}, which does not exist.")


def _placed(mesh: UsdGeom.Mesh, name: str, matrix: np.ndarray) -> TriangleMesh:
    return prim_mesh(mesh, name).transformed(matrix)


def prim_mesh(mesh: UsdGeom.Mesh, name: str) -> TriangleMesh:
    """A mesh prim in its own frame and units, polygons triangulated, holes left out, with all of its points.

    Raises:
        MeshError: on points that are not finite, no faces, or faces that do not fit the points.
    """
    points = _numbers(mesh.GetPointsAttr(), float).reshape(-1, 3)
    counts = _numbers(mesh.GetFaceVertexCountsAttr(), np.int64)
    corners = _numbers(mesh.GetFaceVertexIndicesAttr(), np.int64)
    _check_faces(name, points, counts, corners)
    cuts = without_holes(triangulate(points, counts, corners), counts, _numbers(mesh.GetHoleIndicesAttr(), np.int64))
    uvs, uv_of_corner = _texture_coordinates(mesh, points, corners)
    result = TriangleMesh(points, corners[cuts], uvs, None if uvs is None else uv_of_corner[cuts], name)
    return result.flipped() if _value(mesh.GetOrientationAttr(), "") == UsdGeom.Tokens.leftHanded else result


def _check_faces(name: str, points: np.ndarray, counts: np.ndarray, corners: np.ndarray) -> None:
    label = f"Mesh '{name}'"
    if len(points) == 0 or len(counts) == 0:
        raise MeshError(f"{label} is empty: it has {len(points)} vertices and {len(counts)} faces.")
    refuse_non_finite(points, label)
    small = np.flatnonzero(counts < 3)
    if small.size:
        raise MeshError(f"{label}: face {small[0]} has {counts[small[0]]} corners, but needs 3 or more.")
    if counts.sum() != len(corners):
        raise MeshError(f"{label}: its faces have {counts.sum()} corners, but {len(corners)} vertex indices are given.")
    outside = np.flatnonzero((corners < 0) | (corners >= len(points)))
    if outside.size:
        bad = corners[outside[0]]
        raise MeshError(f"{label}: a face refers to vertex {bad}, which is not one of 0 to {len(points) - 1}.")


def _texture_coordinates(mesh: UsdGeom.Mesh, points: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray | None, Any]:
    """Values (k, 2) of ``st``, or of the first other set, and which of them each face corner has; or (None, None)."""
    sets = [p for p in UsdGeom.PrimvarsAPI(mesh.GetPrim()).FindPrimvarsWithInheritance() if _is_texture(p)]
    for primvar in sorted(sets, key=lambda p: p.GetPrimvarName() != "st"):
        values = np.array(primvar.Get(TIME) if primvar.Get() is None else primvar.Get(), float)
        indices = np.array(primvar.GetIndices(TIME), np.int64) if primvar.IsIndexed() else np.arange(len(values))
        per_corner = primvar.GetInterpolation() == UsdGeom.Tokens.faceVarying
        if len(indices) != (len(corners) if per_corner else len(points)):
            continue
        of_corner = indices if per_corner else indices[corners]
        if np.all((of_corner >= 0) & (of_corner < len(values))) and np.isfinite(values).all():
            return values[:, :2], of_corner
    return None, None


def _is_texture(primvar: UsdGeom.Primvar) -> bool:
    role, name = str(primvar.GetTypeName()), primvar.GetPrimvarName()
    spread = (UsdGeom.Tokens.faceVarying, UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying)
    pairs = role.startswith("texCoord") or (role.startswith("float2") and name.startswith(("st", "uv", "UV")))
    return pairs and role.endswith("[]") and primvar.HasValue() and primvar.GetInterpolation() in spread


def is_shown(shape: UsdGeom.Imageable) -> bool:
    """Whether a shape is in final pictures: visible, and neither a guide nor a proxy."""
    purpose = shape.ComputePurpose()
    return purpose in (UsdGeom.Tokens.default_, UsdGeom.Tokens.render) and (
        shape.ComputeVisibility(TIME) != UsdGeom.Tokens.invisible
    )


def _value(attribute: Usd.Attribute, otherwise: Any) -> Any:
    """The default value, or the first sample where there is none."""
    value = attribute.Get()
    value = attribute.Get(TIME) if value is None else value
    return otherwise if value is None else value


def _numbers(attribute: Usd.Attribute, dtype: type) -> np.ndarray:
    """The value as an array; empty where there is none."""
    try:
        return np.array(_value(attribute, []), dtype)
    except (TypeError, ValueError):
        name, owner = attribute.GetName(), attribute.GetPrim().GetName()
        raise MeshError(f"Mesh '{owner}': its {name} are no list of numbers.") from None


def _columns(matrix: Any) -> np.ndarray:
    """A Gf matrix, which multiplies row vectors, in the convention of column vectors."""
    return np.array(matrix).T
