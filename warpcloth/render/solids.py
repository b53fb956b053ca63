"""Obstacles, floor and networks as surfaces, fine enough that light gathered at vertices shows their shadows."""

from collections.abc import Callable, Sequence

import numpy as np
import trimesh

from ..obstacles import Box, Capsule, MeshObstacle, Obstacle, Plane, Sphere
from ..scenes.usd.surface import vertex_normals
from ..transforms import apply, rotation_matrix
from .surface import Surface

BOX_CELLS = 32  # along the longest edge
FLOOR_CELLS = 96  # across the part of the floor where shadows fall
UNEVEN = 0.03  # difference of light between corners of a cell that makes it one at such an edge
FLOOR_REACH = 60.0  # of the scene's size

Color = Sequence[float]


class SolidShape:
    """An obstacle as a surface in its initial place, and its motion; planes are not solids but floors."""

    def __init__(self, obstacle: Obstacle):
        self.obstacle = obstacle
        self.triangles, self.points = _triangulated(obstacle)
        _, self._place = np.unique(np.round(self.points, 9), axis=0, return_inverse=True)

    def place(self, time: float, inset: float = 0.0) -> Surface:
        """The surface at ``time`` [s], drawn smaller by ``inset`` [m] on all sides."""
        item = self.obstacle
        points = item.points_at(time) if isinstance(item, MeshObstacle) else apply(item.matrix(time), self.points)
        normals = vertex_normals(points, self.triangles)
        if inset > 0.0:
            points = points - inset * self._joined(normals)
        return Surface(points, normals, self.triangles, np.array(item.color, float), gloss=0.25)

    def _joined(self, normals: np.ndarray) -> np.ndarray:
        """Normals that are the same for vertices in one place, so that sharp edges do not come apart."""
        place = self._place.ravel()
        total = np.stack([np.bincount(place, column) for column in normals.T], axis=1)[place]
        return total / np.linalg.norm(total, axis=1, keepdims=True).clip(1e-12)


def _triangulated(obstacle: Obstacle) -> tuple[np.ndarray, np.ndarray]:
    """Triangles and points of an obstacle in its initial place."""
    if isinstance(obstacle, MeshObstacle):
        return np.asarray(obstacle.triangles), np.asarray(obstacle.points)
    if isinstance(obstacle, Sphere):
        ball = trimesh.creation.icosphere(subdivisions=5, radius=obstacle.radius)
        return np.asarray(ball.faces), np.asarray(ball.vertices) + obstacle.center
    if isinstance(obstacle, Capsule):
        along = obstacle.end - obstacle.start
        pill = trimesh.creation.capsule(height=float(np.linalg.norm(along)), radius=obstacle.radius, count=[64, 64])
        turn = trimesh.geometry.align_vectors((0.0, 0.0, 1.0), along)
        centred = pill.vertices - 0.5 * (pill.vertices.min(axis=0) + pill.vertices.max(axis=0))
        return np.asarray(pill.faces), apply(turn, centred) + obstacle.centre
    if isinstance(obstacle, Box):
        triangles, points = _box(obstacle.size)
        return triangles, points @ rotation_matrix(obstacle.rotation).T + obstacle.center
    raise TypeError(f"no drawing of {type(obstacle).__name__}")


