"""The launches of one step of a simulation, kept so that derivatives can go back through them."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial

import warp as wp

from ..forces import Forces
from ..state import State


class Recording:
    """A list of tapes, with what must be put back before each of them runs backwards.

    Adjoint kernels read what arrays hold when *they* run. So what is overwritten between the launch and its adjoint has
    to come back first: forces are evaluated once more, as their terms use the same scratch memory for each evaluation,
    and for what works in place (:meth:`in_place`) the former values are kept.

    As a context it records launches; forces must then be evaluated through :attr:`forces`.

    Args:
        forces: the forces of the simulation.
        lasting: arrays whose gradients add up over several steps; others are taken as scratch of the forces.

    Attributes:
        forces: evaluates and records. plain_forces: those given, which do not record.
    """

    def __init__(self, forces: Forces, lasting: Iterable[wp.array]):
        self.plain_forces = forces
        self.lasting = list(lasting)
        self._back: list[Callable[[], None]] = []
        self._tape = wp.Tape()

    @property
    def forces(self) -> "RecordedForces":
        """Made anew each time: if it were kept, the two would keep each other, and all arrays of the step, alive."""
        return RecordedForces(self.plain_forces, self)

    def __enter__(self) -> "Recording":
        self._tape = wp.Tape()
        self._tape.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._tape.__exit__(*error)
        self._back.append(self._tape.backward)

    def evaluation(self, evaluate: Callable[[], None], state: State) -> None:
        """An evaluation of forces at ``state``, within the context."""
        self.__exit__(None, None, None)
        evaluate()
        self._back.append(partial(self._evaluation_back, evaluate, state))
        self.__enter__()

    def in_place(self, launch: Callable[[], None], arrays: Sequence[wp.array]) -> None:
        """Launches that change ``arrays``, of whose former values the result is not a linear function."""
        former = [(array, wp.clone(array, requires_grad=False)) for array in arrays]
        with self:
            launch()
        back = self._back.pop()

        def restore_and_go_back() -> None:
            for array, values in former:
                wp.copy(array, values)
            back()

        self._back.append(restore_and_go_back)

    def before_going_back_further(self, back: Callable[[], None]) -> None:
        """``back`` takes gradients from here to what was recorded before."""
        self._back.append(back)

    def backward(self) -> None:
        """From the gradients of what the step ended with to those of what it began with, and of the parameters; once,
        as each tape is let go of when it has run."""
        while self._back:
            self._back.pop()()

    def _evaluation_back(self, evaluate: Callable[[], None], state: State) -> None:
        tape = wp.Tape()
        with tape:
            evaluate()
        self.go_back_through_forces(tape, state)

    def go_back_through_forces(self, tape: wp.Tape, state: State) -> None:
        """From the gradient of ``state.particle_f`` to those of the state and the parameters; ``tape`` has seen the
        latest evaluation. Scratch of the forces is left without gradient."""
        tape.backward()
        lasting = {id(array) for array in (*self.lasting, state.particle_q, state.particle_qd)}
        for array, gradient in tape.gradients.items():
            if isinstance(array, wp.array) and id(array) not in lasting:
                gradient.zero_()


class RecordedForces(Forces):
    """Forces whose evaluations become entries of a recording."""

    def __init__(self, forces: Forces, recording: Recording):
        super().__init__(forces.model, forces.terms, forces.world_gravity)
        self._recording = recording

    def evaluate(
        self, state: State, time_offset: float = 0.0, *, without: Sequence[str] = (), ahead: float = 0.0
    ) -> None:
        """See :meth:`~warpcloth.forces.Forces.evaluate`."""
        evaluate = partial(super().evaluate, state, time_offset, without=without, ahead=ahead)
        self._recording.evaluation(evaluate, state)
