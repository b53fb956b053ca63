"""Pinned particles as handles that are led at given velocities."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from .. import validate
from ..errors import InputError
from ..hooks import Hook
from ..launching import launch
from ..model import Model
from ..state import State


class Handles(Hook):
    """Leads groups of pinned particles, the same ones in each world.

    Args:
        model: the model, of worlds with equally many particles.
        groups: of each handle, numbers of particles within a world; None: each pinned particle is a handle.

    Raises:
        InputError: a particle that there is not, is not pinned, or is pinned with a motion of its own.

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
        parts = [_checked(row, f"handles[{h}]", held) for h, row in enumerate(rows)]
        self.velocity = wp.zeros((worlds, len(parts)), dtype=model.vec3, device=model.device)
        own = np.concatenate([np.zeros(0, np.int32), *parts])
        world = np.repeat(np.arange(worlds), len(own))
        handle = np.tile(np.repeat(np.arange(len(parts)), [len(part) for part in parts]), worlds)
        columns = (np.tile(own, worlds) + size * world, world, handle)
        self._rows = [model.array(column.astype(np.int32), wp.int32) for column in columns]

    def before_step(self, state: State, dt: float) -> None:
        """Puts the held particles where they will be at the end of the step."""
        self._lead(state, dt)

    def after_integration(self, start: State, end: State, dt: float) -> None:
        """Gives them their velocities again, which some schemes take for 0."""
        self._lead(end, 0.0)

    def _lead(self, state: State, dt: float) -> None:
        launch(
            self.model.kernels.handles.lead,
            dim=len(self._rows[0]),
            inputs=[*self._rows, self.velocity, dt],
            outputs=[state.particle_q, state.particle_qd],
            device=self.model.device,
        )


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
