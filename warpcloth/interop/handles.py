"""Pinned particles as handles that are led at given velocities."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from .. import validate
from ..errors import InputError
from ..hooks import Hook
from ..kinematics import LedPins
from ..launching import launch
from ..model import Model
from ..state import Memory, State


class Handles(Hook):
    """Leads groups of pinned particles, the same ones in each world, by way of the model's ``led_pins``.

    Args:
        model: the model, of worlds with equally many particles.
        groups: of each handle, numbers of particles within a world; None: each pinned particle is a handle.

    Raises:
        InputError: a particle that there is not, is not pinned, is pinned with a motion of its own, or is named twice.

    Attributes:
        velocity: of each handle in each world [m/s], vec3, shape [world_count, handles].
    """

    launches_recorded = True

    def __init__(self, model: Model, groups: Sequence[Any] | None):
        self.model = model
        worlds = model.world_count
        size = model.particle_count // worlds
        held = model.particle_inv_mass.numpy() == 0.0
        held[model.moving_pins.particle.numpy()] = False
        held = held.reshape(worlds, size)
        rows = [[i] for i in np.flatnonzero(held.all(axis=0))] if groups is None else groups
        if not isinstance(rows, Sequence | np.ndarray) or isinstance(rows, str) or not validate.axes(rows):
            raise InputError(f"Handles must be a list of lists of particles, got {type(rows).__name__}.")
        parts = [_checked(row, f"handles[{h}]", held) for h, row in enumerate(rows)]
        _check_apart(parts)
        self.velocity = wp.zeros((worlds, len(parts)), dtype=model.vec3, device=model.device)
        own = np.concatenate([np.zeros(0, np.int32), *parts])
        world = np.repeat(np.arange(worlds), len(own))
        handle = np.tile(np.repeat(np.arange(len(parts)), [len(part) for part in parts]), worlds)
        columns = (np.tile(own, worlds) + size * world, world, handle)
        self._rows = [model.array(column.astype(np.int32), wp.int32) for column in columns]
        self._pins = model.led_pins = LedPins.of(columns[0], model.particle_q)

    def before_step(self, state: State, dt: float) -> None:
        """Says where the held particles are, and how fast they go."""
        pins = self._pins
        outputs = [pins.place, pins.velocity, state.particle_qd]
        self._launch("take_hold", [*self._rows, self.velocity, state.particle_q], outputs)

    def after_step(self, start: State, end: State, dt: float) -> None:
        """They have gone on."""
        self._launch("go_on", [self._pins.velocity, dt], [self._pins.place])

    def memory(self) -> Sequence[Memory]:
        """Their places, more precisely than the state has them."""
        return [Memory(self._pins.place, self._pins.particle.numpy())]

    def _launch(self, kernel: str, inputs: list[Any], outputs: list[wp.array]) -> None:
        function = getattr(self.model.kernels.handles, kernel)
        launch(function, len(self._pins.particle), inputs, outputs, self.model.device)


def _checked(row: Any, what: str, held: np.ndarray) -> np.ndarray:
    numbers = validate.array(row, what, (None,), np.int32)
    wrong = (numbers < 0) | (numbers >= held.shape[1])
    if wrong.any():
        raise InputError(f"{what} must name particles from 0 to {held.shape[1] - 1}, got {numbers[wrong][0]}.")
    free = np.argwhere(~held[:, numbers])
    if len(free):
        world, k = free[0]
        raise InputError(f"{what} must name still pins, got particle {numbers[k]}, which is none in world {world}.")
    return numbers


def _check_apart(parts: Sequence[np.ndarray]) -> None:
    """No particle goes two ways at once."""
    handle: dict[int, int] = {}
    for h, part in enumerate(parts):
        for number in part.tolist():
            if number in handle:
                raise InputError(f"handles[{h}] must not name particle {number}, which handles[{handle[number]}] has.")
            handle[number] = h
