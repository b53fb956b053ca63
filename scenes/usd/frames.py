"""Writing a file frame by frame while the simulation runs."""

import operator
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np

from ...errors import DivergedError, UsdError
from .growing import GrowingStage


class SampledCloth(Protocol):
    """A cloth in a file."""

    def write(self, code: float, points: np.ndarray, velocities: np.ndarray) -> int:
        """Sets one frame: world positions [m] and velocities [m/s]; returns the bytes held in memory."""

    def checked(self, values: np.ndarray, what: str) -> np.ndarray:
        """``values`` as stored; UsdError when they are not one vector per particle."""

    def drop(self, code: float) -> None:
        """Takes back what was set at time ``code``."""


class SampledObstacle(Protocol):
    """An obstacle in a file."""

    def write(self, code: float, time: float) -> int:
        """Sets the pose at ``time`` [s] if it ever changes; returns the bytes held in memory."""

    def drop(self, code: float) -> None:
        """Takes back what was set at time ``code``."""


class FrameWriter:
    """Streams frames into a file; memory stays flat however many there are.

    Frames are collected in a partial file beside the output, which gets the final name in one step at :meth:`close`; so
    whatever has the final name is complete. As a context manager it closes at the end of the block and on Ctrl-C, and
    aborts on any other exception; call :meth:`close` yourself where the frames so far are worth keeping.

    Args:
        file: what the frames go to.
        fps: frames per second, > 0.
        cloths: what takes the samples, by name of cloth.
        obstacles: sampled along with them.
    """

    def __init__(
        self, file: GrowingStage, fps: float, cloths: Mapping[str, SampledCloth], obstacles: Sequence[SampledObstacle]
    ):
        self.fps = fps
        self._file = file
        self._cloths = dict(cloths)
        self._obstacles = list(obstacles)
        self._written = range(0)
        self._begun: int | None = None  # the frame being written, for as long as it is incomplete
        self._closed = False

    @property
    def frames(self) -> int:
        """How many frames are complete."""
        return len(self._written)

    def write(
        self,
        frame: int,
        points: Mapping[str, np.ndarray],
        velocities: Mapping[str, np.ndarray],
        time: float | None = None,
    ) -> None:
        """Writes one frame of every cloth and obstacle.

        Args:
            frame: integer, one more than the last one written.
            points: world positions by name of cloth [m], shape [n, 3] each.
            velocities: likewise [m/s].
            time: at which obstacles are shown [s]; None: that of the frame when frame 0 is the start.

        Raises:
            UsdError: on a wrong frame, name or shape, or when the disk does not take the samples.
            DivergedError: on values that are not finite.
        """
        frame = self._check_frame(frame)
        self._check_samples(frame, points, "points")
        self._check_samples(frame, velocities, "velocities")
        self._begun = frame
        code = self._file.clock.code(frame)
        for name, cloth in self._cloths.items():
            self._file.added(cloth.write(code, points[name], velocities[name]))
        for obstacle in self._obstacles:
            self._file.added(obstacle.write(code, frame / self.fps if time is None else time))
        self._written = range(self._written[0] if self._written else frame, frame + 1)
        self._begun = None
        self._file.save_when_due(self._written)

    def note(self, facts: Mapping[str, Any]) -> None:
        """Adds facts to the provenance, such as ones that only the first frame shows."""
        self._file.note(facts)

    def close(self) -> Path | None:
        """Completes the file with the frames written so far; returns its path, or None if there is not one frame.

        Raises:
            UsdError: when the disk does not take it; the partial file is then kept, and the message has its name.
        """
        if self._closed:
            return self._file.target.final if self.frames else None
        if self.frames == 0:
            self.abort()
            return None
        self._drop_incomplete_frame()
        self._closed = True
        return self._file.finish(self._written)

    def abort(self) -> None:
        """Removes the partial file; a file under the final name stays as it was."""
        if not self._closed:
            self._closed = True
            self._file.discard()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None or issubclass(kind, KeyboardInterrupt):
            self.close()
        else:
            self.abort()

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
        code = self._file.clock.code(self._begun)
        for cloth in self._cloths.values():
            cloth.drop(code)
        for obstacle in self._obstacles:
            obstacle.drop(code)
