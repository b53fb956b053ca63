"""Obstacles on the device: shapes sorted by world, their meshes, and where they are during a step."""

import threading
from collections import Counter
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
import warp as wp

from .kernels import KernelSet
from .launching import launch, refit
from .obstacles import Box, Capsule, MeshObstacle, Obstacle, Plane, Sphere
from .transforms import rotation_from_z


def _frame(obstacle: Obstacle) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    """Kind, size parameters, rest position and rest rotation vector of the shape's own frame."""
    zero = np.zeros(3)
    if isinstance(obstacle, Plane):
        return "PLANE", zero, obstacle.point, rotation_from_z(obstacle.normal)
    if isinstance(obstacle, Sphere):
        return "SPHERE", np.array([obstacle.radius, 0.0, 0.0]), obstacle.center, zero
    if isinstance(obstacle, Capsule):
        axis = obstacle.end - obstacle.start
        half = 0.5 * np.linalg.norm(axis)
        return "CAPSULE", np.array([obstacle.radius, half, 0.0]), obstacle.centre, rotation_from_z(axis)
    if isinstance(obstacle, Box):
        return "BOX", 0.5 * obstacle.size, obstacle.center, obstacle.rotation
    if isinstance(obstacle, MeshObstacle):
        return "MESH", zero, obstacle.centre, zero
    raise TypeError(f"no collision shape for {type(obstacle).__name__}")


class DeformingMesh:
    """Samples of a mesh obstacle whose points move on their own."""

    def __init__(self, obstacle: MeshObstacle, mesh: wp.Mesh, world: int, device: wp.Device):
        self.mesh = mesh
        self.world = world
        local = obstacle.sample_points - obstacle.centre
        self.times = wp.array(obstacle.sample_times, dtype=wp.float64, device=device)
        self.points = wp.array(np.ascontiguousarray(local, np.float32), dtype=wp.vec3, device=device)
        self.speed = 0.0
        if len(obstacle.sample_times) > 1:
            steps = np.linalg.norm(np.diff(local, axis=0), axis=2).max(axis=1)
            self.speed = float((steps / np.diff(obstacle.sample_times)).max())


class CollisionShapes:
    """Device side of all obstacles of a model.

    Attributes:
        shapes: the ``Shapes`` struct of ``kernels/shapes.py``; rows are sorted by world.
        most: obstacles in the world that has most of them.
        start, end: placements at both ends of the current step, shape [shape_count].
        meshes: one ``wp.Mesh`` per mesh obstacle, in the obstacle's own frame.
        deforming: those among them whose points are sampled.
        turn: whoever places moving obstacles has it while they must stay there, as other threads may place them, too.
    """

    def __init__(
        self, kernels: KernelSet, obstacles: Sequence[tuple[int, Obstacle, int]], world_count: int, device: wp.Device
    ):
        """``obstacles`` are rows of (world, obstacle, track or −1)."""
        self.kernels = kernels
        self.device = device
        self.obstacles = sorted(obstacles, key=lambda row: row[0])
        self.count = len(self.obstacles)
        self.most = max(Counter(row[0] for row in self.obstacles).values(), default=0)
        self.meshes: list[wp.Mesh] = []
        self.deforming: list[DeformingMesh] = []
        self.shapes = self._make_shapes(world_count)
        self.start = wp.zeros(self.count, dtype=kernels.shapes.Placement, device=device)
        self.end = wp.zeros(self.count, dtype=kernels.shapes.Placement, device=device)
        moves = any(row[1].moves for row in self.obstacles)
        self.turn: AbstractContextManager[Any] = threading.RLock() if moves else nullcontext()

    def _make_shapes(self, world_count: int) -> Any:
        k, device = self.kernels, self.device
        real, vec3 = k.precision.real, k.precision.vec3
        worlds = np.array([row[0] for row in self.obstacles], np.int32)
        items = [row[1] for row in self.obstacles]
        frames = [_frame(o) for o in items]

        def column(values: Any, dtype: type, width: tuple[int, ...] = (), requires_grad: bool = False) -> wp.array:
            rows = np.array(values).reshape(-1, *width)
            return wp.array(rows, dtype=dtype, device=device, requires_grad=requires_grad)

        shapes = k.shapes.Shapes()
        shapes.world_start = column(np.searchsorted(worlds, np.arange(world_count + 1)).astype(np.int32), wp.int32)
        shapes.world = column(worlds, wp.int32)
        shapes.kind = column(np.array([int(getattr(k.shapes, f[0])) for f in frames], np.int32), wp.int32)
        shapes.size = column([f[1] for f in frames], vec3, (3,))
        ids, speeds = self._make_meshes(worlds, items)
        shapes.mesh = column(np.array(ids, np.uint64), wp.uint64)
        shapes.mesh_speed = column(speeds, real)
        solid = {key: o.solid for key, o in {id(o): o for o in items}.items()}  # worlds may have one and the same mesh
        shapes.solid = column([solid[id(o)] for o in items], wp.int32)
        shapes.thickness = column([o.thickness for o in items], real)
        shapes.friction = column([o.friction for o in items], real, requires_grad=self.kernels.differentiable)
        shapes.restitution = column([o.restitution for o in items], real, requires_grad=self.kernels.differentiable)
        shapes.track = column(np.array([row[2] for row in self.obstacles], np.int32), wp.int32)
        shapes.rest_position = column([f[2] for f in frames], wp.vec3d, (3,))
        shapes.rest_rotation = column([f[3] for f in frames], wp.vec3d, (3,))
        pivots = [o.centre if o.motion is None or o.motion.pivot is None else o.motion.pivot for o in items]
        shapes.pivot = column(pivots, wp.vec3d, (3,))
        return shapes

    def _make_meshes(self, worlds: np.ndarray, items: Sequence[Obstacle]) -> tuple[list[int], list[float]]:
        ids, speeds = [], []
        for world, obstacle in zip(worlds, items, strict=True):
            mesh_id, speed = 0, 0.0
            if isinstance(obstacle, MeshObstacle):
                local = np.ascontiguousarray(obstacle.points - obstacle.centre, np.float32)
                points = wp.array(local, dtype=wp.vec3, device=self.device)
                mesh = wp.Mesh(
                    points,
                    wp.array(obstacle.triangles.ravel(), dtype=wp.int32, device=self.device),
                    velocities=wp.zeros_like(points),
                    support_winding_number=True,
                )
                self.meshes.append(mesh)
                if obstacle.sample_times is not None:
                    self.deforming.append(DeformingMesh(obstacle, mesh, int(world), self.device))
                    speed = self.deforming[-1].speed
                mesh_id = mesh.id
            ids.append(mesh_id)
            speeds.append(speed)
        return ids, speeds

    def place(self, tracks: Any, world_time: wp.array, dt: float) -> None:
        """Placements at the worlds' time and dt [s] later; deforming meshes move to the later time."""
        if self.count == 0:
            return
        launch(
            self.kernels.shapes.place_shapes,
            dim=self.count,
            inputs=[self.shapes, tracks, world_time, dt],
            outputs=[self.start, self.end],
            device=self.device,
        )
        for item in self.deforming:
            launch(
                self.kernels.shapes.sample_mesh_points,
                dim=len(item.mesh.points),
                inputs=[item.times, item.points, item.world, world_time, dt],
                outputs=[item.mesh.points, item.mesh.velocities],
                device=self.device,
            )
            refit(item.mesh)
