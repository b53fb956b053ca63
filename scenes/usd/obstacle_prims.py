"""Obstacles as prims, so that a cache shows the whole shot and can be checked against it.

Shapes are those of UsdGeom in their own frame, placed by translate, orient and scale. What moves rigidly has its
transform sampled, what deforms its points. Each is a collider of UsdPhysics, to which a plane is a half-space too.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, Vt

from ...obstacles import Box, Capsule, MeshObstacle, Obstacle, Plane, Sphere
from ...transforms import placement
from .mesh_prims import MeshPrim
from .roles import OBSTACLE_ROLE, mark, set_number
from .samples import SAMPLE_OVERHEAD
from .stage import bind_color


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Where the cloth is: centre [m], shape [3], and size [m]. A plane, which is endless, is drawn below it."""

    center: np.ndarray
    size: float


class ObstaclePrim:
    """One obstacle, still or moving, as a prim at ``path``."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, obstacle: Obstacle, surroundings: Surroundings):
        self.obstacle = obstacle
        self.deforming: tuple[MeshObstacle, MeshPrim] | None = None
        if isinstance(obstacle, MeshObstacle):
            sampled = obstacle.sample_times is not None
            self.placement = placement(np.zeros(3) if sampled else obstacle.centre)
            mesh = MeshPrim(stage, path, obstacle.points - self.placement[:3, 3], obstacle.triangles)
            UsdPhysics.MeshCollisionAPI.Apply(mesh.prim).CreateApproximationAttr(UsdPhysics.Tokens.none)
            self.prim = mesh.prim
            self.deforming = (obstacle, mesh) if sampled else None
        else:
            self.prim, self.placement = _SHAPES[type(obstacle)](stage, path, obstacle, surroundings)
        self._create_ops()
        self._annotate()

    def write(self, code: float, time: float) -> int:
        """Sets the pose at ``time`` [s] if it ever changes; returns the bytes held in memory."""
        if not self.obstacle.moves:
            return 0
        if self.deforming:
            obstacle, mesh = self.deforming
            return mesh.set_points(obstacle.points_at(time), code)
        self._set_pose(self.obstacle.matrix(time) @ self.placement, code)
        return 2 * SAMPLE_OVERHEAD

    def drop(self, code: float) -> None:
        """Takes back what was set at time ``code``."""
        self.translate.ClearAtTime(code)
        self.orient.ClearAtTime(code)
        if self.deforming:
            self.deforming[1].drop(code)

    def _create_ops(self) -> None:
        xformable = UsdGeom.Xformable(self.prim)
        self.translate = xformable.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).GetAttr()
        self.orient = xformable.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).GetAttr()
        self.last_quaternion = Gf.Quatd(1.0)
        self._set_pose(self.placement, Usd.TimeCode.Default())
        if isinstance(self.obstacle, Box):
            xformable.AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*self.obstacle.size.tolist()))

    def _set_pose(self, matrix: np.ndarray, code: Usd.TimeCode | float) -> None:
        quaternion = Gf.Matrix3d(*matrix[:3, :3].T.ravel().tolist()).ExtractRotation().GetQuat()
        if Gf.Dot(quaternion, self.last_quaternion) < 0.0:  # q and −q are one rotation; stay on one side
            quaternion = -quaternion
        self.last_quaternion = quaternion
        self.translate.Set(Gf.Vec3d(*matrix[:3, 3].tolist()), code)
        self.orient.Set(quaternion, code)

    def _annotate(self) -> None:
        mark(self.prim, OBSTACLE_ROLE, self.obstacle.name)
        for name in ("thickness", "friction", "restitution"):
            set_number(self.prim, name, getattr(self.obstacle, name))
        bind_color(self.prim, self.obstacle.color, roughness=0.5)
        UsdPhysics.CollisionAPI.Apply(self.prim)
        if not isinstance(self.obstacle, MeshObstacle):
            extent = UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(self.prim), Usd.TimeCode.Default())
            UsdGeom.Boundable(self.prim).CreateExtentAttr(Vt.Vec3fArray(extent))


def _sphere(stage: Usd.Stage, path: Sdf.Path, sphere: Sphere, _: Surroundings) -> tuple[Usd.Prim, np.ndarray]:
    shape = UsdGeom.Sphere.Define(stage, path)
    shape.CreateRadiusAttr(sphere.radius)
    return shape.GetPrim(), placement(sphere.center)


def _capsule(stage: Usd.Stage, path: Sdf.Path, capsule: Capsule, _: Surroundings) -> tuple[Usd.Prim, np.ndarray]:
    shape = UsdGeom.Capsule.Define(stage, path)
    along = capsule.end - capsule.start
    shape.CreateAxisAttr(UsdGeom.Tokens.z)
    shape.CreateRadiusAttr(capsule.radius)
    shape.CreateHeightAttr(float(np.linalg.norm(along)))
    return shape.GetPrim(), _facing(capsule.centre, along)


def _box(stage: Usd.Stage, path: Sdf.Path, box: Box, _: Surroundings) -> tuple[Usd.Prim, np.ndarray]:
    shape = UsdGeom.Cube.Define(stage, path)
    shape.CreateSizeAttr(1.0)  # the edge lengths are a scale
    return shape.GetPrim(), placement(box.center, box.rotation)


def _plane(stage: Usd.Stage, path: Sdf.Path, plane: Plane, around: Surroundings) -> tuple[Usd.Prim, np.ndarray]:
    shape = UsdGeom.Plane.Define(stage, path)
    shape.CreateAxisAttr(UsdGeom.Tokens.z)
    shape.CreateDoubleSidedAttr(True)
    shape.CreateWidthAttr(4.0 * around.size)
    shape.CreateLengthAttr(4.0 * around.size)
    below = around.center - np.dot(around.center - plane.point, plane.normal) * plane.normal
    return shape.GetPrim(), _facing(below, plane.normal)


_SHAPES: dict[type[Obstacle], Callable[[Usd.Stage, Sdf.Path, Any, Surroundings], tuple[Usd.Prim, np.ndarray]]] = {
    Sphere: _sphere,
    Capsule: _capsule,
    Box: _box,
    Plane: _plane,
}


def _facing(position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The 4 × 4 matrix that moves the origin to ``position`` and turns the z axis into ``direction``."""
    turn = Gf.Rotation(Gf.Vec3d(0, 0, 1), Gf.Vec3d(*direction.tolist()))
    return placement(position, np.radians(turn.angle) * np.array(turn.axis))
