"""Random numbers for scenes: rounded, so that a scene reads well as text and is the same everywhere."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

T = TypeVar("T")


class Draw:
    """A source of random values that belongs to one seed."""

    def __init__(self, seed: int):
        self._random = np.random.default_rng(seed)

    def number(self, low: float, high: float) -> float:
        """A number from ``low`` to ``high``, to four digits behind the point."""
        return round(float(self._random.uniform(low, high)), 4)

    def numbers(self, count: int, low: float, high: float) -> list[float]:
        """So many of them."""
        return [self.number(low, high) for _ in range(count)]

    def whole(self, low: int, high: int) -> int:
        """A whole number from ``low`` to ``high``, both included."""
        return int(self._random.integers(low, high, endpoint=True))

    def chance(self, share: float) -> bool:
        """True in this share of all cases."""
        return bool(self._random.uniform() < share)

    def one_of(self, items: Sequence[T]) -> T:
        """Any of the items."""
        return items[self.whole(0, len(items) - 1)]
