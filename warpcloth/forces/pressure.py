"""Pressure inside closed cloths as a force term."""

from typing import Any

import warp as wp

from ..launching import fill, launch
from ..model import Model
from ..state import State
from .base import Linearization


class Pressure:
    """Given pressure, or that of gas shut in, on closed cloths (``kernels/pressure.py``).

    Of K the part is kept by which a gas resists a change of its volume; how forces turn with their triangles is left
    out. Volumes are sums of atomic adds in float64, so on a GPU the last bits of a gas's pressure may differ.

    Args:
        model: the model; ``model.bags`` are its closed cloths.
    """

    name = "pressure"
    velocity_dependent = False

    def __init__(self, model: Model):
        self.model = model
        self._bags = model.kernels.pressure.Bags()
        for name, values in model.bags.items():
            dtype = wp.int32 if name == "gas" else wp.float64
            setattr(self._bags, name, model.array(values, dtype, requires_grad=model.differentiable and name != "gas"))
        self._gas = bool(model.bags["gas"].any())
        wide: dict[str, Any] = {"device": model.device, "requires_grad": model.differentiable}
        self._volume = wp.zeros(model.bag_count, dtype=wp.float64, **wide)
        self._rate = wp.zeros_like(self._volume)
        self._per_triangle = wp.zeros(model.tri_count, dtype=model.vec3, **wide)

    def accumulate(self, state: State, time_offset: float) -> None:
        """Adds p N/3 [N] of every triangle to ``state.particle_f``."""
        self.accumulate_ahead(state, 0.0)

    def accumulate_ahead(self, state: State, ahead: float) -> None:
        """The same with the area vectors of ``ahead`` [s] later; see :class:`~warpcloth.forces.base.Turning`."""
        model = self.model
        if self._gas:
            self._measure(state)
        law = [model.tri_indices, model.tri_bag, self._bags]
        inputs = [*law, state.particle_q, state.particle_qd, self._volume, ahead]
        self._launch("triangle_forces", model.tri_count, inputs, self._per_triangle)
        self._add_corners(state.particle_f)

    def energy(self, state: State) -> dict[str, float]:
        """Energy of pressure and gas against the rest pose [J]."""
        self._measure(state)
        out = wp.zeros_like(self._volume)
        self._launch("energy", self.model.bag_count, [self._bags, self._volume], out)
        return {"pressure": float(out.numpy().sum())}

    def hessian_product(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds a K x to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        if not self._gas:
            return
        model, q = self.model, at.state.particle_q
        self._measure(at.state)
        fill(self._rate)
        self._launch("volume_rates", model.tri_count, [model.tri_indices, model.tri_bag, q, x], self._rate)
        inputs = [model.tri_indices, model.tri_bag, self._bags, q, self._volume, self._rate, at.stiffness]
        self._launch("triangle_products", model.tri_count, inputs, self._per_triangle)
        self._add_corners(out)

    def hessian_diagonal(self, at: Linearization, out: wp.array) -> None:
        """Adds the diagonal blocks of a K to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        if not self._gas:
            return
        model = self.model
        self._measure(at.state)
        rows = [model.particle_corner_start, model.particle_corner_ids]
        inputs = [*rows, model.tri_indices, model.tri_bag, self._bags, at.state.particle_q, self._volume, at.stiffness]
        self._launch("diagonal", model.particle_count, inputs, out)

    def parameters(self) -> dict[str, wp.array]:
        """The pressure over the ambient one at rest [Pa] of each closed cloth."""
        return {"bag_pressure": self._bags.pressure}

    def _measure(self, state: State) -> None:
        """Volumes of all closed cloths."""
        fill(self._volume)
        law = [self.model.tri_indices, self.model.tri_bag]
        self._launch("volumes", self.model.tri_count, [*law, state.particle_q], self._volume)

    def _add_corners(self, out: wp.array) -> None:
        model = self.model
        rows = [model.particle_corner_start, model.particle_corner_ids, model.tri_corner_share]
        launch(
            model.kernels.corners.add_corners,
            dim=model.particle_count,
            inputs=[*rows, self._per_triangle],
            outputs=[out],
            device=model.device,
        )

    def _launch(self, kernel: str, dim: int, inputs: list[Any], out: wp.array) -> None:
        device = self.model.device
        launch(getattr(self.model.kernels.pressure, kernel), dim=dim, inputs=inputs, outputs=[out], device=device)
