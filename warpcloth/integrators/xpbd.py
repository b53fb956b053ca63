"""Extended position-based dynamics: springs and yarns as compliant constraints, solved one after the other."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from ..forces import Forces
from ..launching import fill, launch
from ..model import YARNS, Model
from ..state import Memory, State
from .blocks import SpringBlocks
from .colouring import SpringColours, TriangleColours
from .position_step import PositionStep

IN_BLOCKS = 1.16  # sweeps by colours that one in blocks is worth on hanging grids


class Xpbd(PositionStep):
    """Implicit Euler, each step solved by sweeps over the springs (see ``kernels/xpbd.py``) and woven triangles.

    One spring is solved exactly by one sweep: it is implicit Euler to round-off, damping included. Networks converge
    to Newton's solution as ``iterations`` grows. Small steps of one sweep give more for the same work than large steps
    of many (Macklin et al., Small Steps in Physics Simulation, 2019); too few of both act like a softer fabric.

    A step begins with a share of the spring forces of the step before. One half removes a third to a half of the strain
    error and is stable at any step. All of it gives the result of a converged solve while ω h stays below 3, but larger
    steps diverge.

    Args:
        model: the model.
        iterations: sweeps over all springs per step.
        warm_start: share of the previous spring forces with which a step begins, 0 to 1.

    Raises:
        InputError: a value out of range.
    """

    name = "xpbd"
    solved_forces = ("springs", "woven")
    order = 1
    reference = "Macklin, Müller, Chentanez, XPBD (2016), doi 10.1145/2994258.2994272"
    cost = "1 sweep over the springs"
    use = "the fast choice for cloth: stable at any step, 20-60 substeps a frame of one sweep each"

    def __init__(self, model: Model, *, iterations: int = 1, warm_start: float = 0.5):
        super().__init__(model, iterations, warm_start)
        in_blocks = model.device.is_cpu and not model.differentiable
        self.colours: SpringBlocks | SpringColours = SpringBlocks(model) if in_blocks else SpringColours(model)
        along_threads = isinstance(self.colours, SpringBlocks) and bool(self.colours.in_list_order.all())
        self._order = model.array(self.colours.order, wp.int32)
        whole: dict[str, Any] = {"shape": model.spring_count, "dtype": model.vec3, "device": model.device}
        self._law = wp.zeros(**whole, requires_grad=model.differentiable)
        self.law = self.colours.views(self._law)
        self.force = self.colours.views(wp.zeros(**whole, requires_grad=model.differentiable))
        self.triangles = TriangleColours(model)
        self.sweep_value = IN_BLOCKS if along_threads and not self.triangles.numbers else 1.0
        for numbers in self.triangles.numbers:
            whole["shape"] = YARNS * len(numbers)
            self.force.append(wp.zeros(**whole, requires_grad=model.differentiable))
        self.read_springs(model)

    def read_springs(self, model: Model) -> None:
        """Takes over stiffness, damping and rest lengths of the model's springs, should they have changed."""
        launch(
            model.kernels.springs.arrange_law,
            dim=model.spring_count,
            inputs=[self._order, model.spring_rest_length, model.spring_stiffness, model.spring_damping],
            outputs=[self._law],
            device=model.device,
        )

    def reset(self) -> None:
        """Forgets the spring forces of the previous step."""
        super().reset()
        for force in self.force:
            fill(force)

    def memory(self) -> Sequence[Memory]:
        """The spring forces of the previous step, besides what they did."""
        ends = [colour.numpy()[:, 0] for colour in self.colours.ends]
        ends += [np.repeat(corner, YARNS) for corner in self.triangles.corner]
        return [*super().memory(), *map(Memory, self.force, ends)]

    def _solve(self, model: Model, state_in: State, forces: Forces, dt: float) -> wp.array:
        forces.evaluations += self.iterations
        for iteration in range(self.iterations):
            for colour in range(len(self.force)):
                self.solve_colour(model, state_in.particle_q, dt, iteration, colour)
        return self.displacement

    def solve_colour(self, model: Model, start: wp.array, dt: float, iteration: int, colour: int) -> None:
        """The springs or triangles of one colour, in a step of dt [s] from positions ``start``; changes their forces
        and ``displacement`` in place."""
        kept = self.warm_start if iteration == 0 else 1.0
        if colour >= len(self.law):
            triangles = self.triangles.numbers[colour - len(self.law)]
            launch(
                model.kernels.woven_xpbd.solve_triangles,
                dim=len(triangles),
                inputs=[triangles, model.woven, model.particle_inv_mass, start, dt, kept],
                outputs=[self.displacement, self.force[colour]],
                device=model.device,
            )
            return
        ends = self.colours.ends[colour]
        kernel, dim, blocks = model.kernels.xpbd.solve_springs, len(ends), list[wp.array]()
        if self.colours.block_start:
            blocks = [self.colours.block_start[colour]]
            kernel, dim = model.kernels.xpbd_blocks.solve_blocks, len(blocks[0]) - 1
        launch(
            kernel,
            dim=dim,
            inputs=[*blocks, ends, self.law[colour], model.particle_inv_mass, start, dt, kept],
            outputs=[self.displacement, self.force[colour]],
            device=model.device,
        )
