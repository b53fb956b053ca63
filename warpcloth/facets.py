"""Obstacles as corners and triangles, for all that has to meet more of cloth than its particles."""

import math

import numpy as np

from .obstacles import Box, Capsule, MeshObstacle, Obstacle, Sphere
from .transforms import apply, rotation_from_z, rotation_matrix

# Corner k of a box has the signs of the bits of k (x first); two triangles a face, counter-clockwise from outside.
_BOX_CORNERS = np.array([[(k >> axis & 1) - 0.5 for axis in range(3)] for k in range(8)])
_BOX_FACES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
_BOX_TRIANGLES = np.array([t for a, b, c, d in _BOX_FACES for t in ((a, b, c), (a, c, d))], np.int32)
_SIDES = 12  # of what stands for a rod or a ball: its faces are 3 % of the radius below the true surface


class Facets:
    """The corners and triangles of one obstacle: local points, the same in the world at rest [m], and indices."""

    def __init__(self, shape: int, world: int, obstacle: Obstacle):
        self.shape, self.world, self.obstacle = shape, world, obstacle
        turn = np.zeros(3)
        if isinstance(obstacle, Box):
            self.local, self.triangles = _BOX_CORNERS * obstacle.size, _BOX_TRIANGLES
            turn = obstacle.rotation
        elif isinstance(obstacle, MeshObstacle):
            self.local, self.triangles = obstacle.points - obstacle.centre, obstacle.triangles
        elif isinstance(obstacle, Capsule):
            axis = obstacle.end - obstacle.start
            self.local, self.triangles = _rounded(obstacle.radius, 0.5 * float(np.linalg.norm(axis)))
            turn = rotation_from_z(axis)
        elif isinstance(obstacle, Sphere):
            self.local, self.triangles = _rounded(obstacle.radius, 0.0)
        else:
            raise TypeError(f"no facets for {type(obstacle).__name__}")
        self.rest = self.local @ rotation_matrix(turn).T + obstacle.centre

    def at(self, t: float) -> np.ndarray:
        """The corners in the world at time t [s], shape [n, 3] [m]."""
        if isinstance(self.obstacle, MeshObstacle):
            return self.obstacle.points_at(t)
        return apply(self.obstacle.matrix(t), self.rest)


def faceted(obstacles: list[tuple[int, Obstacle, int]], edges: dict[int, float]) -> list[Facets]:
    """Those of the model's obstacles, in the order of its shapes, that cloth must meet by more than its particles.

    They are those with edges and corners, and balls and rods that fit between the particles of a triangle as long as
    ``edges`` [m], the longest of each world's cloths: on grids those with a radius below a cell. A triangle that has
    its corners outside of a larger one cannot pass its middle.
    """
    rows = [(s, row[0], row[1]) for s, row in enumerate(obstacles)]
    return [Facets(*row) for row in rows if _needs_facets(row[2], edges.get(row[1], 0.0))]


def _needs_facets(obstacle: Obstacle, edge: float) -> bool:
    if isinstance(obstacle, Sphere | Capsule):
        return obstacle.radius < math.sqrt(0.5) * edge
    return isinstance(obstacle, Box | MeshObstacle)


def _rounded(radius: float, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners [m] and triangles of a polyhedron inside all points within ``radius`` of ±``half`` on the z axis.

    Rings of corners from top to bottom, one above and one below the straight part, between two poles.
    """
    tilts = np.radians([60.0, 30.0, 0.0])
    rings = [(tilt, half) for tilt in tilts] + [(-tilt, -half) for tilt in tilts[::-1]]
    if half == 0.0:
        del rings[3]
    around = 2.0 * math.pi * np.arange(_SIDES) / _SIDES
    ring = np.column_stack([np.cos(around), np.sin(around), np.zeros(_SIDES)])
    corners = [radius * (math.cos(tilt) * ring + (0, 0, math.sin(tilt))) + (0, 0, shift) for tilt, shift in rings]
    poles = [(0.0, 0.0, half + radius), (0.0, 0.0, -half - radius)]
    here = np.arange(_SIDES)
    after = (here + 1) % _SIDES
    triangles = []
    for k in range(len(rings) - 1):
        a, b = k * _SIDES, (k + 1) * _SIDES
        triangles += [
            np.column_stack([a + here, b + here, b + after]),
            np.column_stack([a + here, b + after, a + after]),
        ]
    last, top = (len(rings) - 1) * _SIDES, len(rings) * _SIDES
    triangles.append(np.column_stack([here, after, np.full(_SIDES, top)]))
    triangles.append(np.column_stack([last + after, last + here, np.full(_SIDES, top + 1)]))
    return np.vstack([*corners, poles]), np.vstack(triangles).astype(np.int32)
