"""What a frame began with, in case it has to be done again."""

from collections.abc import Sequence

import warp as wp

from .state import Memory, State


class Backup:
    """Copies of a state and of what schemes and forces remember, allocated once.

    Args:
        state: the state. memory: all that the next step depends on besides it.

    Attributes:
        before: particles of the state when it was kept last; its clock is that of the state.
    """

    def __init__(self, state: State, memory: Sequence[Memory]):
        self.before = state.twin()
        rest = [state.world_time, *(item.array for item in memory)]
        self._copies = [(wp.clone(array), array) for array in rest]

    def keep(self, state: State) -> None:
        """Keeps everything as it is."""
        self.before.copy_from(state)
        for copy, array in self._copies:
            wp.copy(copy, array)

    def restore(self, state: State) -> None:
        """Puts everything back."""
        state.copy_from(self.before)
        for copy, array in self._copies:
            wp.copy(array, copy)
