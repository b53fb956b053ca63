"""Which time code a frame has."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Clock:
    """Frame f, at f/fps seconds, has time code ``start`` + f ``step``; caches of our own count frames from 0.

    Args:
        start: time code of frame 0.
        step: time codes from one frame to the next, > 0.
    """

    start: float = 0.0
    step: float = 1.0

    def code(self, frame: int) -> float:
        """Time code of a frame."""
        return self.start + self.step * frame
