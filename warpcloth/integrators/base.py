"""What every integrator provides."""

from typing import ClassVar, Protocol

from ..forces import Forces
from ..model import Model
from ..state import State


class Integrator(Protocol):
    """One step of one scheme. Code branches on these attributes, never on names.

    Attributes:
        name: how users ask for it. order: of convergence in the step. implicit: solves for the end of the step.
        symplectic: conserves phase-space area (so energy stays bounded) when there is no damping.
        reference: where the scheme is described.
    """

    name: ClassVar[str]
    order: ClassVar[int]
    implicit: ClassVar[bool]
    symplectic: ClassVar[bool]
    reference: ClassVar[str]

    def __init__(self, model: Model): ...

    def step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """From ``state_in`` to ``state_out``, dt [s] later: positions and velocities of all particles, pins included.

        Launches kernels only: no allocation, no host synchronisation. The worlds' clock is not the integrator's.
        """
        ...

    @staticmethod
    def stable_step(omega: float, gamma: float) -> float:
        """Largest stable step [s] for x″ + γ x′ + ω² x = 0, γ [1/s] and ω [1/s]; infinite where there is no limit."""
        ...
