"""Symplectic (semi-implicit) Euler: velocity first, then position with the new velocity."""

import math

import warp as wp

from ..forces import Forces
from ..kinematics import drive_pins
from ..model import Model
from ..state import State
from .base import Integrator


class SymplecticEuler(Integrator):
    """v ← v + dt a(x, v), x ← x + dt v."""

    name = "symplectic_euler"
    order = 1
    implicit = False
    symplectic = True
    capturable = True
    conserves_angular_momentum = True
    reference = "Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), I.1.2"
    cost = "1 force evaluation"
    use = "the plain choice for springs: robust and cheap, many small steps for stiff cloth"

    def __init__(self, model: Model):
        pass

    def step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """One step; see :class:`~warpcloth.integrators.base.Integrator`."""
        forces.evaluate(state_in)
        wp.launch(
            model.kernels.particles.symplectic_euler,
            dim=model.particle_count,
            inputs=[model.particle_inv_mass, state_in.particle_q, state_in.particle_qd, state_in.particle_f, dt],
            outputs=[state_out.particle_q, state_out.particle_qd],
            device=model.device,
        )
        drive_pins(model, state_in.world_time, dt, state_out.particle_q, state_out.particle_qd)

    @classmethod
    def stable_step(cls, omega: float, gamma: float) -> float:
        """Largest root of ω² dt² + 2 γ dt = 4, which is 2 (√(1 + ζ²) − ζ)/ω with γ = 2 ζ ω."""
        root = gamma + math.sqrt(gamma * gamma + 4.0 * omega * omega)
        return 4.0 / root if root > 0.0 else math.inf
