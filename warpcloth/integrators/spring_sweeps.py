"""How XPBD sweeps over springs: by colours on GPUs and where there are gradients, in blocks or lanes on the CPU."""

from typing import Any

import numpy as np
import warp as wp

from ..forces.lanes import in_lanes
from ..launching import fill, launch
from ..model import Model
from ..state import Memory
from .blocks import SpringBlocks
from .colouring import SpringColours
from .part import Turn
from .sweep_tiles import TileSweep, arranged


class ListSweep:
    """A sweep over springs one by one; its parts are colours, or phases of blocks.

    Args:
        model: the model. order: of its springs.

    Attributes:
        forces: of the springs in the step before [N], an array for each part, vec3. flat_force: all of them, real;
            components are ``stride`` apart.
    """

    stride = 1

    def __init__(self, model: Model, order: SpringBlocks | SpringColours):
        self._model, self.order = model, order
        self._springs = model.array(order.order, wp.int32)
        ends = model.spring_indices.numpy().reshape(-1, 2)
        self._particle = ends[order.order, 0]
        whole: dict[str, Any] = {"dtype": model.vec3, "device": model.device, "requires_grad": model.differentiable}
        self._law, self._force = (wp.zeros(len(order.order), **whole) for _ in range(2))
        self._laws, self.forces = order.views(self._law), order.views(self._force)
        self.flat_force = wp.array(
            ptr=self._force.ptr, dtype=model.real, shape=3 * len(self._force), device=model.device
        )  # the same memory
        self.read_springs()

    def read_springs(self) -> None:
        """Takes over stiffness, damping and rest lengths of the model's springs, should they have changed."""
        model = self._model
        launch(
            model.kernels.springs.arrange_law,
            dim=len(self._springs),
            inputs=[self._springs, model.spring_rest_length, model.spring_stiffness, model.spring_damping],
            outputs=[self._law],
            device=model.device,
        )

    def reset(self) -> None:
        """Forgets the forces of the step before."""
        fill(self._force)

    def memory(self) -> Memory:
        """The forces of the step before."""
        return Memory(self._force, self._particle)

    def slots(self) -> tuple[np.ndarray, np.ndarray]:
        """As :meth:`~warpcloth.integrators.sweep_tiles.TileSweep.slots`."""
        return self.order.order, 3 * np.arange(len(self.order.order))

    def solve(self, part: int, turn: Turn, displacement: wp.array) -> None:
        """As :meth:`~warpcloth.integrators.sweep_tiles.TileSweep.solve`."""
        model, start, ends = self._model, turn.start, self.order.ends[part]
        springs, step = [ends, self._laws[part], model.particle_inv_mass], [start.particle_q, turn.dt, turn.kept]
        kernel, dim = model.kernels.xpbd.solve_springs, len(ends)
        if isinstance(self.order, SpringBlocks):
            begins = self.order.block_start[part]
            kernel, dim = model.kernels.xpbd_blocks.solve_blocks, len(begins) - 1
            springs, step = [begins, *springs], [*step, int(turn.backwards)]
        launch(
            kernel,
            dim=dim,
            inputs=[*springs, *step],
            outputs=[displacement, self.forces[part]],
            device=model.device,
        )


def spring_sweeps(model: Model) -> list[TileSweep | ListSweep]:
    """Sweeps that together solve all springs of a model; what is done in one world does not depend on the others."""
    if model.differentiable or not model.device.is_cpu:
        return [ListSweep(model, SpringColours(model))]
    lanes, left = in_lanes(model, arranged)
    sweeps: list[TileSweep | ListSweep] = [TileSweep(model, lanes)] if len(lanes.entry) else []
    return [*sweeps, ListSweep(model, SpringBlocks(model, np.flatnonzero(left)))]
