"""Obstacles of a scene: one table for each shape."""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import field_validator

from warpcloth import obstacles
from warpcloth.transforms import placement

from .files import MeshPath, PrimPath, mesh_source
from .motion import MotionTable
from .table import Table, field
from .values import (
    ANY_LENGTH,
    FRACTION,
    Color,
    Name,
    Number,
    Point,
    Rows,
    Turn,
    Vector,
    at_least_zero,
    positive,
    refuse,
)


class ObstacleTable(Table):
    """What all obstacles have in common."""

    name: Name | None = field(None, "Name in the USD file; by default the shape, numbered if it occurs again.")
    thickness: Annotated[float, at_least_zero("m", 1.0)] = field(
        0.001, "Distance that cloth is kept from the surface, besides half the fabric's own thickness."
    )
    friction: Annotated[float, at_least_zero("", 10.0)] = field(
        0.5, "Coulomb coefficient; a pair has the geometric mean of the obstacle's and the fabric's."
    )
    restitution: Annotated[float, FRACTION] = field(0.0, "Part of the normal speed that an impact gives back.")
    color: Color = field((0.45, 0.45, 0.48), "Display colour, linear RGB.")
    motion: MotionTable | None = field(None, "Motion along keyframes; without it the obstacle stands still.")

    def build(self, name: str, folder: Path) -> Any:
        """The simulator's obstacle.

        Args:
            name: Name to give it.
            folder: Folder that relative mesh paths start from.
        """
        motion = None if self.motion is None else self.motion.build()
        common = {"name": name, "motion": motion, "color": self.color}
        common |= {key: getattr(self, key) for key in ("thickness", "friction", "restitution")}
        return self.shaped(folder, common)

    def shaped(self, folder: Path, common: dict[str, Any]) -> Any:
        """The obstacle of this shape, given what it has in common with the others."""
        raise NotImplementedError


class PlaneTable(ObstacleTable):
    """An infinite plane; everything below it is solid."""

    shape: Literal["plane"] = field(..., '`"plane"`')
    point: Point = field((0.0, 0.0, 0.0), "A point of the plane.")
    normal: Annotated[tuple[float, float, float], Vector("x y z", Number("", -1e4, 1e4))] = field(
        (0.0, 0.0, 1.0), "Direction out of the solid; of any length but zero."
    )

    def shaped(self, folder: Path, common: dict[str, Any]) -> obstacles.Plane:
        return obstacles.Plane(point=self.point, normal=self.normal, **common)


class SphereTable(ObstacleTable):
    """A ball."""

    shape: Literal["sphere"] = field(..., '`"sphere"`')
    center: Point = field(..., "Centre.")
    radius: Annotated[float, positive("m")] = field(..., "Radius.")

    def shaped(self, folder: Path, common: dict[str, Any]) -> obstacles.Sphere:
        return obstacles.Sphere(center=self.center, radius=self.radius, **common)


class CapsuleTable(ObstacleTable):
    """A cylinder with round ends: all points within a radius of a line segment."""

    shape: Literal["capsule"] = field(..., '`"capsule"`')
    start: Point = field(..., "One end of the segment.")
    end: Point = field(..., "Its other end.")
    radius: Annotated[float, positive("m")] = field(..., "Radius.")

    def shaped(self, folder: Path, common: dict[str, Any]) -> obstacles.Capsule:
        return obstacles.Capsule(start=self.start, end=self.end, radius=self.radius, **common)


class BoxTable(ObstacleTable):
    """A solid box."""

    shape: Literal["box"] = field(..., '`"box"`')
    center: Point = field(..., "Centre.")
    size: Annotated[tuple[float, float, float], Vector("x y z", positive("m"))] = field(..., "Full edge lengths.")
    rotation: Turn = field((0.0, 0.0, 0.0), "Rotation vector (axis times angle) about the centre.")

    def shaped(self, folder: Path, common: dict[str, Any]) -> obstacles.Box:
        return obstacles.Box(center=self.center, size=self.size, rotation=np.radians(self.rotation), **common)


