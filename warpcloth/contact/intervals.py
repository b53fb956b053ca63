"""How long contact may go on with what it found: until an obstacle may have moved by a part of an edge."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from ..obstacles import Box, Capsule, MeshObstacle, Obstacle, Sphere

INTERVAL = 1.0 / 120.0  # [s] at most
# Edges of cloth, or half widths of itself, that an obstacle may move by. With 0.5 and edges alone a box of 7 cm at
# 11 m/s tore the curtain that it met, and one of 3 cm stuck in cloth with cells of its own size; so both pass through.
TRAVEL = 0.25
MOST = 1024  # intervals per frame, however fast an obstacle is


def intervals_needed(edge: float, obstacles: Iterable[Obstacle], dt: float) -> int:
    """Intervals in a frame of dt [s] for cloth with edges of ``edge`` [m] among these obstacles.

    Faster obstacles need shorter ones, and so do small ones: a cloth is stopped by its vertices, edges and triangles,
    and what moves past several of them at once throws it into knots.
    """
    ways = [fastest(obstacle) * dt / min(edge, _half_width(obstacle)) for obstacle in obstacles]
    return min(MOST, math.ceil(max(dt / INTERVAL, max(ways, default=0.0) / TRAVEL) - 1e-9))


def fastest(obstacle: Obstacle) -> float:
    """A bound on the speed of any point of an obstacle's surface [m/s]; of planes, within a metre of their point."""
    speed = _deforming(obstacle) if isinstance(obstacle, MeshObstacle) else 0.0
    motion = obstacle.motion
    if motion is None or len(motion.times) < 2:
        return speed
    pivot = obstacle.centre if motion.pivot is None else motion.pivot
    reach = _radius(obstacle) + float(np.linalg.norm(obstacle.centre - pivot))
    rates = [np.linalg.norm(np.diff(keys, axis=0), axis=1) for keys in (motion.positions, motion.rotations)]
    ways = (rates[0] + reach * rates[1]) / np.diff(motion.times)
    return speed + float(ways.max()) * (1.5 if motion.interpolation == "smooth" else 1.0)


def _radius(obstacle: Obstacle) -> float:
    """Of a ball about the obstacle's centre that holds it [m]."""
    if isinstance(obstacle, Sphere):
        return obstacle.radius
    if isinstance(obstacle, Capsule):
        return obstacle.radius + 0.5 * float(np.linalg.norm(obstacle.end - obstacle.start))
    if isinstance(obstacle, Box):
        return 0.5 * float(np.linalg.norm(obstacle.size))
    if isinstance(obstacle, MeshObstacle):
        return float(np.linalg.norm(obstacle.points - obstacle.centre, axis=1).max())
    return 1.0


def _half_width(obstacle: Obstacle) -> float:
    """Half of an obstacle's middle extent [m]: a plate is as wide as its narrower side, a rod as it is thick."""
    if isinstance(obstacle, Sphere | Capsule):
        return obstacle.radius
    if isinstance(obstacle, Box):
        return 0.5 * float(np.median(obstacle.size))
    if isinstance(obstacle, MeshObstacle):
        return 0.5 * float(np.median(np.ptp(obstacle.points, axis=0)))
    return math.inf


def _deforming(obstacle: MeshObstacle) -> float:
    times: Sequence[float] | None = obstacle.sample_times
    if times is None or len(times) < 2:
        return 0.0
    ways = np.linalg.norm(np.diff(obstacle.sample_points, axis=0), axis=2).max(axis=1)
    return float((ways / np.diff(times)).max())
