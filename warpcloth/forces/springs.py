"""The springs of the model as a force term."""

from typing import Any

import numpy as np
import warp as wp

from .. import validate
from ..launching import launch
from ..model import Model
from ..state import State
from ..watch import Watch
from .base import Linearization, Move
from .lanes import in_lanes
from .spring_rows import SpringRows
from .spring_tiles import SpringTiles, arranged

ASSEMBLIES = ("scatter", "gather")
LAW = ("spring_rest_length", "spring_stiffness", "spring_damping")


class Springs:
    """Damped springs (the law of ``kernels/spring_law.py``).

    Args:
        model: the model whose springs these are.
        assembly: "scatter" (one thread per spring, atomic adds) or "gather" (one thread per particle, fixed order:
            bitwise repeatable on a GPU too).
        ranges: into how many ranges launches may be cut on the CPU, where what scatters then goes eight springs at a
            time (:class:`~warpcloth.forces.spring_tiles.SpringTiles`) or, in worlds that do not fit that, row by row
            (:class:`~warpcloth.forces.spring_rows.SpringRows`); None: none.

    Raises:
        InputError: unknown assembly.
    """

    name = "springs"

    def __init__(self, model: Model, assembly: str = "scatter", ranges: int | None = None):
        self.model = model
        self.assembly = validate.choice(assembly, ASSEMBLIES, "assembly")
        in_rows = self.assembly == "scatter" and model.device.is_cpu and not model.differentiable
        self._parts: list[SpringTiles | SpringRows] = []
        left = np.ones(model.spring_count, bool)
        if ranges and in_rows:
            lanes, left = in_lanes(model, arranged)
            self._parts += [SpringTiles(model, lanes, ranges)] if len(lanes.entry) else []
            self._parts += [SpringRows(model, np.flatnonzero(left), ranges)] if left.any() else []
        self._is_left, self._left_count = left, int(np.count_nonzero(left))
        self._left = model.array(np.flatnonzero(left) if self._parts else np.zeros(0), wp.int32)  # none named: all
        self.velocity_dependent = bool(model.spring_damping.numpy().any())
        self._watch = Watch(model, *LAW)

    def prepare(self) -> None:
        """Takes over properties of springs that have changed."""
        if self._parts:
            self._watch.if_changed(self._arrange)

    def begin(self, state: State, world_gravity: wp.array) -> bool:
        """Gravity and springs at once, if all are in tiles; see :class:`~warpcloth.forces.base.Opening`."""
        part = self._whole()
        if part is not None:
            part.accumulate(state, world_gravity)
        return part is not None

    def advance_alone(self, start: State, end: State, world_gravity: wp.array, move: Move) -> bool:
        """A kick and a drift, if all springs are in tiles; see :class:`~warpcloth.forces.base.Opening`."""
        part = self._whole()
        if part is not None:
            part.advance(start, end, world_gravity, move)
        return part is not None

    def _whole(self) -> SpringTiles | None:
        """The tiles that have all springs and all particles, if there are such."""
        part = self._parts[0] if len(self._parts) == 1 else None
        return part if isinstance(part, SpringTiles) and part.has_all else None

    def accumulate(self, state: State, time_offset: float) -> None:
        """Adds spring forces [N] to ``state.particle_f``."""
        for part in self._parts:
            part.accumulate(state)
        if self._parts:
            return
        model = self.model
        kernel, dim = model.kernels.springs.scatter_forces, model.spring_count
        rows: list[wp.array] = []
        if self.assembly == "gather":
            kernel, dim = model.kernels.springs.gather_forces, model.particle_count
            rows = [model.particle_spring_start, model.particle_spring_ids]
        inputs = [*rows, *self._law(), state.particle_q, state.particle_qd]
        launch(kernel, dim=dim, inputs=inputs, outputs=[state.particle_f], device=model.device)

    def hessian_product(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds (a K + b C) x to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        self.multiply_rest(at, x, out)
        model, rows = self.model, [self._left]
        kernel, dim = model.kernels.spring_hessian.scatter_products, self._left_count
        if self.assembly == "gather":
            kernel, dim = model.kernels.spring_hessian.gather_products, model.particle_count
            rows = [model.particle_spring_start, model.particle_spring_ids]
        where = [at.world_project, at.state.particle_q, at.state.particle_qd, x, at.stiffness, at.damping]
        inputs = [*rows, model.particle_world, *self._law(), *where]
        launch(kernel, dim=dim, inputs=inputs, outputs=[out], device=model.device)

    def hessian_diagonal(self, at: Linearization, out: wp.array) -> None:
        """Adds the diagonal blocks of a K + b C to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        model = self.model
        rows = [model.particle_spring_start, model.particle_spring_ids, model.particle_world]
        where = [at.world_project, at.state.particle_q, at.state.particle_qd, at.stiffness, at.damping]
        launch(
            model.kernels.spring_hessian.diagonal,
            dim=model.particle_count,
            inputs=[*rows, *self._law(), *where],
            outputs=[out],
            device=model.device,
        )

    def couplings(self) -> np.ndarray:
        """Both ends with each other, but of springs that go eight at a time, whose products are faster.

        See :class:`~warpcloth.forces.block_matrix.PartlyAssembled`.
        """
        ends = self.model.spring_indices.numpy()
        pairs = np.stack([ends, ends[:, ::-1]], axis=1)
        pairs[~self._is_left, :, 1] = pairs[~self._is_left, :, 0]
        return pairs.reshape(-1, 2)

    def add_blocks(self, at: Linearization, slots: wp.array, rows: Any) -> None:
        """Adds a K + b C to ``rows``; see :class:`~warpcloth.forces.block_matrix.Assembled`."""
        model = self.model
        own = [model.particle_spring_start, model.particle_spring_ids, slots, model.particle_world]
        where = [at.world_project, at.state.particle_q, at.state.particle_qd, at.stiffness, at.damping]
        launch(
            model.kernels.spring_hessian.add_blocks,
            dim=model.particle_count,
            inputs=[*own, *self._law(), *where],
            outputs=[rows],
            device=model.device,
        )

    def multiply_rest(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds (a K + b C) x of springs that go eight at a time."""
        for part in self._parts:
            if isinstance(part, SpringTiles):
                part.multiply(at, x, out)

    def parameters(self) -> dict[str, wp.array]:
        """Rest lengths [m], k_s [N] and k_d [N s], shape [spring_count]."""
        return {name: getattr(self.model, name) for name in LAW}

    def _arrange(self) -> None:
        for part in self._parts:
            part.arrange()

    def _law(self) -> list[wp.array]:
        model = self.model
        return [model.spring_indices, *(getattr(model, name) for name in LAW)]

    def energy(self, state: State) -> dict[str, float]:
        """Energy of in-plane ("spring") and bending springs ("bending") [J]."""
        model = self.model
        out = wp.zeros((model.world_count, 2), dtype=wp.float64, device=model.device)
        launch(
            model.kernels.springs.energy,
            dim=model.spring_count,
            inputs=[
                model.particle_world, model.spring_indices, model.spring_rest_length, model.spring_stiffness,
                model.spring_group, state.particle_q,
            ],
            outputs=[out],
            device=model.device,
        )  # fmt: skip
        spring, bending = out.numpy().sum(axis=0)
        return {"spring": float(spring), "bending": float(bending)}
