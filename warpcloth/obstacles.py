"""Obstacles: what cloth collides with, still or moving."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from . import validate
from .errors import InputError
from .meshes import load_mesh, obstacle_mesh
from .meshes.check import check_areas, checked_arrays
from .meshes.openings import has_inside
from .motion import Motion
from .transforms import apply, as_matrix
from .validate import Array, ReadOnly


@dataclass(frozen=True, eq=False, kw_only=True)
class Obstacle(ReadOnly):
    """What all obstacles have in common.

    Args:
        name: for people, reports and the USD prim.
        thickness: rest distance kept above the surface [m], >= 0; cloth adds half of its own.
        friction: Coulomb coefficient, >= 0; a pair has the geometric mean of its two.
        restitution: share of the approach speed that is returned, 0 to 1.
        motion: rigid motion, or None when still.
        color: linear red, green, blue in [0, 1].

    Raises:
        InputError: on a value out of range.
    """

    name: str = "obstacle"
    thickness: float = 0.001
    friction: float = 0.5
    restitution: float = 0.0
    motion: Motion | None = None
    color: tuple[float, float, float] = (0.35, 0.37, 0.42)

    def __post_init__(self):
        label = self._label
        self._set(
            thickness=validate.number(self.thickness, f"{label}: thickness", minimum=0.0),
            friction=validate.number(self.friction, f"{label}: friction", minimum=0.0),
            restitution=validate.number(self.restitution, f"{label}: restitution", minimum=0.0, maximum=1.0),
            color=validate.color(self.color, f"{label}: color"),
        )
        if self.motion is not None and not isinstance(self.motion, Motion):
            kind = type(self.motion).__name__
            raise InputError(f"{validate.sentence(label)}: motion must be a Motion or None, got {kind}.")

    @property
    def centre(self) -> np.ndarray:
        """The point that a motion without a pivot turns about [m], shape [3]."""
        raise NotImplementedError

    @property
    def moves(self) -> bool:
        """Whether the obstacle is ever anywhere but in its initial place."""
        return self.motion is not None and self.motion.moves

    @property
    def solid(self) -> bool:
        """Whether it has an inside."""
        return True

    def matrix(self, t: float) -> np.ndarray:
        """The 4 × 4 matrix that takes the initial placement to time ``t`` [s]."""
        return np.eye(4) if self.motion is None else self.motion.matrix(t, self.centre)

    @property
    def _label(self) -> str:
        kind = type(self).__name__.lower().removesuffix("obstacle")
        return f"{kind} '{validate.text(self.name, f'{kind}: name')}'"

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)


@dataclass(frozen=True, eq=False)
class Plane(Obstacle):
    """The half-space below a plane through ``point`` [m] with outward ``normal`` (normalised on construction)."""

    point: Array = (0.0, 0.0, 0.0)
    normal: Array = (0.0, 0.0, 1.0)
    name: str = field(default="plane", kw_only=True)

    def __post_init__(self):
        super().__post_init__()
        normal = validate.vector(self.normal, f"{self._label}: normal")
        length = np.linalg.norm(normal)
        if length == 0.0:
            raise InputError(f"{validate.sentence(self._label)}: normal must not be zero.")
        self._set(
            point=validate.vector(self.point, f"{self._label}: point"),
            normal=validate.vector(normal / length, f"{self._label}: normal"),
        )

    @property
    def centre(self) -> np.ndarray:
        return self.point


@dataclass(frozen=True, eq=False)
class Sphere(Obstacle):
    """A ball with ``center`` [m] and ``radius`` [m]."""

    center: Array = (0.0, 0.0, 0.0)
    radius: float = 0.5
    name: str = field(default="sphere", kw_only=True)

    def __post_init__(self):
        super().__post_init__()
        self._set(
            center=validate.vector(self.center, f"{self._label}: center"),
            radius=validate.number(self.radius, f"{self._label}: radius", above=0.0),
        )

    @property
    def centre(self) -> np.ndarray:
        return self.center


@dataclass(frozen=True, eq=False)
class Capsule(Obstacle):
    """All points within ``radius`` [m] of the segment from ``start`` to ``end`` [m]."""

    start: Array = (0.0, 0.0, -0.5)
    end: Array = (0.0, 0.0, 0.5)
    radius: float = 0.25
    name: str = field(default="capsule", kw_only=True)

    def __post_init__(self):
        super().__post_init__()
        self._set(
            start=validate.vector(self.start, f"{self._label}: start"),
            end=validate.vector(self.end, f"{self._label}: end"),
            radius=validate.number(self.radius, f"{self._label}: radius", above=0.0),
        )
        if np.array_equal(self.start, self.end):
            raise InputError(f"{validate.sentence(self._label)}: start and end coincide; use a Sphere instead.")

    @property
    def centre(self) -> np.ndarray:
        return 0.5 * (self.start + self.end)


@dataclass(frozen=True, eq=False)
class Box(Obstacle):
    """A box with ``center`` [m], full edge lengths ``size`` [m], turned by the rotation vector ``rotation`` [rad]."""

    center: Array = (0.0, 0.0, 0.0)
    size: Array = (1.0, 1.0, 1.0)
    rotation: Array = (0.0, 0.0, 0.0)
    name: str = field(default="box", kw_only=True)

    def __post_init__(self):
        super().__post_init__()
        size = validate.vector(self.size, f"{self._label}: size")
        if size.min() <= 0.0:
            raise InputError(
                f"{validate.sentence(self._label)}: size must be three lengths greater than 0, got {size}."
            )
        self._set(
            center=validate.vector(self.center, f"{self._label}: center"),
            size=size,
            rotation=validate.vector(self.rotation, f"{self._label}: rotation"),
        )

    @property
    def centre(self) -> np.ndarray:
        return self.center


@dataclass(frozen=True, eq=False)
class MeshObstacle(Obstacle):
    """A triangle mesh, still, in rigid motion, or deforming along sampled points.

    A mesh with small holes, as scans have them, is solid: cloth must not start in it. One whose openings would take up
    more than a tenth of it when closed is a shell, such as a bowl: cloth may lie in it.

    Args:
        points: initial vertices [m], shape [n, 3].
        triangles: vertex indices, counter-clockwise seen from outside, shape [m, 3]; any set of triangles with area.
        sample_times: times of the samples [s], shape [k], strictly increasing.
        sample_points: vertices at those times [m], shape [k, n, 3]; linear in between, held outside.

    Raises:
        InputError: on values out of range; MeshError: on an empty, non-finite or degenerate mesh.
    """

    points: Array = ()
    triangles: Array = ()
    sample_times: Array = None
    sample_points: Array = None
    name: str = field(default="mesh", kw_only=True)

    def __post_init__(self):
        super().__post_init__()
        points, triangles = checked_arrays(self.points, self.triangles, self._label)
        check_areas(points, triangles, self._label)
        self._set(points=points, triangles=triangles)
        if self.sample_times is not None or self.sample_points is not None:
            self._check_samples()

    @staticmethod
    def from_mesh(
        source: Any, prim: str | None = None, transform: Any = None, name: str | None = None, **options: Any
    ) -> "MeshObstacle":
        """An obstacle from a mesh file, an asset name such as ``"warp:bunny.usd"``, or a ``trimesh.Trimesh``.

        Args:
            source: path, asset name, ``trimesh.Trimesh`` or ``TriangleMesh``.
            prim: path or name of a mesh, or of a parent of some, in a USD or glTF file; None: all meshes, joined.
            transform: 4 × 4 matrix, which may scale, or translation [m].
            name: defaults to the name of the file or prim.
            options: the fields common to all obstacles.

        Raises:
            MeshError: when the mesh cannot be read, is empty, or has no triangle with area. Triangles without are left
                out with a :class:`warpcloth.errors.MeshWarning`.
        """
        mesh = load_mesh(source, prim=prim, join=True)
        mesh = obstacle_mesh(mesh.transformed(as_matrix(transform, f"{mesh.label}: transform")))
        return MeshObstacle(mesh.points, mesh.triangles, name=mesh.name if name is None else name, **options)

    @property
    def centre(self) -> np.ndarray:
        return 0.5 * (self.points.min(axis=0) + self.points.max(axis=0))

    @property
    def solid(self) -> bool:
        return has_inside(self.points, self.triangles)

    @property
    def moves(self) -> bool:
        return self.sample_times is not None or super().moves

    def points_at(self, t: float) -> np.ndarray:
        """Vertices at time ``t`` [s], shape [n, 3]."""
        if self.sample_times is None or self.sample_points is None:
            return self.points if self.motion is None else apply(self.matrix(t), self.points)
        last = len(self.sample_times) - 1
        index = int(np.clip(np.searchsorted(self.sample_times, t, side="right") - 1, 0, max(0, last - 1)))
        if last == 0:
            return self.sample_points[0]
        begin, end = self.sample_times[index], self.sample_times[index + 1]
        u = float(np.clip((t - begin) / (end - begin), 0.0, 1.0))
        return (1.0 - u) * self.sample_points[index] + u * self.sample_points[index + 1]

    def _check_samples(self) -> None:
        label = validate.sentence(self._label)
        if self.sample_times is None or self.sample_points is None:
            raise InputError(f"{label}: sample_times and sample_points must be given together.")
        if self.motion is not None:
            raise InputError(f"{label}: give either a motion or sampled points, not both.")
        times = validate.array(self.sample_times, f"{self._label}: sample_times", (None,))
        if times.size == 0 or np.any(np.diff(times) <= 0.0):
            raise InputError(f"{label}: sample_times must be at least one time and strictly increase.")
        shape = (times.size, len(self.points), 3)
        self._set(
            sample_times=times,
            sample_points=validate.array(self.sample_points, f"{self._label}: sample_points", shape),
        )
