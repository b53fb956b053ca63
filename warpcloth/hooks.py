"""Hooks: a caller's own kernels between the stages of a step, obstacles of their own among them."""

from collections.abc import Sequence

from . import validate
from .state import Memory, State


class Hook:
    """What a caller does within each substep of a :class:`warpcloth.Simulation`; override the stages that you need.

    A step is: ``before_step``, forces and integrator, ``after_integration``, contact, ``after_step``. Each stage may
    change the particles of the state it is given last: launch kernels that write to its arrays. Frames are captured as
    graphs and replayed, so a stage must do the same launches every time, without allocating or reading anything back;
    what changes from frame to frame belongs in arrays that the kernels read. Contact comes after ``after_integration``,
    so obstacles of your own belong there (see :class:`warpcloth.ContactPlanes`): no cloth passes through cloth because
    of them. What ``after_step`` does is seen by the guard against intersections only.
    """

    def before_step(self, state: State, dt: float) -> None:
        """Before a step of dt [s] from ``state``, whose ``world_time`` is the time of each world [s]."""

    def after_integration(self, start: State, end: State, dt: float) -> None:
        """After the integrator went from ``start`` to ``end``, dt [s] later, and before contact corrects ``end``."""

    def after_step(self, start: State, end: State, dt: float) -> None:
        """After the step from ``start`` to ``end``, dt [s] later, contact included."""

    def memory(self) -> Sequence[Memory]:
        """Arrays that the hook changes itself and reads in later steps; they begin as zeros.

        With them frames can be done again, worlds be reset, as if nothing had been, and go on in another simulation.
        """
        return ()


def memory_of(hook: Hook) -> list[Memory]:
    """What a hook remembers.

    Raises:
        InputError: it is no list of :class:`Memory`.
    """
    return validate.instances(hook.memory(), Memory, f"memory of {type(hook).__name__}")
