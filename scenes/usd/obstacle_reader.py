"""Obstacles from a stage: every prim that UsdPhysics or a cache of ours calls a collider."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics, UsdShade

from ...errors import UsdError
from ...meshes.check import areas_only, without_area
from ...obstacles import Box, Capsule, MeshObstacle, Obstacle, Plane, Sphere
from ...transforms import apply
from .faces import changing_faces, mesh_triangles
from .moving import merged, path_codes
from .opening import world_matrix
from .rigid import ROUND_OFF, Frame, are_rigid, rigid_motion, split, unwound
from .roles import OBSTACLE_ROLE, SIM_API, has_schema, name_of, numbers, role_of
from .skins import FIRST, PointSamples
from .value_types import refuse_other_types

COLUMNS = {"X": 0, "Y": 1, "Z": 2}
SECTIONS = 64  # faces around a cylinder or cone


def read_obstacles(stage: Usd.Stage, origin: float = 0.0) -> list[Obstacle]:
    """The colliders of a stage as obstacles in metres, Z up, with their motion.

    Spheres, capsules, cubes, planes and meshes, and cylinders and cones, which become meshes; of newer kinds those with
    one radius; still, under sampled
    transforms (which become rigid motions with a key per sample), or with sampled points. What our own caches note
    besides (thickness, friction, …) is read too.

    Args:
        stage: any stage.
        origin: time code that is second 0.

    Raises:
        UsdError: on a collider of another kind, or one stretched in a way its kind cannot be; MeshError: on a
            degenerate mesh.
    """
    prims = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
    return [read_obstacle(prim, origin) for prim in prims if is_collider(prim)]


def is_collider(prim: Usd.Prim) -> bool:
    """Whether cloth collides with ``prim``: an obstacle of ours, or an enabled collider that is no cloth itself."""
    role = role_of(prim)
    if role is not None:
        return role == OBSTACLE_ROLE
    cloth = has_schema(prim, SIM_API)
    return prim.IsA(UsdGeom.Gprim) and prim.HasAPI(UsdPhysics.CollisionAPI) and _enabled(prim) and not cloth


def is_collider_group(prim: Usd.Prim) -> bool:
    """Whether ``prim`` is an enabled collider that has no shape itself, as writers make of a whole that has several."""
    shapeless = prim.IsA(UsdGeom.Xformable) and not prim.IsA(UsdGeom.Gprim) and not prim.IsA(UsdGeom.PointInstancer)
    return shapeless and role_of(prim) is None and prim.HasAPI(UsdPhysics.CollisionAPI) and _enabled(prim)


def is_solid(prim: Usd.Prim) -> bool:
    """Whether ``prim`` is of a kind that can be an obstacle, as curves and clouds of points cannot."""
    return any(prim.IsA(kind) for kind in (UsdGeom.Mesh, *_SHAPES, *_SOLIDS))


def _enabled(prim: Usd.Prim) -> bool:
    return UsdPhysics.CollisionAPI(prim).GetCollisionEnabledAttr().Get() is not False


def read_obstacle(prim: Usd.Prim, origin: float = 0.0) -> Obstacle:
    """One prim as an obstacle; arguments and errors as for :func:`read_obstacles`."""
    refuse_other_types(prim)
    common = {"name": name_of(prim), **_material(prim), **numbers(prim, "thickness", "friction", "restitution")}
    color = UsdGeom.Gprim(prim).GetDisplayColorAttr().Get(FIRST)
    if color:
        common["color"] = tuple(float(min(1.0, max(0.0, channel))) for channel in color[0])
    if prim.IsA(UsdGeom.Mesh):
        return _mesh(UsdGeom.Mesh(prim), origin, common)
    for kind, make in _SHAPES.items():
        if prim.IsA(kind):
            codes, seconds = _samples(prim, path_codes(prim), origin)
            rest = world_matrix(prim, _rest_code(prim, codes))
            frame = split(rest)
            matrices = [world_matrix(prim, code) for code in codes]
            if frame is None or not are_rigid(rest, matrices):
                raise _stretched(prim)
            return make(kind(prim), frame, common | {"motion": rigid_motion(rest, seconds, matrices)})
    for kind, maker in _SOLIDS.items():
        if prim.IsA(kind):
            return _solid(kind(prim), maker, origin, common)
    wanted = "a Sphere, Capsule, Cube, Cylinder, Cone, Plane or Mesh"
    raise UsdError(f"Collider {prim.GetPath()} is a {prim.GetTypeName()}, which cannot be an obstacle; use {wanted}.")


def _material(prim: Usd.Prim) -> dict[str, float]:
    """Friction and restitution of the physics material that a collider is bound to."""
    material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")[0]
    if not material or not material.GetPrim().HasAPI(UsdPhysics.MaterialAPI):
        return {}
    refuse_other_types(material.GetPrim())
    physics = UsdPhysics.MaterialAPI(material.GetPrim())
    attributes = {"friction": physics.GetDynamicFrictionAttr(), "restitution": physics.GetRestitutionAttr()}
    return {name: _constant(value) for name, value in attributes.items() if value.HasAuthoredValue()}


def _mesh(mesh: UsdGeom.Mesh, origin: float, common: dict[str, Any]) -> MeshObstacle:
    prim, points = mesh.GetPrim(), PointSamples.of(mesh)
    changing = changing_faces(mesh)
    if changing:
        rule = "an obstacle keeps its faces from beginning to end"
        raise UsdError(f"Collider {prim.GetPath()} has a {changing} that changes over time; {rule}.")
    codes, seconds = _samples(prim, path_codes(prim, deforms=bool(points.codes)) + points.codes, origin)
    rest = points.at(_rest_code(prim, codes))
    if not points.codes:
        return _placed(prim, codes, seconds, rest, mesh_triangles(mesh, rest), common)
    samples = [points.at(code) for code in codes]
    if any(len(sample) != len(rest) for sample in samples):
        raise UsdError(f"Collider {prim.GetPath()} has sampled points of changing number; an obstacle keeps its mesh.")
    return _placed(prim, codes, seconds, rest, mesh_triangles(mesh, rest), common, samples)


def _placed(
    prim: Usd.Prim,
    codes: list[float],
    seconds: np.ndarray,
    local: np.ndarray,
    triangles: np.ndarray,
    common: dict[str, Any],
    samples: Sequence[np.ndarray] | None = None,
) -> MeshObstacle:
    """Triangles over points ``local`` in the frame of a prim, or over ``samples`` of them at ``codes``, as an obstacle.

    It moves rigidly where the prim does and its points are not sampled; everything else becomes sampled points.
    """
    rest, matrices = world_matrix(prim, _rest_code(prim, codes)), [world_matrix(prim, code) for code in codes]
    points = apply(rest, local)
    moved: dict[str, Any]
    if samples is None and (not codes or are_rigid(rest, matrices)):
        moved = {"motion": rigid_motion(rest, seconds, matrices)}
    else:
        every = [local] * len(codes) if samples is None else samples
        baked = np.stack([apply(matrix, sample) for matrix, sample in zip(matrices, every, strict=True)])
        moved = {"sample_times": seconds, "sample_points": baked}
        if without_area(points, triangles).any():  # what is folded up at first may open later
            fullest = int(np.argmin([np.count_nonzero(without_area(sample, triangles)) for sample in baked]))
            points, rest = baked[fullest], matrices[fullest]
    if np.linalg.det(rest[:3, :3]) < 0.0:
        triangles = np.ascontiguousarray(triangles[:, ::-1])
    triangles = areas_only(points, triangles, f"collider {prim.GetPath()}")
    return MeshObstacle(points, triangles, **moved, **common)


def _solid(shape: UsdGeom.Gprim, make: str, origin: float, common: dict[str, Any]) -> MeshObstacle:
    """A cylinder or cone as a mesh, made by the function of that name in ``trimesh.creation``."""
    import trimesh  # takes half a second, which stages without need not wait for

    prim, axis = shape.GetPrim(), _axis(shape)
    solid = getattr(trimesh.creation, make)(_radius(shape), _length(shape, "height"), sections=SECTIONS)
    around = np.array(solid.vertices) - (0.0, 0.0, float(np.mean(solid.bounds[:, 2])))  # trimesh's cone stands at 0
    codes, seconds = _samples(prim, path_codes(prim), origin)
    points = np.roll(around, axis + 1, axis=1)  # z becomes the axis, and the right hand stays the right hand
    return _placed(prim, codes, seconds, points, np.array(solid.faces, np.int32), common)


def _samples(prim: Usd.Prim, codes: list[float], origin: float) -> tuple[list[float], np.ndarray]:
    """Sorted time codes, and their times [s]."""
    ordered = merged(prim.GetStage(), codes)
    return ordered, (np.array(ordered) - origin) / prim.GetStage().GetTimeCodesPerSecond()


def _rest_code(prim: Usd.Prim, codes: list[float]) -> Usd.TimeCode:
    """When the prim is in its initial place: many writers leave the default of what they sample unset, we do not."""
    if role_of(prim):
        return Usd.TimeCode.Default()
    return Usd.TimeCode(codes[0]) if codes else FIRST


def _stretched(prim: Usd.Prim) -> UsdError:
    rule = "make it a mesh, or let its transform only turn and move"
    return UsdError(f"Collider {prim.GetPath()} is a {prim.GetTypeName()} stretched out of its shape; {rule}.")


def _constant(attribute: Usd.Attribute) -> float:
    """The number that an attribute has at all times."""
    codes = attribute.GetTimeSamples() if attribute.ValueMightBeTimeVarying() else [FIRST]
    values = {float(attribute.Get(code)) for code in codes}
    if len(values) > 1:
        what = f"A collider needs a constant {attribute.GetBaseName()}, but {attribute.GetPath()} changes over time"
        raise UsdError(f"{what}; make what deforms a mesh with sampled points.")
    return values.pop()


def _length(shape: UsdGeom.Gprim, name: str) -> float:
    """A radius, height or edge in the shape's own units."""
    value = _constant(shape.GetPrim().GetAttribute(name))
    if not 0.0 < value < np.inf:
        raise UsdError(f"Collider {shape.GetPath()} has a {name} of {value:g}, but must have one above 0.")
    return value


