"""Particles against obstacles, once per step; the method is described in ``kernels/obstacle_contact.py``."""

import warp as wp

from ..launching import copy, launch
from ..model import Model
from ..state import State
from .obstacle_support import ObstacleSupport


class ObstacleResponse:
    """Corrects the end of each step against all obstacles of the model.

    Args:
        model: the model.
        support: what obstacles already do within the step; None: nothing.
        remembers: whether ``holds`` is kept.

    Attributes:
        holds: per particle the unit normal of an obstacle that held it up in the last step, and the obstacle's velocity
            along it [m/s], or zero; may be empty.
    """

    def __init__(self, model: Model, support: ObstacleSupport | None = None, remembers: bool = False):
        self.model = model
        none = wp.full(model.particle_count, -1, dtype=wp.int32, device=model.device)
        self._shape = none if support is None else support.shape
        self._impulse = wp.zeros_like(model.particle_q) if support is None else support.impulse
        vec4 = model.kernels.precision.vec4
        self.holds = wp.zeros(model.particle_count if remembers else 0, dtype=vec4, device=model.device)
        self._clear_of = wp.zeros_like(model.particle_q)
        self._clearance = wp.zeros(model.particle_count, dtype=model.real, device=model.device)

    def begin(self, state: State, span: float) -> None:
        """Looks which particles are far from all obstacles for some ``span`` [s]; obstacles have been placed."""
        model, shapes = self.model, self.model.shapes
        copy(self._clear_of, state.particle_q)
        launch(
            model.kernels.obstacle_clearance.find_clearance,
            dim=model.particle_count,
            inputs=[
                model.particle_world, model.particle_radius, shapes.shapes, state.particle_q, state.particle_qd,
                shapes.end, span,
            ],
            outputs=[self._clearance],
            device=model.device,
        )  # fmt: skip

    def resolve(self, state_in: State, state_out: State, dt: float) -> None:
        """Corrects ``state_out``, dt [s] after ``state_in``; obstacles have been placed. Launches kernels only."""
        model, shapes = self.model, self.model.shapes
        if shapes.count == 0:
            return
        launch(
            model.kernels.obstacle_contact.respond,
            dim=model.particle_count,
            inputs=[
                model.particle_inv_mass, model.particle_world, model.particle_radius, model.particle_friction,
                shapes.shapes, state_in.particle_q, state_in.particle_qd, shapes.start, shapes.end, dt,
                self._impulse, self._shape, self._clear_of, self._clearance,
            ],
            outputs=[self.holds, state_out.particle_q, state_out.particle_qd],
            device=model.device,
        )  # fmt: skip
