"""Cloth, networks and obstacles as things on a page."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..obstacles import MeshObstacle, Obstacle, Plane
from ..render.solids import SolidShape
from ..transforms import apply

GIZMO_SIZE = 0.25  # [m]


class ClothShape:
    """A cloth: a mesh whose vertices move, and dots on it where colours are to show a measure.

    Args:
        server: of the page. name: of the cloth.
        points: vertices [m], shape [n, 3]. triangles: shape [m, 3].
        color: linear red, green, blue.
    """

    def __init__(self, server: Any, name: str, points: np.ndarray, triangles: np.ndarray, color: Any):
        self.mesh = server.scene.add_mesh_simple(f"/cloth/{name}", points, triangles, color=srgb(color), side="double")
        edges = points[triangles] - points[np.roll(triangles, 1, axis=1)]
        self.dots = server.scene.add_point_cloud(
            f"/colors/{name}", points, np.zeros((len(points), 3), np.uint8), point_shape="circle", visible=False,
            point_size=1.5 * float(np.median(np.linalg.norm(edges, axis=2))), point_shading="flat",
        )  # fmt: skip

    def show(self, points: np.ndarray, colors: np.ndarray | None) -> None:
        """Moves it to ``points`` [m], shape [n, 3]; ``colors`` are linear, shape [n, 3], or None for the fabric's."""
        if not np.isfinite(points).all():
            return
        self.mesh.vertices = points
        self.dots.visible = colors is not None
        if colors is not None:
            self.dots.points, self.dots.colors = points, srgb_bytes(colors)


class NetworkShape:
    """Balls and springs of a network.

    Args:
        server: of the page. name: of the network.
        points: balls [m], shape [n, 3]. segments: both ends of each spring [m], shape [s, 2, 3].
        size: of the balls [m].
        colors: of balls and springs, linear.
    """

    def __init__(
        self, server: Any, name: str, points: np.ndarray, segments: np.ndarray, size: float, colors: tuple[Any, Any]
    ):
        balls, springs = (np.array(srgb(color), np.uint8) for color in colors)
        self._balls = server.scene.add_point_cloud(
            f"/network/{name}/balls", points, balls, point_size=size, point_shape="circle", precision="float32"
        )
        self._springs = server.scene.add_line_segments(
            f"/network/{name}/springs", segments.astype(np.float32), springs, thickness=0.25 * size
        )

    def show(self, points: np.ndarray, segments: np.ndarray) -> None:
        """Moves it."""
        if np.isfinite(points).all():
            self._balls.points, self._springs.points = points, segments.astype(np.float32)


class ObstacleShape:
    """An obstacle that rigid motion or sampled points take elsewhere; with ``led``, a gizmo to take it with.

    Args:
        server: of the page. obstacle: what is shown; planes have :func:`add_plane`.
        led: called when somebody has moved the gizmo, with an event.
    """

    def __init__(self, server: Any, obstacle: Obstacle, led: Callable[[Any], None] | None = None):
        scene, name = server.scene, obstacle.name
        self.obstacle, solid = obstacle, SolidShape(obstacle)
        self._frame = scene.add_frame(f"/obstacles/{name}", show_axes=False, position=obstacle.centre)
        self._mesh = scene.add_mesh_simple(
            f"/obstacles/{name}/shape", solid.points - obstacle.centre, solid.triangles, color=srgb(obstacle.color)
        )
        self.gizmo: Any = None
        if led is not None:
            self.gizmo = scene.add_transform_controls(f"/gizmos/{name}", scale=GIZMO_SIZE, visible=False)
            self.gizmo.on_update(led)

    def show(self, center: np.ndarray, turn: np.ndarray) -> None:
        """Puts it at ``center`` [m], turned by a rotation vector [rad]; the gizmo follows unless it is in use."""
        wxyz = quaternion(turn)
        self._frame.position, self._frame.wxyz = center, wxyz
        if self.gizmo is not None and not self.gizmo.visible:
            self.gizmo.position, self.gizmo.wxyz = center, wxyz

    def show_at(self, time: float) -> None:
        """Puts it where its own motion has it at ``time`` [s]."""
        item = self.obstacle
        if isinstance(item, MeshObstacle) and item.sample_times is not None:
            self._mesh.vertices = item.points_at(time) - item.centre
        elif item.motion is not None:
            self.show(apply(item.matrix(time), item.centre[None])[0], item.motion.keys_at(time)[1])


def add_plane(server: Any, plane: Plane) -> None:
    """A grid in a plane, which receives shadows; its name is the obstacle's."""
    z, normal = np.array([0.0, 0.0, 1.0]), np.asarray(plane.normal, float)
    axis = np.cross(z, normal)
    sine = float(np.linalg.norm(axis))
    turn = np.arctan2(sine, normal[2]) / sine * axis if sine > 1e-9 else np.zeros(3)
    server.scene.add_grid(
        f"/obstacles/{plane.name}", plane="xy", position=plane.point, wxyz=quaternion(turn), infinite_grid=True,
        shadow_opacity=0.3,
    )  # fmt: skip


def srgb(color: Any) -> tuple[int, int, int]:
    """A linear colour as three bytes."""
    red, green, blue = (int(channel) for channel in srgb_bytes(np.asarray(color, float)))
    return red, green, blue


def srgb_bytes(colors: np.ndarray) -> np.ndarray:
    """Linear colours as bytes, of the same shape."""
    return np.round(255.0 * np.clip(colors, 0.0, 1.0) ** (1.0 / 2.2)).astype(np.uint8)


def quaternion(turn: np.ndarray) -> tuple[float, float, float, float]:
    """(w, x, y, z) of a rotation vector [rad]."""
    angle = float(np.linalg.norm(turn))
    share = np.sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
    x, y, z = (float(share * component) for component in turn)
    return float(np.cos(0.5 * angle)), x, y, z


def rotation_vector(wxyz: np.ndarray) -> np.ndarray:
    """Rotation vector [rad] of a unit quaternion (w, x, y, z)."""
    w, axis = wxyz[0], np.asarray(wxyz[1:])
    sine = float(np.linalg.norm(axis))
    return 2.0 * np.arctan2(sine, w) / sine * axis if sine > 1e-12 else np.zeros(3)
