"""How fast a simulation goes, and into how many parts its frames are cut, each of which is shown."""

from collections import deque

SLICE = 0.05  # [s] of wall time: frames that take longer are simulated in parts
MOST_SLICES = 8
SPAN = 1.0  # [s] of wall time that the factor is a mean of
FIRST = 2  # runs of a kind that load kernels, and are captured
LIKE = 60  # runs that are judged together


class Pace:
    """Told of every part of a frame, it knows the next.

    Attributes:
        slices: equal parts of a frame. slice: number of the next part, 0 at the start of a frame.
    """

    def __init__(self) -> None:
        self.slices, self.slice = 1, 0
        self._spent: list[float] = []
        self._clock: deque[tuple[float, float]] = deque()

    def done(self, begun: float, now: float, time: float) -> bool:
        """A part took from ``begun`` to ``now`` of wall time, up to simulated ``time`` [s]; whether it was the last."""
        self._spent.append(now - begun)
        self._clock.append((now, time))
        while len(self._clock) > 2 and now - self._clock[0][0] > SPAN:
            self._clock.popleft()
        self.slice = (self.slice + 1) % self.slices
        if self.slice == 0:
            self._fit()
        return self.slice == 0

    def interrupt(self) -> None:
        """The clock stops: what comes later is no measure of what has been."""
        self._clock.clear()

    def restart(self) -> None:
        """The simulation is another one."""
        self._clock.clear()
        self._spent.clear()

    @property
    def factor(self) -> float:
        """Simulated over wall time, of the last second; 0 if nothing is known."""
        if len(self._clock) < 2:
            return 0.0
        (first, start), (last, end) = self._clock[0], self._clock[-1]
        return (end - start) / (last - first)

    def _fit(self) -> None:
        """Twice or half as many parts from here on, where they take much longer or shorter than they should."""
        usual = sorted(self._spent[FIRST:])
        if len(usual) < 2:
            return
        typical, before = usual[len(usual) // 2], self.slices
        if typical > SLICE:
            self.slices = min(MOST_SLICES, 2 * before)
        elif 2.5 * typical < SLICE:
            self.slices = max(1, before // 2)
        if self.slices != before or len(usual) > LIKE:
            self._spent.clear()
