"""Drag and lift of the air as a force term."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from ..air import Air
from ..errors import InputError
from ..launching import launch
from ..model import Model
from ..state import State
from .base import Linearization
from .block_matrix import corner_pairs

WIND_FIELDS = ("density", "mean", "gust", "gust_rate", "start", "wave", "amplitude", "rate", "phase")


class AirDrag:
    """The air's force on every triangle (the law of ``kernels/air.py``).

    How the force changes as triangles turn is left out of K, and so is its damping by motions of a triangle in itself:
    Newton's method needs more iterations in wind, and where it converges, to the same. Cotton that flaps in 10 m/s
    takes it 100 and more in steps of 1/60 s, 6 in steps of a quarter of that.

    Args:
        model: the model; its triangles carry the coefficients of their fabrics.
        airs: density and wind of each world.
    """

    name = "air"

    def __init__(self, model: Model, airs: Sequence[Air]):
        self.model = model
        self.velocity_dependent = model.tri_count > 0 and any(air.density > 0.0 for air in airs)
        wide: dict[str, Any] = {"device": model.device, "requires_grad": model.differentiable}
        self._per_triangle = wp.zeros(model.tri_count, dtype=model.vec3, **wide)
        self._wind = _upload(model, airs)

    def assign(self, airs: Sequence[Air]) -> None:
        """Other air, one for each world, also in frames captured already.

        Raises:
            InputError: turbulence where there was none, or the other way round.
        """
        other = _upload(self.model, airs)
        if other.wave.shape != self._wind.wave.shape:
            raise InputError("Turbulence cannot begin or end in the middle of a simulation; only be changed.")
        for name in WIND_FIELDS:
            getattr(self._wind, name).assign(getattr(other, name))

    def accumulate(self, state: State, time_offset: float) -> None:
        """Adds the air's forces [N] to ``state.particle_f``."""
        model = self.model
        launch(
            model.kernels.air.triangle_forces,
            dim=model.tri_count,
            inputs=[*self._law(), state.world_time, time_offset, state.particle_q, state.particle_qd],
            outputs=[self._per_triangle],
            device=model.device,
        )
        self._add_corners(state.particle_f)

    def energy(self, state: State) -> dict[str, float]:
        """Nothing: air has no potential."""
        return {}

    def hessian_product(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds b C x to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        model, state = self.model, at.state
        when = [at.world_project, state.world_time, at.time_offset]
        where = [*when, state.particle_q, state.particle_qd, x, at.damping]
        launch(
            model.kernels.air_hessian.triangle_products,
            dim=model.tri_count,
            inputs=[*self._law(), *where],
            outputs=[self._per_triangle],
            device=model.device,
        )
        self._add_corners(out)

    def hessian_diagonal(self, at: Linearization, out: wp.array) -> None:
        """Adds the diagonal blocks of b C to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        model, state = self.model, at.state
        rows = [model.particle_corner_start, model.particle_corner_ids]
        when = [at.world_project, state.world_time, at.time_offset]
        where = [*when, state.particle_q, state.particle_qd, at.damping]
        launch(
            model.kernels.air_hessian.diagonal,
            dim=model.particle_count,
            inputs=[*rows, *self._law(), *where],
            outputs=[out],
            device=model.device,
        )

    def couplings(self) -> np.ndarray:
        """All pairs of corners of each triangle; see :class:`~warpcloth.forces.block_matrix.Assembled`."""
        return corner_pairs(self.model.tri_indices.numpy())

    def add_blocks(self, at: Linearization, slots: wp.array, rows: Any) -> None:
        """Adds b C to ``rows``; see :class:`~warpcloth.forces.block_matrix.Assembled`."""
        model, state = self.model, at.state
        corners = [model.particle_corner_start, model.particle_corner_ids, slots]
        when = [at.world_project, state.world_time, at.time_offset]
        where = [*when, state.particle_q, state.particle_qd, at.damping]
        launch(
            model.kernels.air_hessian.add_blocks,
            dim=model.particle_count,
            inputs=[*corners, *self._law(), *where],
            outputs=[rows],
            device=model.device,
        )

    def parameters(self) -> dict[str, wp.array]:
        """Coefficients [-] of each triangle; density [kg/m³] and mean wind [m/s] of each world."""
        model, wind = self.model, self._wind
        coefficients = {"tri_air_drag": model.tri_air_drag, "tri_air_friction": model.tri_air_friction}
        return {**coefficients, "air_density": wind.density, "wind": wind.mean}

    def _law(self) -> list[Any]:
        model = self.model
        coefficients = [model.tri_corner_share, model.tri_air_drag, model.tri_air_friction]
        return [model.tri_indices, *coefficients, model.particle_world, self._wind]

    def _add_corners(self, out: wp.array) -> None:
        model = self.model
        launch(
            model.kernels.corners.add_corners,
            dim=model.particle_count,
            inputs=[
                model.particle_corner_start, model.particle_corner_ids, model.tri_corner_share, self._per_triangle
            ],
            outputs=[out],
            device=model.device,
        )  # fmt: skip


def _upload(model: Model, airs: Sequence[Air]) -> Any:
    """The ``Wind`` struct of ``kernels/wind.py``."""
    wave, amplitude, rate, phase = (np.concatenate(parts) for parts in zip(*(air.waves() for air in airs), strict=True))
    wind = model.kernels.wind.Wind()
    gradient: dict[str, Any] = {"requires_grad": model.differentiable}
    wind.density = model.array([air.density for air in airs], model.real, **gradient)
    wind.mean = model.array([air.wind for air in airs], model.vec3, **gradient)
    wind.gust = model.array([air.gust for air in airs], model.real)
    wind.gust_rate = model.array([2.0 * np.pi / air.gust_period for air in airs], wp.float64)
    wind.start = model.array(np.cumsum([0, *(len(air.waves()[0]) for air in airs)]), wp.int32)
    wind.wave, wind.amplitude = model.array(wave, model.vec3), model.array(amplitude, model.vec3)
    wind.rate, wind.phase = model.array(rate, wp.float64), model.array(phase, wp.float64)
    return wind