def _box(size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A box about the origin as six grids that share no vertices, so that edges stay sharp; triangles and points."""
    all_points, all_triangles, first = [], [], 0
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        cells = [max(1, round(BOX_CELLS * size[k] / size.max())) for k in (u, v)]
        flat, faces = grid(np.linspace(-0.5, 0.5, cells[0] + 1), np.linspace(-0.5, 0.5, cells[1] + 1))
        for side in (-0.5, 0.5):
            points = np.zeros((len(flat), 3))
            points[:, axis], points[:, u], points[:, v] = side, flat[:, 0], flat[:, 1]
            all_points.append(points * size)
            all_triangles.append((faces if side > 0 else faces[:, ::-1]) + first)
            first += len(points)
    return np.concatenate(all_triangles), np.concatenate(all_points)


def grid(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2) of a grid with these lines, x first, and its triangles, counter-clockwise."""
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    number = np.arange(len(points)).reshape(len(y), len(x))
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


class Floor:
    """A floor that reaches to the horizon, with a fine grid where shadows fall.

    Args:
        center: middle of that part [m], shape [3]. radius: its extent [m].
        normal: of the floor.
        albedo: linear colour.
        split: parts of a cell at the edge of shadows, along each side.
    """

    def __init__(self, center: np.ndarray, radius: float, normal: np.ndarray, albedo: np.ndarray, split: int):
        far = radius * np.geomspace(1.0, FLOOR_REACH, 24)[1:]
        near = [np.linspace(-radius, radius, cells + 1) for cells in (FLOOR_CELLS, FLOOR_CELLS * split)]
        self.coarse, lines = (np.concatenate([-far[::-1], middle, far]) for middle in near)
        self.side = len(lines)
        turn = trimesh.geometry.align_vectors((0.0, 0.0, 1.0), normal)[:3, :3]
        flat, triangles = grid(lines, lines)
        points = np.column_stack([flat, np.zeros(len(flat))]) @ turn.T + center
        self.surface = Surface(points, np.tile(normal, (len(flat), 1)), triangles, np.array(albedo, float))
        self.lines = lines
        on_coarse = np.isin(np.round(lines / radius, 9), np.round(self.coarse / radius, 9))
        self.sparse = np.flatnonzero(np.outer(on_coarse, on_coarse).ravel())

    def light(self, gather: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
        """Light at all points: gathered on a coarse grid first, and between its points only where they differ."""
        surface, count = self.surface, len(self.coarse)
        known = gather(surface.points[self.sparse], surface.normals[self.sparse]).reshape(count, count, 3)
        place = np.interp(self.lines, self.coarse, np.arange(count))
        low = np.minimum(place.astype(int), count - 2)
        share = place - low
        corners = [known[np.ix_(low + j, low + i)] for j in (0, 1) for i in (0, 1)]
        x, y = share[None, :, None], share[:, None, None]
        weights = [(1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x]
        light = sum(w * c for w, c in zip(weights, corners, strict=True)).reshape(-1, 3)
        uneven = np.ptp(np.stack(corners), axis=0).max(axis=2).ravel() > UNEVEN
        uneven[self.sparse] = False
        if uneven.any():
            light[uneven] = gather(surface.points[uneven], surface.normals[uneven])
        return _blurred(light.reshape(self.side, self.side, 3)).reshape(-1, 3)


def _blurred(values: np.ndarray) -> np.ndarray:
    """The mean with the neighbours on a grid, which takes the steps off the outlines of shadows."""
    for axis in (0, 1):
        first, last = (np.take(values, [end], axis) for end in (0, -1))
        wide = np.concatenate([first, values, last], axis)
        count = values.shape[axis]
        before, middle, after = (np.take(wide, range(k, k + count), axis) for k in range(3))
        values = 0.25 * before + 0.5 * middle + 0.25 * after
    return values


def ball_surface(center: np.ndarray, radius: float, color: Color) -> Surface:
    """A ball of a network."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    normals = np.asarray(ball.vertices)
    return Surface(radius * normals + center, normals, np.asarray(ball.faces), np.array(color, float), gloss=0.5)


def rod_surface(
    start: np.ndarray, end: np.ndarray, radius: float, color: Color, sides: int = 16, rings: int = 24
) -> Surface:
    """A straight spring of a network, drawn as a rod of so many sides and rings."""
    along = end - start
    length = max(float(np.linalg.norm(along)), 1e-12)
    turn = trimesh.geometry.align_vectors((0.0, 0.0, 1.0), along / length)[:3, :3]
    angle = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    flat, triangles = grid(angle, np.linspace(0.0, 1.0, rings + 1))
    normals = np.column_stack([np.cos(flat[:, 0]), np.sin(flat[:, 0]), np.zeros(len(flat))]) @ turn.T
    return Surface(
        start + flat[:, 1:] * along + radius * normals, normals, triangles, np.array(color, float), gloss=0.4
    )


def floor_plane(obstacles: list[Obstacle]) -> Plane | None:
    """The plane among the obstacles that things stand on: the one that faces up the most, or None."""
    planes = [item for item in obstacles if isinstance(item, Plane) and item.normal[2] > 0.3 and not item.moves]
    return max(planes, key=lambda plane: plane.normal[2]) if planes else None
