"""Obstacles as a force term of implicit steps; the method is described in ``kernels/obstacle_support.py``."""

from typing import Any

import numpy as np
import warp as wp

from ..forces import Linearization
from ..launching import fill, launch
from ..model import Model
from ..state import State

FREE_LOOKS = 12  # places in a step after which planes stay; easy steps end before
MOST_LOOKS = 2**30  # for gradients, whose adjoint looks anew


class ObstacleSupport:
    """Holds particles up within the solution of a step, so that springs know what they hang on.

    Args:
        model: the model, with obstacles.
        share: γ of the scheme: by this share of the step a force at its end changes velocities.

    Attributes:
        impulse: velocity change [m/s] of each particle by the latest forces. shape: the obstacle that gave it, or −1.
    """

    name = "obstacles"
    velocity_dependent = True

    def __init__(self, model: Model, share: float):
        self.model, self.share = model, share
        n, device = model.particle_count, model.device
        mat33 = model.kernels.precision.mat33
        self.stiffness, self.damping, self.sliding = (wp.zeros(n, dtype=mat33, device=device) for _ in range(3))
        self.impulse = wp.zeros(n, dtype=model.vec3, device=device)
        self.shape = wp.full(n, -1, dtype=wp.int32, device=device)
        self._planes = model.kernels.obstacle_support.Planes()
        for names, dtype in (
            (("looks", "shape"), wp.int32),
            (("seen", "normal", "surface", "spot"), model.vec3),
            (("gap", "start_gap"), model.real),
        ):
            for name in names:
                setattr(self._planes, name, wp.zeros(n, dtype=dtype, device=device))
        self._start, self._dt = model.particle_q, 1.0
        self._for_gradients = model.differentiable and not model.shapes.meshes
        self._unused = wp.zeros_like(self.impulse)
        self._free_looks = MOST_LOOKS if self._for_gradients else FREE_LOOKS

    def begin(self, state: State, dt: float) -> None:
        """A step of dt [s] starts at ``state``; obstacles have been placed."""
        self._start, self._dt = state.particle_q, dt
        fill(self._planes.looks)
        fill(self._planes.shape, -1)

    def accumulate(self, state: State, time_offset: float) -> None:
        """Adds the forces [N] at ``state``, the end of the step, to ``state.particle_f``."""
        force = self._unused if self._for_gradients else state.particle_f
        launch(
            self.model.kernels.obstacle_support.support,
            dim=self.model.particle_count,
            inputs=[*self._inputs(self._start, state), self._free_looks],
            outputs=[force, self.stiffness, self.damping, self.sliding, self.impulse, self.shape, self._planes],
            device=self.model.device,
            record_tape=False,
        )
        if self._for_gradients:
            self._launch_each(self._start, state, self.shape, state.particle_f, self._unused)

    def impulse_at(self, start: State, end: State, shape: wp.array, impulse: wp.array) -> None:
        """Writes the impulse [m/s] of obstacles ``shape`` at ``end``, a step after ``start``; tapes may record it."""
        self._launch_each(start.particle_q, end, shape, self._unused, impulse)

    def _launch_each(self, start: wp.array, end: State, shape: wp.array, force: wp.array, impulse: wp.array) -> None:
        """Obstacle by obstacle, by the kernel that has an adjoint."""
        for number in range(self.model.shapes.most):
            launch(
                self.model.kernels.obstacle_support.support_once,
                dim=self.model.particle_count,
                inputs=[*self._inputs(start, end), shape, number],
                outputs=[force, impulse],
                device=self.model.device,
            )

    def _inputs(self, start: wp.array, end: State) -> list:
        model, shapes = self.model, self.model.shapes
        return [
            model.particle_mass, model.particle_inv_mass, model.particle_world, model.particle_radius,
            model.particle_friction, shapes.shapes, start, end.particle_q, end.particle_qd, shapes.start, shapes.end,
            self._dt, self.share * self._dt,
        ]  # fmt: skip

    def parameters(self) -> dict[str, wp.array]:
        """Coefficients of friction [-] of particles and of obstacles."""
        return {
            "particle_friction": self.model.particle_friction,
            "obstacle_friction": self.model.shapes.shapes.friction,
        }

    def energy(self, state: State) -> dict[str, float]:
        """None: at the ends of steps nothing is pressed in."""
        return {}

    def hessian_product(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds (a K + b C) x, of the latest forces, to ``out``; the change of friction with pressure is left out."""
        self._launch("products", at, [x], out)

    def hessian_diagonal(self, at: Linearization, out: wp.array) -> None:
        """Adds the 3×3 diagonal blocks of a K + b C to ``out``."""
        self._launch("diagonal", at, [], out)

    def couplings(self) -> np.ndarray:
        """None between particles; see :class:`~warpcloth.forces.Assembled`."""
        return np.zeros((0, 2), np.int32)

    def add_blocks(self, at: Linearization, slots: wp.array, rows: Any) -> None:
        """Adds a K + b C, of the latest forces, to ``rows``."""
        self.hessian_diagonal(at, rows.own)

    def _launch(self, kernel: str, at: Linearization, x: list, out: wp.array) -> None:
        model = self.model
        blocks = [self.stiffness, self.damping, self.sliding]
        launch(
            getattr(model.kernels.obstacle_support, kernel),
            dim=model.particle_count,
            inputs=[model.particle_world, at.world_project, *blocks, *x, at.stiffness, at.damping],
            outputs=[out],
            device=model.device,
        )
