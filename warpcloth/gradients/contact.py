"""Contact with obstacles as a recording."""

from functools import partial

import numpy as np
import warp as wp

from ..model import Model
from ..state import State
from .recording import Recording


def record_response(recording: Recording, model: Model, start: State, end: State, dt: float) -> None:
    """What obstacles do to ``end``, dt [s] after ``start``; they have been placed for that step."""
    shapes = model.shapes
    if shapes.count == 0:
        return
    most = int(np.diff(shapes.shapes.world_start.numpy()).max())
    again = wp.zeros(model.particle_count, dtype=wp.int32, device=model.device)
    for shape in range(most):
        for number in range(int(model.kernels.obstacle_contact.MAX_PASSES)):
            launch = partial(_look, model, start, end, again, dt, shape, int(number == 0))
            recording.in_place(launch, [again, end.particle_q, end.particle_qd])
            if not again.numpy().any():
                break


def _look(model: Model, start: State, end: State, again: wp.array, dt: float, shape: int, first: int) -> None:
    shapes = model.shapes
    wp.launch(
        model.kernels.obstacle_contact.respond_once,
        dim=model.particle_count,
        inputs=[
            model.particle_inv_mass, model.particle_world, model.particle_radius, model.particle_friction,
            shapes.shapes, start.particle_q, start.particle_qd, shapes.start, shapes.end, dt, shape, first,
        ],
        outputs=[again, end.particle_q, end.particle_qd],
        device=model.device,
    )  # fmt: skip
