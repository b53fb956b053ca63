"""Which samples are simulated together, and in which order."""

from collections import deque
from collections.abc import Iterable, Sequence


class Queue:
    """Samples that wait, handed out in jobs.

    Jobs are as large as the worlds that shall be stepped together, and smaller towards the end, so that all workers
    come to it at about the same time.

    Args:
        samples: numbers of the samples.
        worlds: most samples in a job.
        workers: how many will take jobs.
    """

    def __init__(self, samples: Iterable[int], worlds: int, workers: int):
        self._fresh, self._again, self._last = deque(samples), deque[list[int]](), deque[list[int]]()
        self.worlds, self.workers = worlds, workers

    def __len__(self) -> int:
        """Number of samples that wait."""
        return len(self._fresh) + sum(map(len, (*self._again, *self._last)))

    def take(self) -> list[int]:
        """The next job; empty if nothing waits."""
        if self._again:
            return self._again.popleft()
        if self._last and not self._fresh:
            return self._last.popleft()
        share = -(-len(self._fresh) // (2 * self.workers))
        return [self._fresh.popleft() for _ in range(min(self.worlds, share))]

    def put_back(self, samples: Sequence[int]) -> None:
        """Samples of a job that was not finished: to be done next, in two jobs, as one of them may be the cause."""
        middle = (len(samples) + 1) // 2
        self._again.extendleft(list(part) for part in (samples[middle:], samples[:middle]) if part)

    def postpone(self, samples: Sequence[int]) -> None:
        """Samples of a job that had no room beside others: to be done again when nothing else waits."""
        self._last += [list(samples)] if samples else []
