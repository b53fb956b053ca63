"""Extended position-based dynamics: springs and yarns as compliant constraints, solved one after the other."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from ..forces import Forces
from ..launching import fill, launch
from ..model import YARNS, Model
from ..state import Memory, State
from .colouring import TriangleColours
from .position_step import PositionStep
from .spring_sweeps import spring_sweeps


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
        self.sweeps = spring_sweeps(model)
        self._parts = [(sweep, part) for sweep in self.sweeps for part in range(len(sweep.forces))]
        self.triangles = TriangleColours(model)
        sizes = [YARNS * len(numbers) for numbers in self.triangles.numbers]
        whole: dict[str, Any] = {"dtype": model.vec3, "device": model.device, "requires_grad": model.differentiable}
        self._triangle_force = wp.zeros(sum(sizes), **whole)
        ends = np.cumsum(sizes).tolist()
        self._triangle_forces = [self._triangle_force[end - size : end] for end, size in zip(ends, sizes, strict=True)]

    @property
    def force(self) -> list[wp.array]:
        """Forces of the previous step [N], an array for each part of a sweep."""
        return [*(sweep.forces[part] for sweep, part in self._parts), *self._triangle_forces]

    def read_springs(self, model: Model) -> None:
        """Takes over stiffness, damping and rest lengths of the model's springs, should they have changed."""
        for sweep in self.sweeps:
            sweep.read_springs()

    def reset(self) -> None:
        """Forgets the spring forces of the previous step."""
        super().reset()
        for sweep in self.sweeps:
            sweep.reset()
        fill(self._triangle_force)

    def memory(self) -> Sequence[Memory]:
        """The spring forces of the previous step, besides what they did; those in lanes last, as not all models have
        them."""
        corners = np.concatenate([np.zeros(0, int), *(np.repeat(corner, YARNS) for corner in self.triangles.corner)])
        springs = [sweep.memory() for sweep in reversed(self.sweeps)]
        return [*super().memory(), Memory(self._triangle_force, corners), *springs]

    def _solve(self, model: Model, state_in: State, forces: Forces, dt: float) -> wp.array:
        forces.evaluations += self.iterations
        for iteration in range(self.iterations):
            for part in range(len(self.force)):
                self.solve_part(model, state_in.particle_q, dt, iteration, part)
        return self.displacement

    def solve_part(self, model: Model, start: wp.array, dt: float, iteration: int, part: int) -> None:
        """The springs or triangles of one part of a sweep, in a step of dt [s] from positions ``start``; changes their
        forces and ``displacement`` in place."""
        kept = self.warm_start if iteration == 0 else 1.0
        if part < len(self._parts):
            sweep, own = self._parts[part]
            sweep.solve(own, start, dt, kept, self.displacement)
            return
        colour = part - len(self._parts)
        triangles = self.triangles.numbers[colour]
        launch(
            model.kernels.woven_xpbd.solve_triangles,
            dim=len(triangles),
            inputs=[triangles, model.woven, model.particle_inv_mass, start, dt, kept],
            outputs=[self.displacement, self._triangle_forces[colour]],
            device=model.device,
        )
