"""Copies of the arrays that a simulation goes on from."""

from collections.abc import Sequence

import warp as wp


class Snapshots:
    """Memory for ``count`` copies of some arrays, allocated once.

    Args:
        arrays: what is copied, and put back.
        count: how many copies.
    """

    def __init__(self, arrays: Sequence[wp.array], count: int):
        self.arrays, self.count = list(arrays), count
        self._copies = [[wp.clone(array, requires_grad=False) for array in arrays] for _ in range(count)]

    def take(self, number: int) -> None:
        """Copies all arrays as they are."""
        for copy, array in zip(self._copies[number], self.arrays, strict=True):
            wp.copy(copy, array)

    def put(self, number: int) -> None:
        """Puts back what was copied."""
        for copy, array in zip(self._copies[number], self.arrays, strict=True):
            wp.copy(array, copy)

    def changed(self, number: int) -> list[int]:
        """Which of the arrays no longer hold what was copied."""
        pairs = zip(self._copies[number], self.arrays, strict=True)
        return [k for k, (copy, array) in enumerate(pairs) if copy.numpy().tobytes() != array.numpy().tobytes()]
