"""Single worlds of a simulation: back to their start, on the device; on into another model."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from . import validate
from .errors import InputError
from .model import Model
from .state import Memory, State


class WorldRows:
    """Rows of arrays that belong to worlds of a model, put back or cleared for the worlds in a mask.

    A mask is bool, shape [world_count], on the model's device. Launches kernels only, but allocates when
    :meth:`clear` is called first.
    """

    def __init__(self, model: Model):
        self.model = model
        self._memory: list[tuple[wp.array, wp.array]] | None = None

    def restore(self, mask: wp.array, start: wp.array, now: wp.array) -> None:
        """Rows of ``now``, one for each particle, become those of ``start``."""
        self._launch("copy_rows", [mask, self.model.particle_world, words(start)], words(now))

    def clear(self, mask: wp.array, memory: Sequence[Memory]) -> None:
        """Rows of what is remembered become zero; it must be the same at every call."""
        if self._memory is None:
            self._memory = [(item.array, self._world_of(item)) for item in memory if len(item.array)]
        for array, worlds in self._memory:
            self._launch("clear_rows", [mask, worlds], words(array))

    def _world_of(self, item: Memory) -> wp.array:
        model = self.model
        worlds = np.arange(model.world_count) if item.particle is None else model.particle_world.numpy()[item.particle]
        return model.array(worlds, wp.int32)

    def _launch(self, kernel: str, inputs: list[wp.array], out: wp.array) -> None:
        model = self.model
        kernels = model.kernels.world_rows
        wp.launch(getattr(kernels, kernel), dim=out.shape, inputs=inputs, outputs=[out], device=model.device)


class WorldReset:
    """The start of every world of a simulation, and the way back there.

    Args:
        model: the model.
        state: the state at the start.
    """

    def __init__(self, model: Model, state: State):
        self._rows = WorldRows(model)
        self._start = [(wp.clone(array), array) for array in (state.particle_q, state.particle_qd)]
        self._clock = Memory(state.world_time, None)

    def apply(self, mask: wp.array, memory: Sequence[Memory]) -> None:
        """Resets the worlds in ``mask``, and all that is remembered of them, the same at every call."""
        for start, now in self._start:
            self._rows.restore(mask, start, now)
        self._rows.clear(mask, [*memory, self._clock])


def take_worlds(
    state: State,
    memory: Sequence[Memory],
    model: Model,
    other: State,
    known: Sequence[Memory],
    worlds: list[int],
) -> None:
    """Makes ``state`` and ``memory`` those of some worlds of ``other``, a state of ``model``, and its memory."""
    kept = np.isin(model.particle_world.numpy(), worlds)
    state.particle_q.assign(other.particle_q.numpy()[kept])
    state.particle_qd.assign(other.particle_qd.numpy()[kept])
    state.world_time.assign(other.world_time.numpy()[worlds])
    for own, item in zip(memory, known, strict=False):
        if len(own.array):
            own.array.assign(item.array.numpy()[worlds if item.particle is None else kept[item.particle]])


def worlds_to_keep(simulation: Any, other: Any, worlds: Any) -> list[int]:
    """Numbers of worlds of another simulation that one can go on with.

    Raises:
        InputError: there are no such worlds, they do not rise, have other particles, another integrator or other hooks,
            or something in the other simulation is held by a grab.
    """
    numbers = validate.array(worlds, "worlds", (None,), np.int64).tolist()
    last = other.model.world_count - 1
    if numbers != sorted({k for k in numbers if 0 <= k <= last}):
        raise InputError(f"Worlds must be numbers from 0 to {last} in rising order, got {validate.shown(worlds)}.")
    count = int(np.isin(other.model.particle_world.numpy(), numbers).sum())
    if count != simulation.model.particle_count:
        raise InputError(f"These worlds have {count} particles; the model here has {simulation.model.particle_count}.")
    if type(simulation.integrator) is not type(other.integrator):
        names = f"{other.integrator.name}, not {simulation.integrator.name}"
        raise InputError(f"A simulation can go on only with the integrator of the other one, {names}.")
    if other._grabs is not None and any(hold is not None for hold in other._grabs.holds):
        raise InputError("A simulation cannot go on with what a hand holds; release the grabs of the other one first.")
    hooks = [", ".join(type(hook).__name__ for hook in one.hooks) or "none" for one in (other, simulation)]
    if hooks[0] != hooks[1]:
        raise InputError(f"A simulation can go on only with hooks like those of the other one, {', not '.join(hooks)}.")
    return numbers


def words(array: wp.array) -> wp.array:
    """The same memory as 32-bit words, shape [rows, words per row]."""
    shape = (len(array), wp.types.type_size_in_bytes(array.dtype) // 4)
    return wp.array(ptr=array.ptr, dtype=wp.int32, shape=shape, device=array.device)


def world_mask(mask: Any, model: Model) -> wp.array:
    """The mask as bool on the model's device, shape [world_count]; a Warp array is taken as it is.

    Args:
        mask: which worlds: booleans, one for each; None: all.

    Raises:
        InputError: the mask has another shape, dtype or device.
    """
    count = model.world_count
    if mask is None:
        return wp.ones(count, dtype=wp.bool, device=model.device)
    if isinstance(mask, wp.array):
        return validate.device_array(mask, "world mask", wp.bool, (count,), model.device)
    values = np.asarray(mask) if validate.axes(mask) == 1 else None
    if values is None or values.dtype != np.bool_ or values.shape != (count,):
        expected = f"World mask must be booleans of shape ({count},), one for each world"
        got = validate.shown(mask) if values is None else f"{values.dtype} of shape {values.shape}"
        raise InputError(f"{expected}, got {got}.")
    return wp.array(values, dtype=wp.bool, device=model.device)
