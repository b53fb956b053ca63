"""Strain limiting as a force term."""

from typing import Any

import warp as wp

from ..launching import launch
from ..model import Model
from ..state import State
from .base import Linearization


class StrainLimit:
    """Second, stiffer springs beyond the fabric's strain limit (``kernels/strain_limit.py``).

    Args:
        model: the model; ``model.spring_limit`` and ``model.spring_limit_stiffness`` are its limits.
    """

    name = "strain_limit"
    velocity_dependent = False

    def __init__(self, model: Model):
        self.model = model

    def accumulate(self, state: State, time_offset: float) -> None:
        """Adds the forces of overstretched springs [N] to ``state.particle_f``."""
        inputs = [*self._rows(), *self._law(), state.particle_q]
        self._launch("gather_forces", self.model.particle_count, inputs, state.particle_f)

    def energy(self, state: State) -> dict[str, float]:
        """What overstretched springs add to the energy of springs [J]."""
        model = self.model
        out = wp.zeros(model.world_count, dtype=wp.float64, device=model.device)
        self._launch("energy", model.spring_count, [model.particle_world, *self._law(), state.particle_q], out)
        return {"spring": float(out.numpy().sum())}

    def hessian_product(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds a K x to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        inputs = [*self._rows(), *self._law(), at.state.particle_q, x, at.stiffness]
        self._launch("gather_products", self.model.particle_count, inputs, out)

    def hessian_diagonal(self, at: Linearization, out: wp.array) -> None:
        """Adds the diagonal blocks of a K to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        inputs = [*self._rows(), *self._law(), at.state.particle_q, at.stiffness]
        self._launch("diagonal", self.model.particle_count, inputs, out)

    def parameters(self) -> dict[str, wp.array]:
        """Strain limit [-] and k_L [N] of each spring."""
        names = ("spring_limit", "spring_limit_stiffness")
        return {name: getattr(self.model, name) for name in names}

    def _rows(self) -> list[wp.array]:
        return [self.model.particle_spring_start, self.model.particle_spring_ids]

    def _law(self) -> list[wp.array]:
        model = self.model
        return [model.spring_indices, model.spring_rest_length, model.spring_limit, model.spring_limit_stiffness]

    def _launch(self, kernel: str, dim: int, inputs: list[Any], out: wp.array) -> None:
        model = self.model
        kernels = model.kernels.strain_limit
        launch(getattr(kernels, kernel), dim=dim, inputs=inputs, outputs=[out], device=model.device)
