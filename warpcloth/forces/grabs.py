"""Grabs as a force term: springs that a user or a script leads while the simulation runs."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from .. import validate
from ..errors import InputError
from ..launching import fill, launch
from ..model import Model
from ..state import State
from .base import Linearization

SLOTS = 32
SAFE_SHARE = 0.5  # of m/h² and m/h: stiffness and damping that a scheme which takes grabs explicitly can carry


@dataclass(frozen=True)
class Hold:
    """What a grab holds: three particles and their weights, which sum to one; stiffness [N/m], damping [N s/m]."""

    particles: tuple[int, int, int]
    weights: tuple[float, float, float]
    stiffness: float
    damping: float


class Grabs:
    """All grabs of a simulation, in slots (``kernels/grab.py``).

    Between frames the host writes what has changed, so captured frames see it; a frame allocates nothing.

    Args:
        model: the model.
        explicit: whether the integrator takes these forces as they are at the start of a step. What is stiffer than
            its steps can carry is then softened, so that a grab never makes a stable simulation unstable.
    """

    name = "grab"
    velocity_dependent = True

    def __init__(self, model: Model, explicit: bool):
        self.model, self.explicit = model, explicit
        self.holds: list[Hold | None] = [None] * SLOTS
        self.targets = np.zeros((SLOTS, 3))
        self._before = np.zeros((SLOTS, 3))
        self._inverse_mass = model.particle_inv_mass.numpy().astype(np.float64)
        self._world = model.particle_world.numpy()
        self._grabs = model.kernels.grab.Grabs()
        self._grabs.particles = model.array(np.zeros((SLOTS, 3), np.int32), wp.vec3i)
        self._grabs.weights = model.array(np.zeros((SLOTS, 3)), model.vec3)
        self._grabs.stiffness = model.array(np.zeros(SLOTS), model.real)
        self._grabs.damping = model.array(np.zeros(SLOTS), model.real)
        self._grabs.target_from = model.array(np.zeros((SLOTS, 3)), wp.vec3d)
        self._grabs.target_to = model.array(np.zeros((SLOTS, 3)), wp.vec3d)
        self._grabs.begun = model.array(np.zeros(SLOTS), wp.float64)
        self._grabs.span = model.array(np.ones(1), wp.float64)
        self._energy = wp.zeros(model.world_count, dtype=wp.float64, device=model.device)
        self._idle = True

    def take(self, hold: Hold, target: np.ndarray) -> int:
        """A slot for a new grab.

        Raises:
            InputError: all are taken, or the model has no such particles.
        """
        for number in hold.particles:
            validate.integer(number, "grabbed particle", minimum=0, maximum=self.model.particle_count - 1)
        if None not in self.holds:
            raise InputError(f"There are {SLOTS} grabs already, which is the most; release one first.")
        slot = self.holds.index(None)
        self.holds[slot] = hold
        self.targets[slot] = self._before[slot] = target
        return slot

    def free(self, slot: int) -> None:
        """Lets go."""
        self.holds[slot] = None

    def begin_frame(self, state: State, dt: float, step: float) -> None:
        """Brings the device up to date for a frame of dt [s] from ``state``, in steps of ``step`` [s]."""
        busy = any(hold is not None for hold in self.holds)
        if self._idle and not busy:
            return
        self._idle = not busy
        clocks = state.world_time.numpy()
        stiffness, damping, begun = np.zeros(SLOTS), np.zeros(SLOTS), np.zeros(SLOTS)
        particles, weights = np.zeros((SLOTS, 3), np.int32), np.zeros((SLOTS, 3))
        for slot, hold in enumerate(self.holds):
            if hold is not None:
                particles[slot], weights[slot] = hold.particles, hold.weights
                stiffness[slot], damping[slot] = self._carried(hold, step)
                begun[slot] = clocks[self._world[hold.particles[0]]]
        self._grabs.particles.assign(particles)
        self._grabs.weights.assign(weights)
        self._grabs.stiffness.assign(stiffness)
        self._grabs.damping.assign(damping)
        self._grabs.target_from.assign(self._before)
        self._grabs.target_to.assign(self.targets)
        self._grabs.begun.assign(begun)
        self._grabs.span.fill_(dt)

    def end_frame(self) -> None:
        """The targets have been reached."""
        self._before = self.targets.copy()

    def _carried(self, hold: Hold, step: float) -> tuple[float, float]:
        """Stiffness and damping, no more than the step can carry where it must."""
        mobility = float(np.sum(np.square(hold.weights) * self._inverse_mass[list(hold.particles)]))
        if not self.explicit or mobility == 0.0:
            return hold.stiffness, hold.damping
        most = SAFE_SHARE / mobility
        return min(hold.stiffness, most / step**2), min(hold.damping, most / step)

    def accumulate(self, state: State, time_offset: float) -> None:
        """Adds the grabs' forces [N] to ``state.particle_f``."""
        inputs = [self.model.particle_world, self._grabs, state.world_time, time_offset]
        self._launch("forces", [*inputs, state.particle_q, state.particle_qd], state.particle_f)

    def energy(self, state: State) -> dict[str, float]:
        """Energy of the grabs' springs [J]."""
        fill(self._energy)
        inputs = [self.model.particle_world, self._grabs, state.world_time, state.particle_q]
        self._launch("energy", inputs, self._energy)
        return {"grab": float(self._energy.numpy().sum())}

    def hessian_product(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds (a K + b C) x to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        self._launch("products", [self._grabs, x, at.stiffness, at.damping], out)

    def hessian_diagonal(self, at: Linearization, out: wp.array) -> None:
        """Adds the diagonal blocks of a K + b C to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        self._launch("diagonal", [self._grabs, at.stiffness, at.damping], out)

    def _launch(self, kernel: str, inputs: list, out: wp.array) -> None:
        model = self.model
        launch(getattr(model.kernels.grab, kernel), dim=SLOTS, inputs=inputs, outputs=[out], device=model.device)
