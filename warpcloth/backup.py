"""Frames that may have to be done again, or turn out not to be possible."""

from collections.abc import Callable, Sequence

import warp as wp

from .contact import ContactStage
from .frames import Frames
from .integrators.base import Integrator
from .state import Memory, State


class Backup:
    """Copies of a state and of what schemes and forces remember, allocated once.

    Args:
        state: the state. memory: all that the next step depends on besides it.
        integrator, contact, frames: of the simulation.

    Attributes:
        before: particles of the state when it was kept last; its clock is that of the state.
    """

    def __init__(
        self, state: State, memory: Sequence[Memory], integrator: Integrator, contact: ContactStage, frames: Frames
    ):
        self.state, self.before = state, state.twin()
        self._integrator, self._contact, self._frames = integrator, contact, frames
        rest = [state.world_time, *(item.array for item in memory)]
        self._copies = [(wp.clone(array), array) for array in rest]

    def attempt(self, frame: Callable[[], None]) -> None:
        """Does ``frame``, again while contact lacks memory; if it raises, as a hook may, it has not been."""
        self._keep()
        try:
            with self._contact.model.shapes.turn:
                frame()
                while self._contact.grow():
                    self._restore()
                    frame()
        except BaseException:
            self._restore()
            self._contact.recall()
            raise

    def _keep(self) -> None:
        self.before.copy_from(self.state)
        for copy, array in self._copies:
            wp.copy(copy, array)
        self._integrator.remember()
        self._contact.remember()

    def _restore(self) -> None:
        self._integrator.recall()
        self.state.copy_from(self.before)
        for copy, array in self._copies:
            wp.copy(array, copy)
        self._frames.forget()
