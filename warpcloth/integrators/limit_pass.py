"""Strain limiting for schemes that solve springs only and take all other forces as they were."""

from ..launching import launch
from ..model import Model
from ..state import State
from .colouring import SpringColours
from .spring_properties import SpringProperties


class LimitPass:
    """One sweep over the springs after each step, which adds what the limits do in it (``kernels/strain_limit.py``).

    As with all sweeps, what one of them leaves unsolved acts like a softer limit; more substeps harden it.

    Args:
        model: the model.
    """

    def __init__(self, model: Model):
        self.model, self.colours = model, SpringColours(model)
        names = ("spring_rest_length", "spring_limit", "spring_limit_stiffness")
        self._properties = SpringProperties(model, self.colours.order, names)
        self.law = self.colours.views(self._properties.values)

    def prepare(self) -> None:
        """Takes over properties of springs that have changed."""
        self._properties.read()

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
