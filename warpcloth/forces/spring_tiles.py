"""Forces of springs in lanes; see ``kernels/spring_tiles.py``."""

import numpy as np
import warp as wp

from ..launching import launch
from ..model import Model
from ..state import State
from . import lanes as lanes_module
from .base import Linearization, Move
from .lanes import LaneLaws, Lanes, copies

BLOCK_TO_REACH = 4  # particles, so that no more than a quarter of the springs is evaluated twice


def arranged(listed: np.ndarray, count: int, lanes: int) -> Lanes:
    """Springs of one world, tile by tile, the furthest first, those that lead into a block from before among its own.

    Blocks are told by the first and last particle of what they read, and of what is their own, shape [b, 4]. Arguments
    as for :func:`~warpcloth.forces.lanes.in_lanes`.
    """
    ends = np.sort(listed, axis=1)
    near, far = ends.T
    reach = int((far - near).max())
    size = max(lanes_module.SMALLEST_BLOCK, -(-BLOCK_TO_REACH * reach // lanes) * lanes)  # whole tiles
    begins = np.arange(0, count, size)
    stops = np.minimum(begins + size, count)
    before = -(-reach // lanes) * lanes
    block = np.stack([np.maximum(begins - before, 0), np.minimum(stops + reach, count), begins, stops], axis=1)
    own = near // size
    again = np.flatnonzero(far // size != own)
    spring = np.concatenate([np.arange(len(ends)), again])
    of_block = np.concatenate([own, far[again] // size])
    particle = near[spring]
    lane = particle % lanes
    key = np.stack([of_block, particle - lane, (near - far)[spring], copies(ends)[spring]], axis=1)
    entry, of_key = np.unique(key, axis=0, return_inverse=True)
    lane_spring = np.full((len(entry), lanes), -1)
    lane_spring[of_key.reshape(-1), lane] = spring
    return Lanes(block, np.zeros(len(block), int), entry[:, :3] * (1, 1, -1), lane_spring)


class SpringTiles:
    """Springs in lanes, and copies of their properties that :meth:`arrange` brings up to date.

    Args:
        model: the model. lanes: its springs. ranges: how many threads may sum forces at the same time.

    Attributes:
        has_all: whether each particle of the model belongs to a block.
    """

    def __init__(self, model: Model, lanes: Lanes, ranges: int):
        self.model, self._kernels = model, model.kernels.spring_tiles
        block, entry, lane_spring = lanes.block, lanes.entry, lanes.lane_spring
        tile, first_entry = np.unique(entry[:, :2], axis=0, return_index=True)
        bounds = np.searchsorted(tile[:, 0], np.arange(len(block) + 1))
        self._tiles = self._kernels.Tiles()
        self._tiles.block = model.array(np.column_stack([bounds[:-1], bounds[1:], block]), wp.int32)
        self._tiles.particle = model.array(tile[:, 1], wp.int32)
        self._tiles.start = model.array(np.append(first_entry, len(entry)), wp.int32)
        self._tiles.offset = model.array(entry[:, 2], wp.int32)
        starts = lanes_module.shares(len(block), ranges)
        self._slot_start = model.array(starts, wp.int32)
        room = int((block[:, 1] - block[:, 0]).max()) + 2 * lane_spring.shape[1]
        self._memory = wp.zeros((len(starts) - 1, self._kernels.ROWS * room), dtype=model.real, device=model.device)
        self._laws = LaneLaws(model, lane_spring)
        self._inputs = [self._tiles, self._slot_start, *self._laws.of_entries(0, len(entry))]
        self._no_gravity = wp.zeros(0, dtype=model.vec3, device=model.device)
        self.has_all = bool((block[:, 3] - block[:, 2]).sum() == model.particle_count)

    def arrange(self) -> None:
        """Takes over stiffness, damping and rest lengths of the model's springs, should they have changed."""
        self._laws.arrange()

    def accumulate(self, state: State, world_gravity: wp.array | None = None) -> None:
        """Adds spring forces [N] to ``state.particle_f``; where ``world_gravity`` is given, [m/s²], to m g instead."""
        model = self.model
        gravity = self._no_gravity if world_gravity is None else world_gravity
        launch(
            self._kernels.pull_blocks,
            dim=len(self._slot_start) - 1,
            inputs=[
                *self._inputs, model.particle_mass, model.particle_world, gravity, state.particle_q, state.particle_qd,
            ],
            outputs=[self._memory, state.particle_f],
            device=model.device,
        )  # fmt: skip

    def advance(self, start: State, end: State, world_gravity: wp.array, move: Move) -> None:
        """Writes m g and spring forces [N] into ``start.particle_f``, and what they make of the particles into ``end``,
        another state."""
        model = self.model
        launch(
            self._kernels.advance_blocks,
            dim=len(self._slot_start) - 1,
            inputs=[
                *self._inputs, model.particle_mass, model.particle_world, model.particle_inv_mass, world_gravity,
                start.particle_q, start.particle_qd, *move,
            ],
            outputs=[self._memory, start.particle_f, end.particle_q, end.particle_qd],
            device=model.device,
        )  # fmt: skip

    def multiply(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds (a K + b C) x to ``out``; see :class:`~warpcloth.forces.base.ForceTerm`."""
        where = [at.world_project, at.state.particle_q, at.state.particle_qd, x, at.stiffness, at.damping]
        launch(
            self._kernels.multiply_blocks,
            dim=len(self._slot_start) - 1,
            inputs=[*self._inputs, self.model.particle_world, *where],
            outputs=[self._memory, out],
            device=self.model.device,
        )
