"""Bending elements of cloth that is numbered like a grid, eight at a time; see ``kernels/bending_lanes.py``."""

from typing import NamedTuple

import numpy as np
import warp as wp

from ..launching import launch
from ..model import Model
from ..state import State
from . import lanes as lanes_module

BLOCK_TO_REACH = 4  # particles, so that no more than a quarter of the elements is evaluated twice


class Grouped(NamedTuple):
    """Elements in groups.

    Attributes:
        block: first and last group (the latter not included), first and last particle of what a block reads, and of
            what is its own, shape [b, 6]. group: first element and how many, of all blocks, shape [g, 2].
        each: the same, but each element once, shape [h, 2]. left: which elements are in none, bool.
    """

    block: np.ndarray
    group: np.ndarray
    each: np.ndarray
    left: np.ndarray


def follows(model: Model) -> np.ndarray:
    """Which elements lead to the particles of the one before, each moved on by 1, with the same weights, bool."""
    elements = model.bending
    start, particle = elements.start.numpy(), elements.particle.numpy()
    values = np.column_stack([elements.weight.numpy(), elements.tangent.numpy()])
    turning = elements.turning_end.numpy() - start[:-1]
    counts = np.diff(start)
    same = (counts[1:] == counts[:-1]) & (turning[1:] == turning[:-1])
    for entry in range(int(counts.max(initial=0))):
        has = same & (entry < counts[:-1])
        before, after = start[:-2][has] + entry, start[1:-1][has] + entry
        like = (particle[after] == particle[before] + 1) & (values[after] == values[before]).all(axis=1)
        same[has] = like
    world = model.particle_world.numpy()[particle[start[:-1]]]
    return np.concatenate([[False], same & (world[1:] == world[:-1])])


def in_groups(elements: np.ndarray, follower: np.ndarray, most: int) -> np.ndarray:
    """Elements, rising numbers, cut into groups of at most ``most`` that follow each other, shape [g, 2]."""
    if len(elements) == 0:
        return np.zeros((0, 2), int)
    goes_on = np.concatenate([[False], follower[elements[1:]] & (np.diff(elements) == 1)])
    place = np.arange(len(elements))
    chain = np.maximum.accumulate(np.where(goes_on, 0, place))
    begins = np.flatnonzero((place - chain) % most == 0)
    return np.column_stack([elements[begins], np.diff(np.append(begins, len(elements)))])


def grouped(model: Model) -> Grouped:
    """The elements of all worlds where it pays; what is done in one does not depend on the others."""
    most, follower = model.kernels.lanes.LANES, follows(model)
    start, particle = model.bending.start.numpy(), model.bending.particle.numpy()
    low, high = (f.reduceat(particle, start[:-1]) for f in (np.minimum, np.maximum))
    worlds = model.particle_world.numpy()
    of_element, first = worlds[particle[start[:-1]]], np.searchsorted(worlds, np.arange(model.world_count + 1))
    left, blocks, groups, each, count = np.ones(len(low), bool), [], [], [], 0
    for world in np.unique(of_element):
        own = np.flatnonzero(of_element == world)
        once, reach = in_groups(own, follower, most), int((high - low)[own].max())
        if reach > lanes_module.FURTHEST or len(own) < lanes_module.LEAST_FILL * most * len(once):
            continue
        left[own] = False
        each.append(once)
        size = max(lanes_module.SMALLEST_BLOCK, BLOCK_TO_REACH * reach)
        for begin in range(first[world], first[world + 1], size):
            stop = min(begin + size, first[world + 1])
            touching = own[(low[own] < stop) & (high[own] >= begin)]
            parts = in_groups(touching, follower, most)
            reads = (low[touching].min(initial=begin), high[touching].max(initial=stop - 1) + 1)
            blocks.append([count, count + len(parts), *reads, begin, stop])
            groups.append(parts)
            count += len(parts)
    none = np.zeros((0, 2), int)
    return Grouped(
        np.array(blocks).reshape(-1, 6), np.concatenate([none, *groups]), np.concatenate([none, *each]), left
    )  # fmt: skip


class BendingLanes:
    """Bending elements in groups.

    Args:
        model: the model. found: its groups, at least one. ranges: how many threads may sum forces at the same time.
    """

    def __init__(self, model: Model, found: Grouped, ranges: int):
        self.model, self._kernels = model, model.kernels.bending_lanes
        self._groups, self._each = self._kernels.Groups(), self._kernels.Groups()
        self._groups.block = self._each.block = model.array(found.block, wp.int32)
        self._groups.group, self._each.group = model.array(found.group, wp.int32), model.array(found.each, wp.int32)
        starts = lanes_module.shares(len(found.block), ranges)
        self._slot_start = model.array(starts, wp.int32)
        room = int((found.block[:, 3] - found.block[:, 2]).max()) + 2 * model.kernels.lanes.LANES
        self._memory = wp.zeros((len(starts) - 1, self._kernels.ROWS * room), dtype=model.real, device=model.device)

    def accumulate(self, state: State, slip: wp.array) -> None:
        """Adds bending forces [N] to ``state.particle_f``."""
        launch(
            self._kernels.pull_blocks,
            dim=len(self._slot_start) - 1,
            inputs=[self._groups, self._slot_start, self.model.bending, slip, state.particle_q, state.particle_qd],
            outputs=[self._memory, state.particle_f],
            device=self.model.device,
        )

    def resist(self, x: wp.array, dt: float, out: wp.array) -> None:
        """Adds −(h² K + 2 h C) x to ``out``; see :meth:`~warpcloth.forces.bending.Bending.resist`."""
        launch(
            self.model.kernels.bending_filter.resist_blocks,
            dim=len(self._slot_start) - 1,
            inputs=[self._groups, self._slot_start, self.model.bending, x, dt],
            outputs=[self._memory, out],
            device=self.model.device,
        )

    def advance(self, state: State, slip: wp.array) -> None:
        """The end of a step: ``slip`` follows to ``state``."""
        launch(
            self._kernels.advance_slips,
            dim=len(self._each.group),
            inputs=[self._each, self.model.bending, state.particle_q],
            outputs=[slip],
            device=self.model.device,
        )
