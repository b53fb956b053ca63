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
        self._fresh, self._again = deque(samples), deque[list[int]]()
        self.worlds, self.workers = worlds, workers

    def __len__(self) -> int:
        """Number of samples that wait."""
        return len(self._fresh) + sum(map(len, self._again))

    def take(self) -> list[int]:
        """The next job; empty if nothing waits."""
        if self._again:
            return self._again.popleft()
        share = -(-len(self._fresh) // (2 * self.workers))
        return [self._fresh.popleft() for _ in range(min(self.worlds, share))]

    def put_back(self, samples: Sequence[int]) -> None:
        """Samples of a job that was not finished: to be done next, in two jobs, as one of them may be the cause."""
        middle = (len(samples) + 1) // 2
        self._again.extendleft(list(part) for part in (samples[middle:], samples[:middle]) if part)
