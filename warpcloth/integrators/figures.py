"""Arrays that metrics tell of, kept in case that a frame has not been."""

import warp as wp

from ..launching import copy


class Figures:
    """Keeps the present values of ``arrays`` and restores them; launches only."""

    def __init__(self, *arrays: wp.array):
        self._pairs = [(wp.clone(array), array) for array in arrays]

    def remember(self) -> None:
        """Keeps what they are."""
        for kept, array in self._pairs:
            copy(kept, array)

    def recall(self) -> None:
        """Back to what :meth:`remember` kept."""
        for kept, array in self._pairs:
            copy(array, kept)
