"""Position-based dynamics as first published: springs as rigid constraints that each sweep meets in part."""

import numpy as np
import warp as wp

from .. import validate
from ..forces import Forces
from ..forces.springs import LAW
from ..launching import launch
from ..model import Model
from ..state import State
from .colouring import SpringColours
from .position_step import PositionStep
from .spring_properties import SpringProperties


class Pbd(PositionStep):
    """The historical baseline, for comparison: the material depends on the step, so there is no order of convergence.

    Each sweep moves the ends of every spring by a share ``stiffness`` of what restores its rest length; the fabric's
    k_s and k_d are not used. With n sweeps of share s per step of h, one spring behaves as if its k_s/r were
    ((1 − s)⁻ⁿ − 1)/(h² (1/m_p + 1/m_q)): half the step, or twice the mass resolution, make another cloth. A step much
    shorter than the one before throws cloth about, as what that left unsolved becomes speed in it.

    Args:
        model: the model.
        iterations: sweeps over all springs per step.
        stiffness: share of the error of in-plane springs that a sweep removes, 0 to 1.
        bending: the same for bending springs.

    Raises:
        InputError: a value out of range.
    """

    name = "pbd"
    order = 0
    reference = "Müller et al., Position Based Dynamics (2007), doi 10.1016/j.jvcir.2007.01.005"
    cost = "1 sweep over the springs, one launch per colour"
    use = "only to compare: its stiffness is set by the step, not by the fabric; xpbd costs the same"

    def __init__(self, model: Model, *, iterations: int = 1, stiffness: float = 1.0, bending: float = 0.01):
        super().__init__(model, iterations)
        stiffness = validate.number(stiffness, "stiffness", minimum=0.0, maximum=1.0)
        bending = validate.number(bending, "bending", minimum=0.0, maximum=1.0)
        self.colours = SpringColours(model)
        factor = np.where(model.spring_group.numpy() == 1, bending, stiffness)
        self.factor = self.colours.arranged(factor, model.real)
        self._properties = SpringProperties(model, self.colours.order, LAW)
        self._law = self.colours.views(self._properties.values)

    def prepare(self) -> None:
        """Takes over rest lengths that have changed."""
        self._properties.read()

    def _solve(self, model: Model, state_in: State, forces: Forces, dt: float) -> wp.array:
        forces.evaluations += self.iterations
        for _ in range(self.iterations):
            for ends, law, factor in zip(self.colours.ends, self._law, self.factor, strict=True):
                launch(
                    model.kernels.xpbd.project_springs,
                    dim=len(ends),
                    inputs=[ends, law, factor, model.particle_inv_mass, state_in.particle_q],
                    outputs=[self.displacement],
                    device=model.device,
                )
        return self.displacement
