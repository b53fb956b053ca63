"""Woven triangles of the model as a force term."""

from typing import Any

import numpy as np
import warp as wp

from .. import validate
from ..launching import launch
from ..model import Model
from ..state import State
from .base import Linearization
from .block_matrix import corner_pairs
from .springs import ASSEMBLIES


class Woven:
    """Springs along the yarns inside triangles (the law of ``kernels/woven.py``), strain limits included.

    Args:
        model: the model whose triangles these are.
        assembly: "scatter" (one thread per triangle, atomic adds) or "gather" (fixed order: bitwise repeatable on a GPU
            too).
        ranges: into how many ranges launches may be cut on the CPU; all is then gathered, to the same sums.

    Raises:
        InputError: unknown assembly.
    """

    name = "woven"

    def __init__(self, model: Model, assembly: str = "scatter", ranges: int = 1):
        self.model = model
        self.gathers = validate.choice(assembly, ASSEMBLIES, "assembly") == "gather" or ranges > 1
        self.velocity_dependent = bool(np.any(model.woven.law.numpy()[:, 0] > 0.0))
        wide: dict[str, Any] = {"device": model.device, "requires_grad": model.differentiable}
        self._pulls = wp.zeros(model.woven_count if self.gathers else 0, dtype=model.kernels.woven.Pair, **wide)
        self._rows = [model.particle_woven_start, model.particle_woven_ids]

    def accumulate(self, state: State, time_offset: float) -> None:
        """Adds the forces of yarns [N] to ``state.particle_f``."""
        kernels, inputs = self.model.kernels.woven, [self.model.woven, state.particle_q, state.particle_qd]
        if self.gathers:
            self._launch(kernels.pulls, inputs, self._pulls)
            self._gather(state.particle_f)
        else:
            self._launch(kernels.scatter_forces, inputs, state.particle_f)

    def hessian_product(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds (a K + b C) x to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        model, kernels = self.model, self.model.kernels.woven_hessian
        where = [at.world_project, at.state.particle_q, at.state.particle_qd, x, at.stiffness, at.damping]
        inputs = [model.particle_world, model.woven, *where]
        if self.gathers:
            self._launch(kernels.product_pulls, inputs, self._pulls)
            self._gather(out)
        else:
            self._launch(kernels.scatter_products, inputs, out)

    def hessian_diagonal(self, at: Linearization, out: wp.array) -> None:
        """Adds the diagonal blocks of a K + b C to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        model = self.model
        where = [at.world_project, at.state.particle_q, at.state.particle_qd, at.stiffness, at.damping]
        launch(
            model.kernels.woven_hessian.diagonal,
            dim=model.particle_count,
            inputs=[model.particle_world, model.woven, *self._rows, *where],
            outputs=[out],
            device=model.device,
        )

    def couplings(self) -> np.ndarray:
        """All pairs of corners of each triangle; see :class:`~warpcloth.forces.block_matrix.Assembled`."""
        return corner_pairs(self.model.woven.corners.numpy())

    def add_blocks(self, at: Linearization, slots: wp.array, rows: Any) -> None:
        """Adds a K + b C to ``rows``; see :class:`~warpcloth.forces.block_matrix.Assembled`."""
        model = self.model
        where = [at.world_project, at.state.particle_q, at.state.particle_qd, at.stiffness, at.damping]
        launch(
            model.kernels.woven_hessian.add_blocks,
            dim=model.particle_count,
            inputs=[model.particle_world, model.woven, *self._rows, slots, *where],
            outputs=[rows],
            device=model.device,
        )

    def energy(self, state: State) -> dict[str, float]:
        """Energy of yarns [J], with what strain limits add."""
        model = self.model
        out = wp.zeros(model.world_count, dtype=wp.float64, device=model.device)
        self._launch(model.kernels.woven.energy, [model.particle_world, model.woven, state.particle_q], out)
        return {"spring": float(out.numpy().sum())}

    def parameters(self) -> dict[str, wp.array]:
        """Of each triangle C A [J] of warp, weft and ±45°, and (k_d/k_s [s], strain limit [-], k_L/k_s [-])."""
        return {"woven_stiffness": self.model.woven.stiffness, "woven_law": self.model.woven.law}

    def _launch(self, kernel: wp.Kernel, inputs: list, out: wp.array) -> None:
        """One thread per triangle."""
        model = self.model
        launch(kernel, dim=model.woven_count, inputs=inputs, outputs=[out], device=model.device)

    def _gather(self, out: wp.array) -> None:
        """One thread per particle."""
        model = self.model
        inputs = [model.woven, *self._rows, self._pulls]
        kernel = model.kernels.woven.gather
        launch(kernel, dim=model.particle_count, inputs=inputs, outputs=[out], device=model.device)
