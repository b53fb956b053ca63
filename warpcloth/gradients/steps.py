"""Steps of the integrators as recordings: the same kernels, with arrays of their own wherever values must last."""

import copy
from collections.abc import Callable
from functools import partial

import warp as wp

from ..errors import NotDifferentiableError
from ..integrators import INTEGRATORS, Integrator
from ..integrators.implicit import ImplicitEuler
from ..integrators.runge_kutta import RungeKutta
from ..integrators.splitting import Splitting
from ..integrators.stages import Stages
from ..integrators.undamped import ImplicitMidpoint, ImplicitTrapezoid
from ..integrators.xpbd import Xpbd
from ..model import Model
from ..state import State
from .implicit import implicit_step
from .recording import Recording

RecordedStep = Callable[..., None]  # of (recording, scheme, model, start, end, dt), the scheme of its own class


def fresh_state(state: State) -> State:
    """Copies of positions and velocities, with gradients, at the same clock."""
    q, qd = (wp.clone(array, requires_grad=True) for array in (state.particle_q, state.particle_qd))
    return State(q, qd, wp.zeros_like(q, requires_grad=True), state.world_time)


def runge_kutta_step(
    recording: Recording, scheme: RungeKutta, model: Model, start: State, end: State, dt: float
) -> None:
    """Each stage has positions and velocities of its own."""
    again = copy.copy(scheme)
    again.stages = Stages(model, scheme.stages.count, kept=True)
    with recording:
        again.step(model, start, end, recording.forces, dt)


def splitting_step(recording: Recording, scheme: Splitting, model: Model, start: State, end: State, dt: float) -> None:
    """Each kick and drift ends in a state of its own."""
    count = len(scheme.sequence)
    ends = [*(fresh_state(start) for _ in range(count - 1)), end]
    scratch = [Stages(model, scheme.stages.count, kept=True) for _ in range(count)]
    with recording:
        scheme.take(model, start, ends, scratch, recording.forces, dt)


def xpbd_step(recording: Recording, scheme: Xpbd, model: Model, start: State, end: State, dt: float) -> None:
    """Parts of a sweep are solved in place, one after the other."""
    again = copy.copy(scheme)
    again.inertial, again.displacement = (wp.zeros_like(scheme.inertial, requires_grad=True) for _ in range(2))
    scheme.forget_shorter(model, dt)
    with recording:
        recording.forces.evaluate(start, without=again.solved_forces, ahead=again.ahead(dt))
        again.predict(model, start, end, dt)
    for part, turn in again.pieces(start, dt):
        recording.in_place(partial(part.solve, turn, again.displacement), [again.displacement, *part.arrays])
    with recording:
        again.finish(model, start, end, again.displacement, dt)


STEPS: dict[type, RecordedStep] = {
    RungeKutta: runge_kutta_step,
    Splitting: splitting_step,
    Xpbd: xpbd_step,
    ImplicitEuler: implicit_step,
    ImplicitMidpoint: implicit_step,
    ImplicitTrapezoid: implicit_step,
}


def recorded_step(scheme: Integrator) -> RecordedStep:
    """The function that records a step of ``scheme``.

    Raises:
        NotDifferentiableError: there is none.
    """
    found = _step_of(type(scheme))
    if found is None:
        names = ", ".join(name for name, cls in INTEGRATORS.items() if _step_of(cls) is not None)
        raise NotDifferentiableError(f"Integrator '{scheme.name}' has no gradients; these have: {names}.")
    return found


def _step_of(cls: type[Integrator]) -> RecordedStep | None:
    if cls.adaptive:
        return None
    return next((STEPS[base] for base in cls.__mro__ if base in STEPS), None)