def _radius(shape: UsdGeom.Gprim) -> float:
    """The radius in the shape's own units; newer kinds have one at each end."""
    if not shape.GetPrim().HasAttribute("radiusTop"):
        return _length(shape, "radius")
    top, bottom = _length(shape, "radiusTop"), _length(shape, "radiusBottom")
    if top != bottom:
        what = f"radii of {top:g} at its top and {bottom:g} at its bottom"
        raise UsdError(f"Collider {shape.GetPath()} has {what}, but must have one radius; make it a mesh.")
    return top


def _axis(shape: UsdGeom.Gprim) -> int:
    """Column of a matrix that is the direction of a shape's axis."""
    axis = shape.GetAxisAttr().Get(FIRST)
    if axis not in COLUMNS:
        raise UsdError(f"Collider {shape.GetPath()} has the axis '{axis}', which must be X, Y or Z.")
    return COLUMNS[axis]


def _sphere(shape: UsdGeom.Sphere, frame: Frame, common: dict[str, Any]) -> Sphere:
    return Sphere(frame.origin, _length(shape, "radius") * _uniform(shape, frame), **common)


def _capsule(shape: UsdGeom.Capsule, frame: Frame, common: dict[str, Any]) -> Capsule:
    scale = _uniform(shape, frame)
    half = 0.5 * scale * _length(shape, "height") * frame.rotation[:, _axis(shape)]
    return Capsule(frame.origin - half, frame.origin + half, _radius(shape) * scale, **common)


