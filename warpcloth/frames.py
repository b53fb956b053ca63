"""Frames recorded once and replayed: as a graph, or on the CPU as a program (``program.py``)."""

from collections.abc import Callable
from functools import partial
from typing import Any

import warp as wp

from . import validate
from .freed_memory import return_freed_memory
from .launching import alone
from .model import Model
from .program import default_threads, programs_work, record_program

MOST_THREADS = 256


class Frames:
    """The frames of one simulation.

    Args:
        model: the model.
        replay: whether to record frames at all.
        foreign: whether they have launches that do not go through :mod:`warpcloth.launching`, such as those of hooks.
        threads: of a program; None: as many as pay.

    Attributes:
        replay: whether frames are recorded.
        threads: how many threads frames run on, 1 where they are no programs.
        recorded: what replays the frame of a key.

    Raises:
        InputError: threads out of range.
    """

    def __init__(self, model: Model, replay: bool, foreign: bool, threads: int | None = None):
        self.model = model
        # Warp records no mesh refit into a CPU graph (1.19), so such frames run directly there.
        self.replay = replay and not (foreign and model.device.is_cpu and model.shapes.deforming)
        self._program = self.replay and not foreign and model.device.is_cpu and programs_work()
        wanted = default_threads(model.particle_count)
        if threads is not None:
            wanted = validate.integer(threads, "threads", minimum=1, maximum=MOST_THREADS)
        self.threads = wanted if self._program else 1
        self._ran: set[Any] = set()
        self.recorded: dict[Any, Callable[[], None]] = {}

    def run(self, key: Any, frame: Callable[[], None]) -> None:
        """A frame; those of one key are the same one."""
        if self.replay and (self._program or key in self._ran):
            if key not in self.recorded:
                self._record(key, frame)
                return_freed_memory()
            self.recorded.get(key, frame)()
            return
        frame()  # which loads the kernels of a graph
        if key not in self._ran:
            self._ran.add(key)
            return_freed_memory()

    def forget(self) -> None:
        """Recorded frames hold arrays that have been replaced, or lack what is new."""
        self.recorded.clear()
        self._ran.clear()

    def _record(self, key: Any, frame: Callable[[], None]) -> None:
        """Keeps what replays a frame; no graph while other threads launch: there will be a quieter moment."""
        if self._program:
            self.recorded = {key: record_program(frame, self.model.kernels, self.threads).run}
            return
        with alone() as nobody_else:
            if nobody_else:
                with wp.ScopedCapture(device=self.model.device) as capture:
                    frame()
                self.recorded = {key: partial(wp.capture_launch, capture.graph)}
