"""Writing a cache while the simulation runs."""

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from ...cloth import Cloth
from ...errors import InputError
from ...obstacles import Obstacle
from ..schema import Network
from .clock import Clock
from .frames import FrameWriter
from .growing import GrowingStage
from .mesh_prims import ClothPrim
from .network_prims import NetworkPrim
from .obstacle_prims import ObstaclePrim, Surroundings
from .paths import output_target
from .stage import CLOTH, OBSTACLES, create_stage, prim_names


class CacheWriter(FrameWriter):
    """Streams frames into a USD file of its own; memory stays flat however many there are.

    Frame ``f`` is the state at ``f / fps`` seconds and is written at time code ``f``; a whole shot starts with
    frame 0, the initial state. Frames are collected in a file of the writer's own beside the output, named
    ``name.….partial.usdc``, which gets the final name in one step at :meth:`close`; so whatever has the final name is
    complete.

    As a context manager it closes at the end of the block and on Ctrl-C, and aborts on any other exception; call
    :meth:`close` yourself where the frames so far are worth keeping.

    Args:
        path: ``.usd``, ``.usdc``, ``.usda`` or ``.usdz`` file; an existing one is replaced by the complete one.
        cloths: with different names; each becomes a mesh whose default value is its rest pose. Networks of springs
            become points and curves.
        obstacles: shown as well, and sampled if they move.
        fps: frames per second, > 0.
        provenance: facts to keep in the file (scene, integrator, seed, …): numbers, text, lists and dictionaries.

    Raises:
        UsdError: when nothing can be written to ``path``; InputError: on unusable cloths or frame rate.
    """

    def __init__(
        self,
        path: str | os.PathLike,
        cloths: Sequence[Cloth | Network],
        obstacles: Sequence[Obstacle] = (),
        fps: float = 24.0,
        provenance: Mapping[str, Any] | None = None,
    ):
        check_rate(fps)
        _check_cloths(cloths)
        target = output_target(path)
        try:
            file = GrowingStage(target, create_stage(target, float(fps), provenance or {}), Clock())
            drawn = _cloth_prims(file.stage, cloths)
            super().__init__(file, float(fps), drawn, _obstacle_prims(file, cloths, obstacles))
            file.added(sum(map(_size, [*cloths, *obstacles])))
            file.save()
        except BaseException:
            target.discard()
            raise


def check_rate(fps: float) -> None:
    """Refuses what is no frame rate."""
    if not (math.isfinite(fps) and fps > 0.0):
        raise InputError(f"Cannot write a cache at {fps} frames per second; it must be a number greater than 0.")


def _cloth_prims(stage: Usd.Stage, cloths: Sequence[Cloth | Network]) -> dict[str, ClothPrim | NetworkPrim]:
    paths = [CLOTH.AppendChild(name) for name in prim_names([cloth.name for cloth in cloths])]
    return {cloth.name: _drawn(stage, path, cloth) for cloth, path in zip(cloths, paths, strict=True)}


def _obstacle_prims(
    file: GrowingStage, cloths: Sequence[Cloth | Network], obstacles: Sequence[Obstacle]
) -> list[ObstaclePrim]:
    around = surroundings(cloths)
    paths = [OBSTACLES.AppendChild(name) for name in prim_names([obstacle.name for obstacle in obstacles])]
    return [ObstaclePrim(file.stage, path, o, around) for o, path in zip(obstacles, paths, strict=True)]


def _drawn(stage: Usd.Stage, path: Sdf.Path, cloth: Cloth | Network) -> ClothPrim | NetworkPrim:
    return NetworkPrim(stage, path, cloth) if isinstance(cloth, Network) else ClothPrim(stage, path, cloth)


def _check_cloths(cloths: Sequence[Cloth | Network]) -> None:
    names = [cloth.name for cloth in cloths]
    if not names:
        raise InputError("Cannot write a cache without a cloth.")
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"Cannot write a cache with two cloths named '{twice}'; give each its own name.")


def surroundings(cloths: Sequence[Cloth | Network]) -> Surroundings:
    """Where cloths are."""
    points = np.concatenate([cloth.points for cloth in cloths])
    lower, upper = points.min(axis=0), points.max(axis=0)
    return Surroundings(0.5 * (lower + upper), float(np.linalg.norm(upper - lower)))


def _size(item: Cloth | Network | Obstacle) -> int:
    """Bytes, at the very least as many as its prim takes up, of what is not sampled."""
    arrays = [getattr(item, name, None) for name in ("points", "triangles", "uvs", "uv_indices")]
    return 2 * sum(array.nbytes for array in arrays if array is not None)
