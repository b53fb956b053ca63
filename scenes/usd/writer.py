"""Writing a cache while the simulation runs."""

import math
import operator
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from ...cloth import Cloth
from ...errors import DivergedError, InputError, UsdError
from ...obstacles import Obstacle
from ..schema import Network
from .growing import GrowingStage
from .mesh_prims import ClothPrim
from .network_prims import NetworkPrim
from .obstacle_prims import ObstaclePrim, Surroundings
from .paths import output_target
from .stage import CLOTH, OBSTACLES, prim_names


class CacheWriter:
    """Streams frames into a USD file; memory stays flat however many there are.

    Frame ``f`` is the state at ``f / fps`` seconds and is written at time code ``f``; a whole shot starts with
    frame 0, the initial state. Frames are collected in ``name.partial.usdc`` beside the output, which gets the final
    name in one step at :meth:`close`; so whatever has the final name is complete.

    As a context manager it closes at the end of the block and on Ctrl-C, and aborts on any other exception; call
    :meth:`close` yourself where the frames so far are worth keeping.

    Args:
        path: ``.usdc``, ``.usda`` or ``.usdz`` file; an existing one is replaced once the new one is complete.
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
        if not (math.isfinite(fps) and fps > 0.0):
            raise InputError(f"Cannot write a cache at {fps} frames per second; it must be a number greater than 0.")
        _check_cloths(cloths)
        self.fps = float(fps)
        self._written = range(0)
        self._begun: int | None = None  # the frame being written, for as long as it is incomplete
        self._closed = False
        self._file = GrowingStage(output_target(path), self.fps, provenance or {})
        try:
            self._define_prims(cloths, obstacles)
        except BaseException:
            self.abort()
            raise

    @property
    def frames(self) -> int:
        """How many frames are complete."""
        return len(self._written)

    def write(self, frame: int, points: Mapping[str, np.ndarray], velocities: Mapping[str, np.ndarray]) -> None:
        """Writes one frame of every cloth and obstacle.

        Args:
            frame: integer, one more than the last one written.
            points: world positions by name of cloth [m], shape [n, 3] each.
            velocities: likewise [m/s].

        Raises:
            UsdError: on a wrong frame, name or shape, or when the disk does not take the samples.
            DivergedError: on values that are not finite.
        """
        frame = self._check_frame(frame)
        self._check_samples(frame, points, "points")
        self._check_samples(frame, velocities, "velocities")
        self._begun = frame
        for name, cloth in self._cloths.items():
            self._file.added(cloth.write(frame, points[name], velocities[name]))
        for obstacle in self._obstacles:
            self._file.added(obstacle.write(frame, frame / self.fps))
        self._written = range(self._written[0] if self._written else frame, frame + 1)
        self._begun = None
        self._file.save_when_due(self._written)

    def note(self, facts: Mapping[str, Any]) -> None:
        """Adds facts to the provenance, such as ones that only the first frame shows."""
        self._file.note(facts)

    def close(self) -> Path | None:
        """Completes the file with the frames written so far; returns its path, or None if there is not one frame.

        Raises:
            UsdError: when the disk does not take it; the partial file is then kept.
        """
        if self._closed:
            return self._file.target.final if self.frames else None
        if self.frames == 0:
            self.abort()
            return None
        self._drop_incomplete_frame()
        self._closed = True
        self._file.save_frames(self._written)
        return self._file.finish()

    def abort(self) -> None:
        """Removes the partial file; a file under the final name stays as it was."""
        if not self._closed:
            self._closed = True
            self._file.discard()

    def __enter__(self) -> "CacheWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None or issubclass(kind, KeyboardInterrupt):
            self.close()
        else:
            self.abort()

    def _define_prims(self, cloths: Sequence[Cloth | Network], obstacles: Sequence[Obstacle]) -> None:
        stage, around = self._file.stage, _surroundings(cloths)
        paths = [CLOTH.AppendChild(name) for name in prim_names([cloth.name for cloth in cloths])]
        self._cloths = {c.name: _drawn(stage, path, c) for c, path in zip(cloths, paths, strict=True)}
        paths = [OBSTACLES.AppendChild(name) for name in prim_names([obstacle.name for obstacle in obstacles])]
        self._obstacles = [ObstaclePrim(stage, path, o, around) for o, path in zip(obstacles, paths, strict=True)]
        self._file.added(sum(map(_size, [*cloths, *obstacles])))
        self._file.save()

    def _check_frame(self, frame: int) -> int:
        name = self._file.target.final.name
        if self._closed:
            raise UsdError(f"Cannot write frame {frame} to {name}: the cache is closed.")
        try:
            number = operator.index(frame)
        except TypeError:
            raise UsdError(f"Cannot write frame {frame!r} to {name}: frames are integers.") from None
        if self._written and number != self._written.stop:
            raise UsdError(f"Cannot write frame {number} to {name}: the next frame is {self._written.stop}.")
        return number

    def _check_samples(self, frame: int, samples: Mapping[str, np.ndarray], what: str) -> None:
        if samples.keys() != self._cloths.keys():
            got, wanted = (", ".join(sorted(names)) or "none" for names in (samples, self._cloths))
            raise UsdError(f"Frame {frame} has {what} of the cloths {got}; the cache needs those of {wanted}.")
        for name, cloth in self._cloths.items():
            if not np.isfinite(cloth.checked(samples[name], what)).all():
                raise DivergedError(f"Cloth '{name}' has {what} that are not finite numbers at frame {frame}.")

    def _drop_incomplete_frame(self) -> None:
        """After an interrupt in the middle of :meth:`write`, when some prims have the frame and others do not."""
        if self._begun is None or self._begun in self._written:
            return
        for prim in [*self._cloths.values(), *self._obstacles]:
            prim.drop(self._begun)


def _drawn(stage: Usd.Stage, path: Sdf.Path, cloth: Cloth | Network) -> ClothPrim | NetworkPrim:
    return NetworkPrim(stage, path, cloth) if isinstance(cloth, Network) else ClothPrim(stage, path, cloth)


def _check_cloths(cloths: Sequence[Cloth | Network]) -> None:
    names = [cloth.name for cloth in cloths]
    if not names:
        raise InputError("Cannot write a cache without a cloth.")
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"Cannot write a cache with two cloths named '{twice}'; give each its own name.")


def _surroundings(cloths: Sequence[Cloth | Network]) -> Surroundings:
    points = np.concatenate([cloth.points for cloth in cloths])
    lower, upper = points.min(axis=0), points.max(axis=0)
    return Surroundings(0.5 * (lower + upper), float(np.linalg.norm(upper - lower)))


def _size(item: Cloth | Network | Obstacle) -> int:
    """Bytes, at the very least as many as its prim takes up, of what is not sampled."""
    arrays = [getattr(item, name, None) for name in ("points", "triangles", "uvs", "uv_indices")]
    return 2 * sum(array.nbytes for array in arrays if array is not None)