def _cube(shape: UsdGeom.Cube, frame: Frame, common: dict[str, Any]) -> Box:
    return Box(frame.origin, _length(shape, "size") * frame.scales, unwound([frame.rotation])[0], **common)


def _plane(shape: UsdGeom.Plane, frame: Frame, common: dict[str, Any]) -> Plane:
    return Plane(frame.origin, frame.axes[:, _axis(shape)], **common)


def _uniform(shape: UsdGeom.Gprim, frame: Frame) -> float:
    if np.ptp(frame.scales) > ROUND_OFF * frame.scales.max():
        raise _stretched(shape.GetPrim())
    return float(frame.scales[0])


_SHAPES: dict[type[UsdGeom.Gprim], Callable[..., Obstacle]] = {
    UsdGeom.Sphere: _sphere,
    UsdGeom.Capsule: _capsule,
    UsdGeom.Cube: _cube,
    UsdGeom.Plane: _plane,
}

_SOLIDS: dict[type[UsdGeom.Gprim], str] = {UsdGeom.Cylinder: "cylinder", UsdGeom.Cone: "cone"}
if hasattr(UsdGeom, "Capsule_1"):  # which older versions of OpenUSD do not know
    _SHAPES[UsdGeom.Capsule_1] = _capsule
if hasattr(UsdGeom, "Cylinder_1"):
    _SOLIDS[UsdGeom.Cylinder_1] = "cylinder"
