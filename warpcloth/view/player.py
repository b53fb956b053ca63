"""Where a cache is being played, as time goes by."""

import threading
from collections.abc import Sequence

import numpy as np

SPEEDS = {"1/8": 0.125, "1/4": 0.25, "1/2": 0.5, "1": 1.0, "2": 2.0, "4": 4.0}


class Player:
    """A timeline; its methods may be called from any thread.

    Args:
        times: of the frames [s], rising, shape [n].

    Attributes:
        playing: whether time goes by. speed: seconds of the cache per second.
        loop: whether the end is followed by the beginning; else playing ends there.
    """

    def __init__(self, times: Sequence[float]):
        self._times = np.asarray(times, float) - times[0]
        gap = self._times[-1] / (len(times) - 1) if len(times) > 1 else 1.0
        self._period = float(self._times[-1] + gap)  # in a loop, the last frame is seen as long as others
        self._place, self._lock = 0.0, threading.Lock()
        self.playing, self.loop, self.speed = False, True, 1.0

    @property
    def frame(self) -> int:
        """Number of the frame that is to be seen."""
        found = np.searchsorted(self._times, self._place + 1e-9 * self._period, side="right") - 1
        return int(np.clip(found, 0, self.last))

    @property
    def last(self) -> int:
        """Number of the last frame."""
        return len(self._times) - 1

    def advance(self, seconds: float) -> None:
        """Time has gone by."""
        with self._lock:
            if not self.playing:
                return
            self._place += self.speed * seconds
            if self._place >= self._period and self.loop:
                self._place %= self._period
            elif self._place >= self._times[-1] and not self.loop:
                self._place, self.playing = float(self._times[-1]), False

    def toggle(self) -> None:
        """Plays, from the beginning if the end was reached; or pauses."""
        with self._lock:
            if not self.playing and not self.loop and self._place >= self._times[-1]:
                self._place = 0.0
            self.playing = not self.playing

    def seek(self, frame: int) -> None:
        """Pauses at a frame, the nearest that there is."""
        with self._lock:
            self._place, self.playing = float(self._times[np.clip(frame, 0, self.last)]), False

    def skip(self, frames: int) -> None:
        """Pauses some frames on, or back; around the ends in a loop."""
        wanted = self.frame + frames
        self.seek(wanted % (self.last + 1) if self.loop else wanted)
