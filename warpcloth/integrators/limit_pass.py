"""Strain limiting for schemes that solve springs only and take all other forces as they were."""

import numpy as np

from ..launching import launch
from ..model import Model
from ..state import State
from .colouring import SpringColours


class LimitPass:
    """One sweep over the springs after each step, which adds what the limits do in it (``kernels/strain_limit.py``).

    As with all sweeps, what one of them leaves unsolved acts like a softer limit; more substeps harden it.

    Args:
        model: the model.
    """

    def __init__(self, model: Model):
        self.model, self.colours = model, SpringColours(model)
        rest = model.spring_rest_length.numpy().astype(np.float64)
        law = [rest * (1.0 + model.spring_limit.numpy()), model.spring_limit_stiffness.numpy() / rest, 0.0 * rest]
        self.law = self.colours.arranged(np.stack(law, axis=1), model.vec3)

    def apply(self, state: State, dt: float) -> None:
        """Changes positions and velocities at the end of a step of dt [s]."""
        for ends, law in zip(self.colours.ends, self.law, strict=True):
            launch(
                self.model.kernels.strain_limit.limit_springs,
                dim=len(ends),
                inputs=[ends, law, self.model.particle_inv_mass, dt],
                outputs=[state.particle_q, state.particle_qd],
                device=self.model.device,
            )