class MeshObstacleTable(ObstacleTable):
    """A triangle mesh read from a file."""

    shape: Literal["mesh"] = field(..., '`"mesh"`')
    path: MeshPath
    prim: PrimPath
    position: Point = field((0.0, 0.0, 0.0), "Where the file's origin goes.")
    rotation: Turn = field((0.0, 0.0, 0.0), "Rotation vector (axis times angle) about the file's origin.")
    scale: Annotated[float, positive("", 1e6)] = field(1.0, "Scale about the file's origin.")

    def shaped(self, folder: Path, common: dict[str, Any]) -> obstacles.MeshObstacle:
        transform = placement(self.position, np.radians(self.rotation), self.scale)
        source = mesh_source(self.path, folder)
        return obstacles.MeshObstacle.from_mesh(source, prim=self.prim, transform=transform, **common)


class LatheTable(ObstacleTable):
    """What a lathe makes: an outline turned about the z axis, such as a funnel, a bowl, a cylinder or a ring."""

    shape: Literal["lathe"] = field(..., '`"lathe"`')
    outline: Annotated[tuple[tuple[float, float], ...], Rows(Vector("radius height", ANY_LENGTH), 3, 10_000)] = field(
        ...,
        "Corners of half the solid's section, in order around it, each by its distance from the axis and its height; "
        "the last is joined to the first. It must not cross itself.",
    )
    segments: Annotated[int, Number("", 3, 10_000, whole=True)] = field(48, "Faces around the axis.")
    position: Point = field((0.0, 0.0, 0.0), "Where the outline's origin goes.")
    rotation: Turn = field((0.0, 0.0, 0.0), "Rotation vector (axis times angle) about the outline's origin.")

    @field_validator("outline")
    @classmethod
    def _on_one_side(cls, outline: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        for index, (radius, _) in enumerate(outline):
            if radius < 0.0:
                raise refuse("must be on one side of the axis", but=f"its item {index} has a radius below 0")
        crossing = _crossing_sides(np.array(outline))
        if crossing is not None:
            raise refuse("must not cross itself", but="its sides from items {} and {} do".format(*crossing))
        corners = np.array(outline)
        (x, z), (u, w) = corners.T, np.roll(corners, -1, axis=0).T
        if abs((x * w - u * z).sum()) <= 1e-12 * np.ptp(corners, axis=0).max() ** 2:
            raise refuse("must go around an area", but="its corners are on one line or it goes there and back")
        return outline

    def shaped(self, folder: Path, common: dict[str, Any]) -> obstacles.MeshObstacle:
        import trimesh  # takes half a second, which scenes without need not wait for

        outline = np.array([*self.outline, self.outline[0]])
        mesh = trimesh.creation.revolve(outline, sections=self.segments)
        if mesh.volume < 0.0:
            mesh.invert()
        transform = placement(self.position, np.radians(self.rotation))
        return obstacles.MeshObstacle.from_mesh(mesh, transform=transform, **common)


def _crossing_sides(outline: np.ndarray) -> tuple[int, int] | None:
    """The first two sides of a closed outline, shape [n, 2], that cross each other, each by its first corner."""
    ends = np.roll(outline, -1, axis=0)
    for side in range(len(outline)):
        a, b, c, d = outline[side], ends[side], outline[side + 1 :], ends[side + 1 :]
        across = (_side_of(a, b, c) * _side_of(a, b, d) < 0.0) & (_side_of(c, d, a) * _side_of(c, d, b) < 0.0)
        if across.any():
            return side, side + 1 + int(np.argmax(across))
    return None


def _side_of(start: np.ndarray, end: np.ndarray, points: np.ndarray) -> np.ndarray:
    """On which side of lines points lie: −1, 0 or 1."""
    along, to = end - start, points - start
    return np.sign(along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0])


OBSTACLES = (PlaneTable, SphereTable, CapsuleTable, BoxTable, LatheTable, MeshObstacleTable)
