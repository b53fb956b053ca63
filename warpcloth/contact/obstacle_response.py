"""Particles against obstacles, once per step; the method is described in ``kernels/obstacle_contact.py``."""

import warp as wp

from ..model import Model
from ..state import State


class ObstacleResponse:
    """Corrects the end of each step against all obstacles of the model."""

    def __init__(self, model: Model):
        self.model = model

    def resolve(self, state_in: State, state_out: State, dt: float) -> None:
        """Corrects ``state_out``, dt [s] after ``state_in``; obstacles have been placed. Launches kernels only."""
        model, shapes = self.model, self.model.shapes
        if shapes.count == 0:
            return
        wp.launch(
            model.kernels.obstacle_contact.respond,
            dim=model.particle_count,
            inputs=[
                model.particle_inv_mass, model.particle_world, model.particle_radius, model.particle_friction,
                shapes.shapes, state_in.particle_q, state_in.particle_qd, shapes.start, shapes.end, dt,
            ],
            outputs=[state_out.particle_q, state_out.particle_qd],
            device=model.device,
        )  # fmt: skip
