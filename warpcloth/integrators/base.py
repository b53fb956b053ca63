"""What every integrator provides."""

from typing import Any, ClassVar, Protocol

from ..forces import Forces
from ..model import Model
from ..state import State


class Integrator(Protocol):
    """One step of one scheme. Code branches on these attributes, never on names.

    Attributes:
        name: how users ask for it. order: of convergence in the step. implicit: solves for the end of the step.
        symplectic: conserves phase-space area (so energy stays bounded) when there is no damping.
        capturable: a step does the same launches every time, so that it can be part of a graph.
        reference: where the scheme is described. cost: of a step, in words. use: what it is good for, in words.
    """

    name: ClassVar[str]
    order: ClassVar[int]
    implicit: ClassVar[bool]
    symplectic: ClassVar[bool]
    capturable: ClassVar[bool]
    reference: ClassVar[str]
    cost: ClassVar[str]
    use: ClassVar[str]

    def __init__(self, model: Model): ...

    def step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """From ``state_in`` to ``state_out``, dt [s] later: positions and velocities of all particles, pins included.

        Both states share one clock, which reads the time of ``state_in`` and is not the integrator's to advance.
        Launches kernels only: no allocation, no host synchronisation (unless the scheme is not ``capturable``).
        """
        ...

    def reset(self) -> None:
        """Forgets earlier steps (multistep history, warm starts): the next step starts from its state alone."""
        ...

    def metrics(self) -> dict[str, Any]:
        """What the latest steps cost and whether their solvers converged; empty for schemes that solve nothing."""
        ...

    @staticmethod
    def stable_step(omega: float, gamma: float) -> float:
        """Largest stable step [s] for x″ + γ x′ + ω² x = 0, γ [1/s] and ω [1/s]; infinite where there is no limit."""
        ...
