"""Extended position-based dynamics: springs as compliant constraints, solved colour by colour."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from ..forces import Forces
from ..model import Model
from ..state import Memory, State
from .colouring import SpringColours
from .position_step import PositionStep


class Xpbd(PositionStep):
    """Implicit Euler, each step solved by sweeps over the springs (see ``kernels/xpbd.py``).

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
    order = 1
    reference = "Macklin, Müller, Chentanez, XPBD (2016), doi 10.1145/2994258.2994272"
    cost = "1 sweep over the springs, one launch per colour"
    use = "the fast choice for cloth: stable at any step, 20-60 substeps a frame of one sweep each"

    def __init__(self, model: Model, *, iterations: int = 1, warm_start: float = 0.5):
        super().__init__(model, iterations, warm_start)
        self.colours = SpringColours(model)
        r = model.spring_rest_length.numpy().astype(np.float64)
        law = np.stack([r, model.spring_stiffness.numpy() / r, model.spring_damping.numpy() / r], axis=1)
        self.law = self.colours.arranged(law, model.vec3)
        self.force = self.colours.arranged(np.zeros((model.spring_count, 3)), model.vec3)

    def reset(self) -> None:
        """Forgets the spring forces of the previous step."""
        super().reset()
        for force in self.force:
            force.zero_()

    def memory(self) -> Sequence[Memory]:
        """The spring forces of the previous step, besides what they did."""
        ends = [colour.numpy()[:, 0] for colour in self.colours.ends]
        return [*super().memory(), *map(Memory, self.force, ends)]

    def _solve(self, model: Model, state_in: State, forces: Forces, dt: float) -> wp.array:
        forces.evaluations += self.iterations
        for iteration in range(self.iterations):
            kept = self.warm_start if iteration == 0 else 1.0
            for ends, law, force in zip(self.colours.ends, self.law, self.force, strict=True):
                wp.launch(
                    model.kernels.xpbd.solve_springs,
                    dim=len(ends),
                    inputs=[ends, law, model.particle_inv_mass, state_in.particle_q, dt, kept],
                    outputs=[self.displacement, force],
                    device=model.device,
                )
        return self.displacement
