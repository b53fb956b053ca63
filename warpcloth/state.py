"""What changes during a simulation."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from .launching import copy

if TYPE_CHECKING:
    from .model import Model


@dataclass(frozen=True, eq=False)
class Memory:
    """An array that an integrator, a force, contact or a hook keeps from one step to the next, besides the state.

    Attributes:
        array: the array, on the device.
        particle: of each row, a particle of the world that it belongs to, int; None if there is a row for each world.
    """

    array: wp.array
    particle: np.ndarray | None


class OnDevice:
    """What is made of Warp arrays, which can be neither pickled nor copied as Python objects are."""

    def __getstate__(self) -> Any:
        raise TypeError(
            f"A {type(self).__name__} is made of arrays on a device and can be neither pickled nor copied; pickle the "
            "scene or the cloths and obstacles that it is made from, and what .numpy() says of its arrays."
        )


@dataclass(eq=False)
class State(OnDevice):
    """Positions, velocities and forces of all particles, and the clock of every world; plain Warp arrays.

    Attributes:
        particle_q: positions [m], shape [particle_count], vec3 of the model's precision.
        particle_qd: velocities [m/s], shape [particle_count].
        particle_f: forces of the latest evaluation [N], shape [particle_count]: wherever in a step that was, and
            without those that a scheme solves for itself (springs, in position-based ones).
        world_time: time [s], shape [world_count], float64.
        forces_current: whether ``particle_f`` is the force at these very positions and velocities, so that the next
            step need not evaluate it again. Set by the integrator; whoever changes the state clears it.
    """

    particle_q: wp.array
    particle_qd: wp.array
    particle_f: wp.array
    world_time: wp.array
    forces_current: bool = False

    @staticmethod
    def of(model: "Model") -> "State":
        """A new state at the model's initial positions and velocities, at time 0."""
        return State(
            wp.clone(model.particle_q),
            wp.clone(model.particle_qd),
            wp.zeros_like(model.particle_q),
            wp.zeros(model.world_count, dtype=wp.float64, device=model.device),
        )

    def twin(self) -> "State":
        """A state with particle arrays of its own that shares this state's clock."""
        return State(
            wp.clone(self.particle_q), wp.clone(self.particle_qd), wp.zeros_like(self.particle_f), self.world_time
        )

    def copy_from(self, other: "State") -> None:
        """Positions, velocities and forces of another state; no allocation."""
        copy(self.particle_q, other.particle_q)
        copy(self.particle_qd, other.particle_qd)
        copy(self.particle_f, other.particle_f)
