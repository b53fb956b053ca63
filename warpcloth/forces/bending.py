"""Bending elements of the model as a force term."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from .. import validate
from ..launching import launch
from ..model import Model
from ..state import Memory, State
from .base import Linearization
from .bending_lanes import BendingLanes, grouped
from .springs import ASSEMBLIES


class Bending:
    """Bending stiffness, its damping, and hysteresis (the law of ``kernels/bending_law.py``).

    Hysteresis has a memory, the slip of each element, which moves on once per step, in :meth:`advance`.

    Args:
        model: the model whose elements these are.
        assembly: "scatter" (one thread per element, atomic adds) or "gather" (fixed order: bitwise
            repeatable on a GPU too).
        ranges: into how many ranges launches may be cut on the CPU, where what scatters goes eight elements at a time
            (:class:`~warpcloth.forces.bending_lanes.BendingLanes`) or, in worlds that do not fit that, is gathered, to
            the same sums.

    Raises:
        InputError: unknown assembly.

    Attributes:
        slip: curvature at which each element would be free of friction [1/m], shape [bend_count].
    """

    name = "bending"
    never_projected = True  # Gauss and Newton's matrix is positive semi-definite as it is

    def __init__(self, model: Model, assembly: str = "scatter", ranges: int = 1):
        self.model, self.elements = model, model.bending
        self.gathers = validate.choice(assembly, ASSEMBLIES, "assembly") == "gather" or ranges > 1
        law = self.elements.law.numpy()
        self.velocity_dependent = bool(law[:, 1].any())
        self.slips = bool(self.elements.friction.numpy().any())
        wide: dict[str, Any] = {"device": model.device, "requires_grad": model.differentiable}
        self.slip = wp.zeros(model.bend_count, dtype=model.real, **wide)
        count = model.bend_count if self.gathers else 0
        self._moments = wp.zeros(count, dtype=model.kernels.bending.Moments, **wide)
        pairs = np.diff(self.elements.start.numpy()) ** 2
        self._pair_start = model.array(np.concatenate([[0], np.cumsum(pairs)]), wp.int32)
        self._rows = [model.particle_bend_start, model.particle_bend_ids, model.particle_bend_elements]
        self._lanes: BendingLanes | None = None
        self._left, self._left_count, self._left_rows = model.array([], wp.int32), model.bend_count, self._rows
        if assembly == "scatter" and model.device.is_cpu and not model.differentiable:
            self._arrange_lanes(ranges)

    def accumulate(self, state: State, time_offset: float) -> None:
        """Adds bending forces [N] to ``state.particle_f``."""
        kernels, where = self.model.kernels.bending, [self.slip, state.particle_q, state.particle_qd]
        if self._lanes is not None:
            self._lanes.accumulate(state, self.slip)
        if self.gathers and self._left_count > 0:
            self._launch_left(kernels.moments, where, self._moments)
            self._gather(kernels.gather_forces, self._left_rows, state.particle_f)
        else:
            self._launch_left(kernels.scatter_forces, where, state.particle_f)

    def resist(self, x: wp.array, dt: float, out: wp.array) -> None:
        """Adds −(h² K + 2 h C) x to ``out``, for a step h and with K and C no less than those of any configuration; see
        ``kernels/bending_filter.py``."""
        kernels, model = self.model.kernels.bending_filter, self.model
        if self._lanes is not None:
            self._lanes.resist(x, dt, out)
        if self.gathers and self._left_count > 0:
            self._launch_left(kernels.product_moments, [x, dt], self._moments)
            self._gather(model.kernels.bending.gather_forces, self._left_rows, out)
        else:
            self._launch_left(kernels.scatter_products, [x, dt], out)

    def hessian_product(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds (a K + b C) x to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        kernels = self.model.kernels.bending_hessian
        where = [self.slip, at.state.particle_q, x, at.stiffness, at.damping]
        if self.gathers:
            self._launch(kernels.product_moments, where, self._moments)
            self._gather(kernels.gather_products, self._rows, out)
        else:
            self._launch(kernels.scatter_products, where, out)

    def hessian_diagonal(self, at: Linearization, out: wp.array) -> None:
        """Adds the diagonal blocks of a K + b C to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        launch(
            self.model.kernels.bending_hessian.diagonal,
            dim=self.model.particle_count,
            inputs=[self.elements, *self._rows, self.slip, at.state.particle_q, at.stiffness, at.damping],
            outputs=[out],
            device=self.model.device,
        )

    def couplings(self) -> np.ndarray:
        """All pairs of entries of each element; see :class:`~warpcloth.forces.block_matrix.Assembled`."""
        start, particle = self.elements.start.numpy(), self.elements.particle.numpy()
        counts = np.diff(start)
        element = np.repeat(np.arange(len(counts)), counts**2)
        first, second = np.divmod(np.arange(len(element)) - self._pair_start.numpy()[element], counts[element])
        return particle[start[element, None] + np.stack([first, second], axis=1)]

    def add_blocks(self, at: Linearization, slots: wp.array, rows: Any) -> None:
        """Adds a K + b C to ``rows``; see :class:`~warpcloth.forces.block_matrix.Assembled`."""
        pairs = [self._pair_start, slots]
        launch(
            self.model.kernels.bending_hessian.add_blocks,
            dim=self.model.particle_count,
            inputs=[self.elements, *self._rows, *pairs, self.slip, at.state.particle_q, at.stiffness, at.damping],
            outputs=[rows],
            device=self.model.device,
        )

    def energy(self, state: State) -> dict[str, float]:
        """Energy of bending [J], with what the springs of hysteresis hold."""
        model = self.model
        out = wp.zeros(model.world_count, dtype=wp.float64, device=model.device)
        self._launch(model.kernels.bending.energy, [model.particle_world, self.slip, state.particle_q], out)
        return {"bending": float(out.numpy().sum())}

    def parameters(self) -> dict[str, wp.array]:
        """Of each element (k [N m³], k τ [N m³ s], κ₀ [1/m]), and of its friction (k_f [N m³], m_f [N m²])."""
        return {"bend_law": self.elements.law, "bend_friction": self.elements.friction}

    def advance(self, state: State) -> None:
        """The end of a step: ``slip`` follows to ``state``, where the force is another one from then on."""
        if not self.slips:
            return
        state.forces_current = False  # the friction of an element that bends another way turns with its slip
        if self._lanes is not None:
            self._lanes.advance(state, self.slip)
        self._launch_left(self.model.kernels.bending.advance_slip, [state.particle_q], self.slip)

    def memory(self) -> Sequence[Memory]:
        """The slip."""
        starts = self.elements.start.numpy()[:-1]
        return [Memory(self.slip, self.elements.particle.numpy()[starts])] if self.slips else []

    def _arrange_lanes(self, ranges: int) -> None:
        found, model = grouped(self.model), self.model
        if len(found.block) == 0:
            return
        self._lanes = BendingLanes(model, found, ranges)
        self._left, self._left_count = model.array(np.flatnonzero(found.left), wp.int32), int(found.left.sum())
        start, ids, elements = (row.numpy() for row in self._rows)
        kept = found.left[elements]
        start = np.concatenate([[0], np.cumsum(kept)])[start]
        self._left_rows = [model.array(values, wp.int32) for values in (start, ids[kept], elements[kept])]

    def _launch(self, kernel: wp.Kernel, inputs: list, out: wp.array) -> None:
        """One thread per element."""
        model = self.model
        launch(kernel, dim=model.bend_count, inputs=[self.elements, *inputs], outputs=[out], device=model.device)

    def _launch_left(self, kernel: wp.Kernel, inputs: list, out: wp.array) -> None:
        """One thread per element that is in no lane."""
        where = [self.elements, self._left, *inputs]
        launch(kernel, dim=self._left_count, inputs=where, outputs=[out], device=self.model.device)

    def _gather(self, kernel: wp.Kernel, rows: list[wp.array], out: wp.array) -> None:
        """One thread per particle."""
        inputs = [self.elements, *rows, self._moments]
        launch(kernel, dim=self.model.particle_count, inputs=inputs, outputs=[out], device=self.model.device)
