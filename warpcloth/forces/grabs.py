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
SAFE_SHARE = 0.5  # of m/h² and m/h: stiffness and damping that a scheme which takes grabs explicitly can carry, in all


@dataclass(frozen=True)
class Hold:
    """What a grab holds: three particles and their weights, which sum to one; stiffness [N/m], damping [N s/m].

    Raises:
        InputError: a value of another kind or out of range.
    """

    particles: tuple[int, int, int]
    weights: tuple[float, float, float]
    stiffness: float
    damping: float

    def __post_init__(self):
        particles = validate.array(self.particles, "hold: particles", (3,), np.int64)
        values = {
            "particles": tuple(particles.tolist()),
            "weights": tuple(validate.array(self.weights, "hold: weights", (3,)).tolist()),
            "stiffness": validate.number(self.stiffness, "hold: stiffness", above=0.0),
            "damping": validate.number(self.damping, "hold: damping", minimum=0.0),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)


class Grabs:
    """All grabs of a simulation, in slots (``kernels/grab.py``).

    Between frames the host writes what has changed, so captured frames see it; a frame allocates nothing.

    Args:
        model: the model.
        explicit: whether the integrator takes these forces as they are at the start of a step of given length. What is
            stiffer than that can carry is then softened, so that grabs never make a stable simulation unstable; those
            that hold the same particles share what these can carry.
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
        self._held = wp.zeros(model.world_count, dtype=wp.int32, device=model.device)
        self._idle, self._within_frame = True, False
        self._step = 1e-12  # [s] of the latest frame; before the first nothing is too stiff

    def take(self, hold: Hold, target: np.ndarray) -> int:
        """A slot for a new grab.

        Raises:
            InputError: all are taken, or the model has no such particles, as when a tape was made with other cloth.
        """
        for particle in hold.particles:
            validate.integer(particle, "grabbed particle", minimum=0, maximum=self.model.particle_count - 1)
        if None not in self.holds:
            raise InputError(f"There are {SLOTS} grabs already, which is the most; release one first.")
        slot = self.holds.index(None)
        self.holds[slot] = hold
        self.targets[slot] = self._before[slot] = target
        return slot

    def place(self, slot: int) -> np.ndarray:
        """Where the target of a slot is now [m], from where it goes on to that in ``targets``."""
        return self._before[slot].copy()

    def free(self, slot: int) -> None:
        """Lets go."""
        self.holds[slot] = None

    def begin_frame(self, state: State, dt: float, step: float) -> None:
        """Brings the device up to date for a frame of dt [s] from ``state``, in steps of ``step`` [s]."""
        busy = any(hold is not None for hold in self.holds)
        if self._idle and not busy:
            return
        self._idle = not busy
        self._step, self._within_frame = step, True
        self._write(state, self.targets)
        self._grabs.span.fill_(dt)

    def _write(self, state: State, targets: np.ndarray) -> None:
        """All grabs as they are, on their way to ``targets`` [m] from now on."""
        clocks = state.world_time.numpy()
        stiffness, damping, begun = np.zeros(SLOTS), np.zeros(SLOTS), np.zeros(SLOTS)
        particles, weights = np.zeros((SLOTS, 3), np.int32), np.zeros((SLOTS, 3))
        held = np.zeros(self.model.world_count, np.int32)
        for slot, hold in enumerate(self.holds):
            if hold is not None:
                particles[slot], weights[slot] = hold.particles, hold.weights
                stiffness[slot], damping[slot] = hold.stiffness, hold.damping
                world = self._world[hold.particles[0]]
                begun[slot], held[world] = clocks[world], 1
        if self.explicit:
            mobility = self._mobility(particles, weights)  # 0 of free slots, and of points that are pinned
            most = np.divide(SAFE_SHARE, mobility, out=np.full(SLOTS, np.inf), where=mobility > 0.0)
            stiffness, damping = np.minimum(stiffness, most / self._step**2), np.minimum(damping, most / self._step)
        self._grabs.particles.assign(particles)
        self._grabs.weights.assign(weights)
        self._grabs.stiffness.assign(stiffness)
        self._grabs.damping.assign(damping)
        self._grabs.target_from.assign(self._before)
        self._grabs.target_to.assign(targets)
        self._grabs.begun.assign(begun)
        self._held.assign(held)

    def end_frame(self) -> None:
        """The targets have been reached, and are where frames go on that the caller replays."""
        if not self._idle:
            wp.copy(self._grabs.target_from, self._grabs.target_to)
        self._before = self.targets.copy()
        self._within_frame = False

    def _mobility(self, particles: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Of each slot Σ_h Σ_i wᵢ w_hi/mᵢ [1/kg] over all slots h, itself included, shape [SLOTS].

        With stiffnesses of at most s over it, no eigenvalue of M⁻¹K is larger than s, as no column sum is that of the
        matrix over slots which has the same ones.
        """
        used, column = np.unique(particles, return_inverse=True)
        shares = np.zeros((SLOTS, len(used)))
        np.add.at(shares, (np.arange(SLOTS)[:, None], column.reshape(SLOTS, 3)), np.abs(weights))
        return np.asarray((shares * self._inverse_mass[used]) @ shares.sum(axis=0))

    def accumulate(self, state: State, time_offset: float) -> None:
        """Adds the grabs' forces [N] to ``state.particle_f``."""
        inputs = [self.model.particle_world, self._grabs, state.world_time, time_offset]
        self._launch("forces", [*inputs, state.particle_q, state.particle_qd], state.particle_f)

    def energy(self, state: State) -> dict[str, float]:
        """Energy of the grabs' springs [J], between frames of those held now, at the targets that they have reached.

        Where :meth:`~warpcloth.Grab.move` leads to is for the next frame, so it changes nothing yet.
        """
        if not self._within_frame:
            self._write(state, self._before)
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

    def jerked_worlds(self) -> wp.array:
        """Those with a hand in them; see :class:`~warpcloth.forces.base.Jerking`."""
        return self._held

    def _launch(self, kernel: str, inputs: list, out: wp.array) -> None:
        model = self.model
        launch(getattr(model.kernels.grab, kernel), dim=SLOTS, inputs=inputs, outputs=[out], device=model.device)
