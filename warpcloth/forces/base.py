"""The sum of all forces on the particles of a model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any, NamedTuple, Protocol, runtime_checkable

import warp as wp

from .. import validate
from ..errors import InputError
from ..launching import copy, fill, launch
from ..model import Model
from ..state import Memory, State
from .user import UserForce


@dataclass(frozen=True, eq=False)
class Linearization:
    """The matrix a K + b C at a state, K = −∂f/∂x [N/m], C = −∂f/∂v [N s/m]; known by its products only.

    Attributes:
        state: positions and velocities at which forces are linearised.
        stiffness, damping: a and b.
        world_project: 1 for worlds in which each element's K is made positive semi-definite, else 0; of the model's
            scalar type, shape [world_count].
        time_offset: when the state is [s], after its ``world_time``.
        unlike: one of the same state, time, a and b, but perhaps not projected alike; None: none that is known.
    """

    state: State
    stiffness: float
    damping: float
    world_project: wp.array
    time_offset: float = 0.0
    unlike: "Linearization | None" = None

    def projected(self, world_project: wp.array) -> "Linearization":
        """The same, but for what is projected."""
        return replace(self, world_project=world_project, unlike=self)


class Move(NamedTuple):
    """How particles go on: x ← x + drift v + position_weight f/m, v ← v + velocity_weight f/m; in s, s² and s."""

    drift: float
    position_weight: float
    velocity_weight: float


class Hessian(Protocol):
    """A matrix a K + b C known by its products, as solvers need it; see :class:`ForceTerm`."""

    def hessian_product(self, at: Linearization, x: wp.array, out: wp.array) -> None: ...

    def hessian_diagonal(self, at: Linearization, out: wp.array) -> None: ...


class ForceTerm(Protocol):
    """One physical force. It launches kernels only: no allocation, no host synchronisation.

    ``velocity_dependent`` tells schemes that velocities must be predicted where forces are needed, which costs them
    more evaluations.
    """

    name: str
    velocity_dependent: bool

    def accumulate(self, state: State, time_offset: float) -> None:
        """Adds the force [N] at ``state``, whose time is the worlds' time + ``time_offset`` [s], to ``particle_f``."""
        ...

    def energy(self, state: State) -> dict[str, float]:
        """Potential energies [J] by name, summed over all worlds; empty for a force without potential."""
        ...

    def hessian_product(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds (a K + b C) x to ``out``; both vec3, shape [particle_count], not the same array.

        K and C are symmetric; a non-symmetric or minor part may be left out, which slows Newton's method down but does
        not change what it converges to. A constant force adds nothing.
        """
        ...

    def hessian_diagonal(self, at: Linearization, out: wp.array) -> None:
        """Adds the 3×3 diagonal blocks of a K + b C to ``out``, mat33, shape [particle_count]."""
        ...


@runtime_checkable
class Remembering(Protocol):
    """A force that depends on what was before: a :class:`ForceTerm` with a memory that moves on with steps."""

    def advance(self, state: State) -> None:
        """The end of a step, at ``state``: once for each step, not for each evaluation, and for each of those that an
        adaptive scheme divides its step into. Launches kernels only.

        Clears ``state.forces_current`` if the force at ``state`` may be another one then.
        """
        ...

    def memory(self) -> Sequence[Memory]:
        """All that the force depends on besides the state."""
        ...


@runtime_checkable
class Prepared(Protocol):
    """A force that keeps copies of what the model has: a :class:`ForceTerm` that brings them up to date."""

    def prepare(self) -> None:
        """Before each frame. Launches kernels only."""
        ...


@runtime_checkable
class Turning(Protocol):
    """A force that turns with the cloth: a :class:`ForceTerm` that schemes which keep it as it was when a step began
    may ask for in the direction that it will have at the end."""

    def accumulate_ahead(self, state: State, ahead: float) -> None:
        """``accumulate`` at ``state``, but turned as far as its velocities will have turned the cloth in ``ahead`` [s].

        Of the forces on something that turns freely no moment must come from that.
        """
        ...


@runtime_checkable
class Jerking(Protocol):
    """A force that comes and goes at once, as a hand does: a :class:`ForceTerm` that says where; at most one."""

    def jerked_worlds(self) -> wp.array:
        """1 for worlds on which it acts, else 0: int32, shape [world_count]."""
        ...


@runtime_checkable
class Opening(Protocol):
    """A force that can be worked out together with gravity: a :class:`ForceTerm` that, where it is the first, may, and
    where it is the only one may move the particles, too."""

    def begin(self, state: State, world_gravity: wp.array) -> bool:
        """Writes m g and the force [N] at ``state`` into ``particle_f``, whatever was there; False: does nothing."""
        ...

    def advance_alone(self, start: State, end: State, world_gravity: wp.array, move: Move) -> bool:
        """The same at ``start``, and writes what it makes of the particles into ``end``; False: does nothing."""
        ...


@runtime_checkable
class Differentiable(Protocol):
    """A force whose kernels have adjoints in differentiable models: a :class:`ForceTerm` that says what it depends on.

    Its scratch arrays have gradients there, too (``requires_grad=model.differentiable``), and adjoints must find in
    them what the latest evaluation left.
    """

    def parameters(self) -> dict[str, wp.array]:
        """Arrays with respect to which there are gradients, by name."""
        ...


class Blocks(Protocol):
    """The matrix of some of the terms, written down; see :class:`~warpcloth.forces.block_matrix.BlockMatrix`."""

    @property
    def terms(self) -> Sequence[Any]: ...

    def assemble(self, at: Linearization) -> None: ...

    def multiply(self, at: Linearization, x: wp.array, out: wp.array) -> None: ...

    @property
    def with_diagonal(self) -> Sequence[Any]: ...

    def add_diagonal(self, out: wp.array) -> None: ...


class Forces:
    """Gravity and all force terms of a simulation.

    Args:
        model: the model.
        terms: force terms, applied in this order.
        world_gravity: gravitational acceleration of each world [m/s²], vec3, shape [world_count].

    Attributes:
        blocks: where :meth:`linearize` writes matrices down; None: nowhere.
        latest: the array [N] that the latest :meth:`evaluate` has written to; None: there was none.
    """

    def __init__(self, model: Model, terms: Sequence[ForceTerm], world_gravity: wp.array):
        self.model = model
        self.terms = list(terms)
        self.world_gravity = world_gravity
        self.evaluations = 0
        self.blocks: Blocks | None = None
        self.latest: wp.array | None = None
        self._linearized: Linearization | None = None

    @property
    def velocity_dependent(self) -> bool:
        """Whether any term depends on velocities."""
        return any(term.velocity_dependent for term in self.terms)

    def prepare(self) -> None:
        """The start of a frame: copies of what the model has are brought up to date."""
        for term in self.terms:
            if isinstance(term, Prepared):
                term.prepare()

    def mark_jerked(self, worlds: wp.array) -> None:
        """Writes 1 for worlds whose forces come and go at once, else 0, into ``worlds``: int32, shape [world_count]."""
        fill(worlds)
        for term in self.terms:
            if isinstance(term, Jerking):
                copy(worlds, term.jerked_worlds())

    def advance(self, state: State) -> None:
        """The end of a step, at ``state``: what forces remember moves on."""
        for term in self.terms:
            if isinstance(term, Remembering):
                term.advance(state)

    def memory(self) -> list[Memory]:
        """All that forces depend on besides the state."""
        return [item for term in self.terms if isinstance(term, Remembering) for item in term.memory()]

    def evaluate(
        self, state: State, time_offset: float = 0.0, *, without: Sequence[str] = (), ahead: float = 0.0
    ) -> None:
        """Writes the total force [N] at ``state`` into ``state.particle_f``.

        Terms that turn with the cloth (:class:`Turning`) do so as far as it will have turned in ``ahead`` [s].

        ``without`` names terms of the model to leave out: those that a scheme treats in another way, such as springs as
        constraints; what the caller has named so acts all the same. What such a scheme does instead of an evaluation it
        adds to ``evaluations`` itself.
        """
        model = self.model
        self.evaluations += 0 if without else 1
        self.latest = state.particle_f
        terms = [term for term in self.terms if isinstance(term, UserForce) or term.name not in without]
        if terms and isinstance(terms[0], Opening) and terms[0].begin(state, self.world_gravity):
            terms = terms[1:]
        else:
            inputs = [model.particle_mass, model.particle_world, self.world_gravity]
            model.launch_particles("particles", "set_gravity_force", inputs, [state.particle_f])
        for term in terms:
            if ahead > 0.0 and isinstance(term, Turning):
                term.accumulate_ahead(state, ahead)
            else:
                term.accumulate(state, time_offset)

    def advance_at_once(self, start: State, end: State, move: Move) -> bool:
        """:meth:`evaluate` at ``start`` and the move from there to ``end``, another state, in one pass over memory;
        False: nothing was done, as not all that acts can be worked out so."""
        only = self.terms[0] if len(self.terms) == 1 else None
        if not isinstance(only, Opening) or start.particle_q.ptr == end.particle_q.ptr:
            return False
        if not only.advance_alone(start, end, self.world_gravity, move):
            return False
        self.evaluations += 1
        self.latest = start.particle_f
        return True

    def linearize(self, at: Linearization) -> None:
        """The start of many products at one state, with this very ``at``: what can be is computed once for all of them.

        To be called again when the state has changed.
        """
        if self.blocks is not None:
            self.blocks.assemble(at)
            self._linearized = at

    def hessian_product(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds (a K + b C) x of all terms to ``out``; both vec3, shape [particle_count], not the same array."""
        written: Sequence[Any] = ()
        if self.blocks is not None and self._linearized is at:
            self.blocks.multiply(at, x, out)
            written = self.blocks.terms
        for term in self.terms:
            if term not in written:
                term.hessian_product(at, x, out)

    def hessian_diagonal(self, at: Linearization, out: wp.array) -> None:
        """Adds the 3×3 diagonal blocks of a K + b C of all terms to ``out``, mat33, shape [particle_count]."""
        written: Sequence[Any] = ()
        if self.blocks is not None and at.unlike is not None and self._linearized is at.unlike:
            self.blocks.add_diagonal(out)
            written = self.blocks.with_diagonal
        for term in self.terms:
            if term not in written:
                term.hessian_diagonal(at, out)

    def energy(self, state: State) -> dict[str, float]:
        """Potential energies [J] by name, gravity's (−Σ m g·x) included, summed over all worlds."""
        model = self.model
        out = wp.zeros(model.world_count, dtype=wp.float64, device=model.device)
        launch(
            model.kernels.particles.gravity_energy,
            dim=model.particle_count,
            inputs=[model.particle_mass, model.particle_world, self.world_gravity, state.particle_q],
            outputs=[out],
            device=model.device,
        )
        energies = {"spring": 0.0, "bending": 0.0, "gravity": float(out.numpy().sum())}
        for term in self.terms:
            for name, value in _energies(term, state):
                energies[name] = energies.get(name, 0.0) + value
        return energies


def _energies(term: ForceTerm, state: State) -> list[tuple[str, float]]:
    """What a term says of its energies [J], by name; it may be a caller's own."""
    found = term.energy(state)
    if not isinstance(found, Mapping) or not all(isinstance(value, Real) for value in found.values()):
        raise InputError(
            f"The method energy of {type(term).__name__} must return a dict of numbers [J] by name, empty where there "
            f"is no potential, got {validate.shown(found)}."
        )
    return list(found.items())
