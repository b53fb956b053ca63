"""Forces of the caller's own."""

from typing import TYPE_CHECKING, Any

import warp as wp

from .. import validate
from ..errors import InputError
from ..launching import launch
from ..model import Model
from ..state import State

if TYPE_CHECKING:
    from .base import Linearization


class UserForce:
    """A force of your own: a subclass needs :meth:`accumulate`, and is given as ``Simulation(model, forces=[…])``.

    Frames are captured as graphs and replayed: launch kernels only, the same ones every time, without allocating or
    reading anything back. Automatic substeps do not know how stiff the force is. Implicit schemes converge without
    derivatives, slowly if the force is stiff; :meth:`hessian_product` and :meth:`hessian_diagonal` speed them up.

    In differentiable models, gradients go through it if it has a method ``parameters``, see
    :class:`~warpcloth.forces.Differentiable`.

    Attributes:
        name: what messages call it; any will do.
        velocity_dependent: whether it depends on velocities, so that schemes must predict these.
    """

    name = "user"
    velocity_dependent = False

    def accumulate(self, state: State, time_offset: float) -> None:
        """Adds the force [N] at ``state``, whose time is the worlds' time + ``time_offset`` [s], to ``particle_f``."""
        raise NotImplementedError

    def energy(self, state: State) -> dict[str, float]:
        """Potential energies [J] by name, summed over all worlds; empty for a force without potential."""
        return {}

    def hessian_product(self, at: "Linearization", x: wp.array, out: wp.array) -> None:
        """Adds (a K + b C) x to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""

    def hessian_diagonal(self, at: "Linearization", out: wp.array) -> None:
        """Adds the diagonal blocks of a K + b C to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""


def user_forces(forces: Any) -> list[UserForce]:
    """What was given as forces of the caller's own.

    Raises:
        InputError: it is no list of them, or one has no ``accumulate``.
    """
    own = validate.instances(forces, UserForce, "forces")
    for k, force in enumerate(own):
        if type(force).accumulate is UserForce.accumulate:
            raise InputError(f"Forces[{k}], {type(force).__name__}, needs a method accumulate(state, time_offset).")
    return own


class AppliedForce(UserForce):
    """A force on every particle that the caller writes between frames, or with kernels of their own.

    Args:
        model: the model.
        force: [N], vec3 of the model's precision, shape [particle_count], on the model's device; None: zeros.

    Raises:
        InputError: the array is not like that, or the model is none.

    Attributes:
        force: the array, read in every evaluation; write to it, but do not replace it.
    """

    name = "applied"
    launches_recorded = True

    def __init__(self, model: Model, force: wp.array | None = None):
        if getattr(model, "vec3", None) is None:  # anything that has what is needed will do
            raise InputError(f"AppliedForce needs a Model, got {type(model).__name__}.")
        self.model = model
        if force is None:
            force = wp.zeros(model.particle_count, dtype=model.vec3, device=model.device)
        self.force = validate.device_array(force, "force", model.vec3, (model.particle_count,), model.device)

    def accumulate(self, state: State, time_offset: float) -> None:
        """Adds the forces to ``state.particle_f``."""
        launch(
            self.model.kernels.particles.add_force,
            dim=self.model.particle_count,
            inputs=[self.force],
            outputs=[state.particle_f],
            device=self.model.device,
        )

    def parameters(self) -> dict[str, wp.array]:
        """The forces [N]."""
        return {"applied_force": self.force}
