"""Wall time by stage."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import warp as wp


class Stopwatch:
    """Adds up the wall time of named stages, with the device synchronised at both ends; idle unless ``active``.

    Attributes:
        seconds: time of each stage so far [s].
    """

    def __init__(self, device: wp.Device, active: bool):
        self.device, self.active = device, active
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Counts what happens inside towards ``name``."""
        if not self.active:
            yield
            return
        wp.synchronize_device(self.device)
        begun = time.perf_counter()
        yield
        wp.synchronize_device(self.device)
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begun
