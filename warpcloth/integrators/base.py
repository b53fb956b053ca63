"""What every integrator provides."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Protocol

from ..forces import Forces
from ..model import Model
from ..state import Memory, State


class Integrator(Protocol):
    """One step of one scheme; classes inherit from it. Code branches on these attributes, never on names.

    Attributes:
        name: how users ask for it.
        order: of convergence in the step; 0 for a method whose material depends on the step, so that it has none.
        implicit: solves for the end of the step.
        symplectic: conserves phase-space area (so energy stays bounded) when there is no damping.
        capturable: a step does the same launches every time, so that it can be part of a graph.
        adaptive: divides the step it is given as the error demands, so that no step is too large for it.
        solves_springs_only: all other forces act as they were at the start of the step, so stiff ones need a pass.
        solved_forces: names of the force terms that the scheme solves for itself, in place of evaluating them.
        filtered_forces: names of those that it smooths before they act, which allows longer steps.
        linearizes: solves linear systems with the matrix of the forces, by many products at one state.
        couples_worlds: step sizes or iteration counts are decided over all worlds at once, so a world's result depends,
            within the tolerance, on the worlds beside it; elsewhere a world among others is bitwise that world alone if
            forces depend on velocities in both, or in none.
        conserves_linear_momentum, conserves_angular_momentum: to round-off, without pins and outer forces, also with
            damped springs.
        contact_share: γ/dt of a scheme that takes obstacles as forces within its step; 0: they act at the step's end.
        steps_per_travel: how many steps it wants in the time in which cloth moves by a third of an edge, where contact
            acts (see ``contact/travel.py``); 0: any step will do.
        convergence_options: options under which halving the step shows ``order``: tight solver tolerances, steps of
            the given size. For tests and work-precision diagrams.
        reference: where the scheme is described. cost: of a step, in words. use: what it is good for, in words.
    """

    name: ClassVar[str]
    order: ClassVar[int]
    implicit: ClassVar[bool]
    symplectic: ClassVar[bool]
    capturable: ClassVar[bool]
    adaptive: ClassVar[bool] = False
    solves_springs_only: ClassVar[bool] = False
    solved_forces: ClassVar[tuple[str, ...]] = ()
    filtered_forces: tuple[str, ...] = ()
    linearizes: ClassVar[bool] = False
    couples_worlds: ClassVar[bool] = False
    conserves_linear_momentum: ClassVar[bool] = True
    conserves_angular_momentum: ClassVar[bool] = False
    contact_share: ClassVar[float] = 0.0
    steps_per_travel: ClassVar[float] = 0.0
    convergence_options: ClassVar[Mapping[str, Any]] = {}
    reference: ClassVar[str]
    cost: ClassVar[str]
    use: ClassVar[str]

    def __init__(self, model: Model): ...

    def prepare(self) -> None:
        """Before each frame: brings copies of what the model has up to date. Launches kernels only."""
        return None  # a body, for type checkers take a protocol's method without one as abstract

    def step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """From ``state_in`` to ``state_out``, dt [s] later: positions and velocities of all particles, pins included.

        Both states share one clock, which reads the time of ``state_in`` and is not the integrator's to advance.
        Launches kernels only: no allocation, no host synchronisation (unless the scheme is not ``capturable``).
        """
        ...

    def reset(self) -> None:
        """Forgets earlier steps (multistep history, warm starts): the next step starts from its state alone."""
        return None

    def memory(self) -> Sequence[Memory]:
        """All that the next step depends on besides its state: what :meth:`reset` forgets, if it is in arrays.

        Whoever puts the state back to an earlier one, or takes a world to another model, does so with these, too.
        """
        return ()

    def remember(self) -> None:
        """Before a frame: keeps what the next step depends on, or metrics tell, and :meth:`memory` has not."""
        return None

    def recall(self) -> None:
        """Back to what :meth:`remember` kept."""
        return None

    def metrics(self) -> dict[str, Any]:
        """What the latest steps cost and whether their solvers converged; empty for schemes that solve nothing."""
        return {}

    @classmethod
    def stable_step(cls, omega: float, gamma: float) -> float:
        """Largest stable step [s] for x″ + γ x′ + ω² x = 0, γ [1/s] and ω [1/s]; infinite where there is no limit."""
        ...

    @classmethod
    def usable_step(cls, omega: float, gamma: float) -> float:
        """Largest step [s] for a network whose fastest mode has these rates: what automatic substeps are made from.

        The stable step, except for schemes that let undamped motion grow at any step, but slowly at small ones.
        """
        return cls.stable_step(omega, gamma)

    @classmethod
    def explicit_step(cls, omega: float, gamma: float) -> float:
        """Largest step [s] for the forces besides springs, where a scheme solves for springs only; else infinite."""
        return math.inf

    def filtered_step(self) -> float:
        """Largest step [s] for which ``filtered_forces`` are smoothed well; infinite where there are none."""
        return math.inf

    def advised_step(self) -> float:
        """Step [s] at which results are good for the model at hand, where that asks for less than stability does.

        Automatic substeps take it into account; infinite where the stable step is good enough.
        """
        return math.inf
