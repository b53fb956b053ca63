"""Single worlds of a simulation: back to their start, on the device; on into another model."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from . import validate
from .errors import InputError
from .model import Model
from .state import Memory, State


class WorldReset:
    """The start of every world, and how to get back there.

    Args:
        model: the model.
        state: the state at the start.
    """

    def __init__(self, model: Model, state: State):
        self.model = model
        self._start = [(wp.clone(array), array) for array in (state.particle_q, state.particle_qd)]
        self._clock = state.world_time
        self._rows: list[tuple[wp.array, wp.array]] | None = None

    def apply(self, mask: wp.array, memory: Sequence[Memory]) -> None:
        """Resets the worlds in ``mask``, and what is remembered of them; allocates when called first only.

        Args:
            mask: bool, shape [world_count], on the model's device.
            memory: all that the next step depends on besides the state; the same at every call.
        """
        kernels, world = self.model.kernels.world_rows, self.model.particle_world
        if self._rows is None:
            self._rows = [self._rows_of(item) for item in [*memory, Memory(self._clock, None)] if len(item.array)]
        for start, now in self._start:
            self._launch(kernels.copy_rows, [mask, world, words(start)], words(now))
        for array, worlds in self._rows:
            self._launch(kernels.clear_rows, [mask, worlds], words(array))

    def _rows_of(self, item: Memory) -> tuple[wp.array, wp.array]:
        """An array and the world of each of its rows."""
        if item.particle is None:
            return item.array, self.model.array(np.arange(self.model.world_count), wp.int32)
        return item.array, self.model.array(self.model.particle_world.numpy()[item.particle], wp.int32)

    def _launch(self, kernel: wp.Kernel, inputs: list[wp.array], out: wp.array) -> None:
        wp.launch(kernel, dim=out.shape, inputs=inputs, outputs=[out], device=self.model.device)


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
        own.array.assign(item.array.numpy()[worlds if item.particle is None else kept[item.particle]])


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
    values = np.asarray(mask)
    if values.dtype != np.bool_ or values.shape != (count,):
        expected = f"World mask must be booleans of shape ({count},), one for each world"
        raise InputError(f"{expected}, got {values.dtype} of shape {values.shape}.")
    return wp.array(values, dtype=wp.bool, device=model.device)
