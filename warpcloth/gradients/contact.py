"""Contact with obstacles as a recording."""

from functools import partial

import warp as wp

from ..contact import ContactStage
from ..launching import launch
from ..model import Model
from ..state import State
from .recording import Recording


def record_response(recording: Recording, contact: ContactStage, start: State, end: State, dt: float) -> None:
    """What obstacles do to ``end``, dt [s] after ``start``; they have been placed for that step."""
    model, shapes = contact.model, contact.model.shapes
    if shapes.count == 0:
        return
    given = _within_the_step(recording, contact, start, end)
    again = wp.zeros(model.particle_count, dtype=wp.int32, device=model.device)
    for shape in range(shapes.most):
        for number in range(int(model.kernels.obstacle_contact.MAX_PASSES)):
            launch = partial(_look, model, start, end, given, again, dt, shape, int(number == 0))
            recording.in_place(launch, [again, end.particle_q, end.particle_qd])
            if not again.numpy().any():
                break


def _within_the_step(recording: Recording, contact: ContactStage, start: State, end: State) -> list[wp.array]:
    """Velocity changes that obstacles gave in the solution of the step, and which obstacles; −1: none."""
    model = contact.model
    impulse = wp.zeros_like(model.particle_q, requires_grad=True)
    if contact.support is None:
        return [impulse, wp.full(model.particle_count, -1, dtype=wp.int32, device=model.device)]
    shape = wp.clone(contact.support.shape)
    with recording:
        contact.support.impulse_at(start, end, shape, impulse)
    return [impulse, shape]


def _look(
    model: Model, start: State, end: State, given: list[wp.array], again: wp.array, dt: float, shape: int, first: int
) -> None:
    shapes = model.shapes
    launch(
        model.kernels.obstacle_contact.respond_once,
        dim=model.particle_count,
        inputs=[
            model.particle_inv_mass, model.particle_world, model.particle_radius, model.particle_friction,
            shapes.shapes, start.particle_q, start.particle_qd, shapes.start, shapes.end, dt, *given, shape, first,
        ],
        outputs=[again, end.particle_q, end.particle_qd],
        device=model.device,
    )  # fmt: skip
