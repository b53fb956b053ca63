"""What the position-based schemes share: the step begins with the inertial displacement and ends with velocities."""

import math
from abc import abstractmethod

import warp as wp

from ..forces import Forces
from ..kinematics import drive_pins
from ..model import Model
from ..state import State
from .base import Integrator

MAX_ITERATIONS = 100_000


class PositionStep(Integrator):
    """A step h solved for the displacement δ of each particle: m (δ − δ̂)/h² = spring forces at the end of the step.

    δ̂ = h v + h² f/m holds gravity and all other forces but springs, evaluated at the start of the step.
    """

    implicit = True
    symplectic = False
    capturable = True

    def __init__(self, model: Model):
        self.inertial = wp.zeros(model.particle_count, dtype=model.vec3, device=model.device)
        self.displacement = wp.zeros_like(self.inertial)

    def step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """One step; see :class:`~warpcloth.integrators.base.Integrator`."""
        forces.evaluate(state_in, without=("springs",))
        self._predict(model, state_in, state_out, dt)
        self._solve(model, state_in, forces, dt)
        wp.launch(
            model.kernels.position_step.finish,
            dim=model.particle_count,
            inputs=[model.particle_inv_mass, state_in.particle_q, self.displacement, dt],
            outputs=[state_out.particle_q, state_out.particle_qd],
            device=model.device,
        )

    def _predict(self, model: Model, state_in: State, state_out: State, dt: float) -> None:
        """δ̂ of all particles; pins where they will be."""
        kernels = model.kernels.position_step
        wp.launch(
            kernels.predict,
            dim=model.particle_count,
            inputs=[model.particle_inv_mass, state_in.particle_q, state_in.particle_qd, state_in.particle_f, dt],
            outputs=[self.inertial, self.displacement, state_out.particle_q, state_out.particle_qd],
            device=model.device,
        )
        pins = model.moving_pins.particle
        if len(pins) > 0:
            drive_pins(model, state_in.world_time, dt, state_out.particle_q, state_out.particle_qd)
            wp.launch(
                kernels.displace_pins,
                dim=len(pins),
                inputs=[pins, state_in.particle_q, state_out.particle_q],
                outputs=[self.displacement],
                device=model.device,
            )

    @abstractmethod
    def _solve(self, model: Model, state_in: State, forces: Forces, dt: float) -> None:
        """Improves ``self.displacement``; adds the number of sweeps over all springs to ``forces.evaluations``."""

    @classmethod
    def stable_step(cls, omega: float, gamma: float) -> float:
        """No limit."""
        return math.inf
