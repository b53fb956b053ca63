"""Whether velocities are the rate of change of the points they come with."""

from collections import deque

import numpy as np

SMOOTH = 0.3  # second over first differences of points whose path the frame rate resolves
FEWEST = 8  # frames; fewer prove nothing
WRONG_GAIN = 0.5  # what a gain must be off by: units of frames, a sign, zeros or shuffled points are off by far more
MEANT_SPEED = 0.1  # root mean square [length units/s] that points which do not move at all cannot have


class VelocityFit:
    """Fits velocities v of inner frames to central differences c of the points: v = gain · c, by least squares.

    Single frames prove nothing: cloth that lands stops between two of them. So all are fitted together, and the
    standard error of the gain is taken from the scatter over frames. Springs may vibrate faster than the frame rate;
    points and velocities then rightly have little to do with each other, so only points on smooth paths are used.
    """

    def __init__(self, codes_per_second: float):
        self._rate = codes_per_second
        self._window: deque[tuple[float, np.ndarray, np.ndarray | None]] = deque(maxlen=3)
        self._frames = 0
        self._values = 0
        self._vv = self._vc = self._cc = 0.0
        self._round_off = 0.0  # what single precision of the points puts into cc

    def add(self, code: float, points: np.ndarray, velocities: np.ndarray | None) -> None:
        """Takes the next frame: points and velocities, shape [n, 3], None where they are unusable."""
        self._window.append((code / self._rate, points, velocities))
        if len(self._window) < 3:
            return
        (t0, before, _), (t1, between, middle), (t2, after, _) = self._window
        if middle is None or abs((t2 - t1) - (t1 - t0)) > 1e-3 * (t2 - t0):
            return
        bends = np.linalg.norm(after - 2.0 * between + before, axis=1)
        smooth = bends <= SMOOTH * np.linalg.norm(after - before, axis=1)
        middle, change = middle[smooth], (after - before)[smooth] / (t2 - t0)
        self._frames += 1
        self._values += change.size
        self._vv += float(np.vdot(middle, middle))
        self._vc += float(np.vdot(middle, change))
        self._cc += float(np.vdot(change, change))
        self._round_off += change.size * (np.finfo(np.float32).eps * np.abs(after).max(initial=0.0) / (t2 - t0)) ** 2

    @property
    def gain(self) -> float | None:
        """The fitted factor; None if nothing moves."""
        return self._vc / self._cc if self._cc > 100.0 * self._round_off else None

    @property
    def fault(self) -> str | None:
        """What is wrong, or None."""
        if self._frames < FEWEST:
            return None
        if self.gain is None:
            fast = self._vv > self._values * MEANT_SPEED**2
            return "has velocities, but its points do not move" if fast else None
        scatter = max(0.0, self._vv - self.gain * self._vc) / self._cc
        if abs(self.gain - 1.0) <= max(WRONG_GAIN, 2.0 * np.sqrt(scatter / self._frames)):
            return None
        return f"has velocities that are {self.gain:.2g} times the rate of change of its points"
