"""Which springs the CPU works on eight at once: see ``kernels/spring_tiles.py``."""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import warp as wp

from ..launching import launch
from ..model import Model

SMALLEST_BLOCK = 512  # particles that one thread has at a time
FURTHEST = 4096  # numbers that a spring may lead further: bounds each thread's memory
LEAST_FILL = 0.4  # springs in a lane, below which one by one is faster


class Lanes(NamedTuple):
    """Springs in lanes, entry after entry.

    Attributes:
        block: particles of each block, first and last (not included): of what it reaches, and maybe more; int.
        phase: of each block, in which it is worked on: those of one phase at the same time; int, shape [b].
        entry: block, first particle, and how much further the springs lead, int, shape [e, 3].
        lane_spring: which spring is in a lane, −1: none; int, shape [e, lanes].
    """

    block: np.ndarray
    phase: np.ndarray
    entry: np.ndarray
    lane_spring: np.ndarray


def springs_by_world(model: Model) -> list[tuple[np.ndarray, int, int]]:
    """Of each world the numbers of its springs, in rising order, and its first and last particle (not included).

    Worlds count as one where their particles are not in rows of their own, as some of Newton's are not.
    """
    world, ends = model.particle_world.numpy(), model.spring_indices.numpy().reshape(-1, 2)
    of_spring = world[ends[:, 0]]
    if (np.diff(world) < 0).any() or not np.array_equal(of_spring, world[ends[:, 1]]):
        return [(np.arange(len(ends)), 0, len(world))]
    bounds = np.arange(model.world_count + 1)
    particles = pairwise(np.searchsorted(world, bounds).tolist())
    order = np.argsort(of_spring, kind="stable")
    springs = np.split(order, np.searchsorted(of_spring[order], bounds[1:-1]))
    return [(own, first, last) for own, (first, last) in zip(springs, particles, strict=True)]


def in_lanes(model: Model, arrange: Callable[[np.ndarray, int, int], Lanes | None]) -> tuple[Lanes, np.ndarray]:
    """Springs of the worlds where it pays.

    Args:
        model: the model.
        arrange: what makes lanes of one world's springs (their particles, as the model lists them, but counted from the
            world's first; how many it has; how many lanes); None: not these.

    Returns:
        The lanes of all those worlds, and which springs of the model are not in them, bool.
    """
    count, ends = model.kernels.lanes.LANES, model.spring_indices.numpy().reshape(-1, 2)
    left, parts, blocks = np.ones(len(ends), bool), [], 0
    known: dict[tuple[int, bytes], Lanes | None] = {}  # worlds are mostly alike
    for springs, first, last in springs_by_world(model):
        if len(springs) == 0 or int(np.ptp(ends[springs], axis=1).max()) > FURTHEST:
            continue
        own = ends[springs] - first
        key = last - first, own.tobytes()
        if key not in known:
            known[key] = arrange(own, last - first, count)
        part = known[key]
        if part is None or len(springs) < LEAST_FILL * part.lane_spring.size:
            continue
        left[springs] = False
        lane_spring = np.where(part.lane_spring < 0, -1, springs[part.lane_spring])
        parts.append(Lanes(part.block + first, part.phase, part.entry + np.array([blocks, first, 0]), lane_spring))
        blocks += len(part.block)
    if not parts:
        return Lanes(*(np.zeros(shape, int) for shape in ((0, 4), 0, (0, 3), (0, count)))), left
    return Lanes(*map(np.concatenate, zip(*parts, strict=True))), left


def copies(ends: np.ndarray) -> np.ndarray:
    """How many springs before a spring join the same particles, shape [s], for ends in rising order, shape [s, 2]."""
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    begins = np.r_[True, (np.diff(ends[order], axis=0) != 0).any(axis=1)]
    place = np.arange(len(ends))
    copy = np.empty(len(ends), np.int64)
    copy[order] = place - np.maximum.accumulate(np.where(begins, place, 0))
    return copy


def shares(count: int, ranges: int) -> list[int]:
    """Where the shares of at most ``ranges`` threads in so many blocks begin, and where the last one ends."""
    slots = min(ranges, count)
    return [count * k // slots for k in range(slots + 1)]


class LaneLaws:
    """Copies of the properties of springs in lanes; see ``arrange_lanes`` of ``kernels/springs.py``.

    Args:
        model: the model. lane_spring: as :class:`Lanes` has it.

    Attributes:
        lane_spring: which spring is in a lane, entry after entry, int32, shape [entries × lanes].
    """

    def __init__(self, model: Model, lane_spring: np.ndarray):
        self._model, (self._count, self._lanes) = model, lane_spring.shape
        self.lane_spring = model.array(lane_spring.reshape(-1), wp.int32)
        self._law = wp.zeros(3 * lane_spring.size, dtype=model.real, device=model.device)
        self._shared_law = wp.zeros(self._count, dtype=model.vec3, device=model.device)
        self._shared_by = wp.zeros(self._count, dtype=wp.int32, device=model.device)
        self.arrange()

    def arrange(self) -> None:
        """Takes over stiffness, damping and rest lengths of the model's springs, should they have changed."""
        model = self._model
        launch(
            model.kernels.springs.arrange_lanes,
            dim=self._count,
            inputs=[self.lane_spring, model.spring_rest_length, model.spring_stiffness, model.spring_damping],
            outputs=[self._law, self._shared_law, self._shared_by],
            device=model.device,
        )

    def of_entries(self, first: int, last: int) -> list[wp.array]:
        """What kernels take, for some of the entries."""
        wide = 3 * self._lanes
        return [self._law[wide * first : wide * last], self._shared_law[first:last], self._shared_by[first:last]]
