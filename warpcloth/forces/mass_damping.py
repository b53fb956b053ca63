"""Damping in proportion to mass."""

from typing import Any

import numpy as np
import warp as wp

from .. import validate
from ..launching import launch
from ..model import Model
from ..state import State
from .base import Linearization
from .user import UserForce


class MassDamping(UserForce):
    """A force −c m v on every particle: without others, velocities fall by the factor e in 1/c.

    It damps every motion alike, falling included, whatever the mesh; ``Fabric.damping_time`` damps deformation only.
    Given as ``Simulation(model, forces=[MassDamping(model, 5.0)])``.

    Args:
        model: the model.
        rate: c [1/s]. Explicit schemes need steps well below 2/c.

    Raises:
        InputError: c is negative or not a number.
    """

    name = "mass_damping"
    velocity_dependent = True
    launches_recorded = True

    def __init__(self, model: Model, rate: float):
        self.model, self.rate = model, validate.number(rate, "rate", minimum=0.0, maximum=1e6)

    def accumulate(self, state: State, time_offset: float) -> None:
        """Adds the force [N] to ``state.particle_f``."""
        self._add("add_product", -self.rate, [state.particle_qd], state.particle_f)

    def hessian_product(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds b C x to ``out``, C = c m."""
        self._add("add_product", at.damping * self.rate, [x], out)

    def hessian_diagonal(self, at: Linearization, out: wp.array) -> None:
        """Adds the diagonal blocks of b C to ``out``."""
        self._add("add_diagonal", at.damping * self.rate, [], out)

    def parameters(self) -> dict[str, wp.array]:
        """None of its own: there are gradients through it, and with respect to masses, but not to the rate."""
        return {}

    def couplings(self) -> np.ndarray:
        """None between particles; see :class:`~warpcloth.forces.block_matrix.Assembled`."""
        return np.zeros((0, 2), np.int32)

    def add_blocks(self, at: Linearization, slots: wp.array, rows: Any) -> None:
        """Adds b C to ``rows``."""
        self.hessian_diagonal(at, rows.own)

    def _add(self, kernel: str, rate: float, inputs: list[Any], out: wp.array) -> None:
        model = self.model
        launch(
            getattr(model.kernels.mass_damping, kernel),
            dim=model.particle_count,
            inputs=[model.particle_mass, rate, *inputs],
            outputs=[out],
            device=model.device,
        )
