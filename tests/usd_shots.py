"""Small cloths, obstacles and caches that several test files write."""

from pathlib import Path

import numpy as np
import trimesh
from warpcloth.scenes.usd import CacheWriter

from warpcloth import Box, Capsule, Cloth, MeshObstacle, Motion, Plane, Sphere

FPS = 24.0
LAST = 12


def two_cloths() -> list[Cloth]:
    flag = Cloth.grid(size=(1.0, 0.8), resolution=(7, 5), name="red flag", pins="left", transform=(0.0, 0.0, 1.0))
    return [flag, Cloth.disc(radius=0.4, resolution=3, name="red-flag", transform=(2.0, 0.0, 1.5))]


def one_of_each() -> list:
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.3)
    mesh = (np.array(ball.vertices) + np.array([4.0, 0.0, 0.3]), np.array(ball.faces))
    breathing = {"sample_times": (0.0, 0.25, 0.5), "sample_points": np.stack([mesh[0], 1.1 * mesh[0], mesh[0]])}
    wheel = Motion.spin((0.0, 1.0, 0.0), 0.2, pivot=(0.0, 0.0, 1.0))  # 1.3 rad per frame
    lift = Motion.keyframes([(0.0, (0.0, 0.0, 0.0)), (0.5, (0.0, 0.3, 0.2), (0.4, -0.3, 9.0))], interpolation="smooth")
    return [
        Plane((0.3, 0.2, -0.7), (0.1, -0.2, 1.0), friction=0.3),
        Sphere((0.0, 0.0, 0.2), 0.25, thickness=0.004, restitution=0.5, motion=lift),
        Capsule((3.0, 0.0, 0.0), (3.0, 0.1, -0.4), 0.1, motion=wheel, color=(0.9, 0.1, 0.2)),
        Box((5.0, 0.0, 0.0), (0.2, 0.4, 0.6), (0.3, 0.2, -0.5), motion=lift),
        MeshObstacle(*mesh, name="mesh"),
        MeshObstacle(*mesh, name="mesh", motion=wheel),
        MeshObstacle(*mesh, name="breathing", **breathing),
    ]


def frame_of(cloth: Cloth, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and velocities of a wave that runs through the cloth while it rises; exact derivatives."""
    t, x = frame / FPS, cloth.points[:, 0]
    lift = 0.3 * t + 0.05 * np.sin(4.0 * x + 6.0 * t)
    speed = 0.3 + 0.3 * np.cos(4.0 * x + 6.0 * t)
    up = np.array([0.0, 0.0, 1.0])
    return cloth.points + lift[:, None] * up, speed[:, None] * up


def write_frames(writer: CacheWriter, cloths: list[Cloth], frames: range) -> None:
    for frame in frames:
        states = {cloth.name: frame_of(cloth, frame) for cloth in cloths}
        writer.write(frame, {n: s[0] for n, s in states.items()}, {n: s[1] for n, s in states.items()})


def write_shot(path: Path, obstacles: list | None = None, last: int = LAST) -> Path:
    cloths = two_cloths()
    with CacheWriter(path, cloths, one_of_each() if obstacles is None else obstacles, FPS, {"scene": "test"}) as writer:
        write_frames(writer, cloths, range(last + 1))
    return writer.close()


def partial_of(path: Path) -> Path | None:
    """The file in which a cache grows that is to become ``path``, if there is one."""
    found = list(path.parent.glob(f"{path.stem}.*.partial.usdc"))
    assert len(found) < 2
    return found[0] if found else None
