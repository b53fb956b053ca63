"""Springs in blocks for the CPU: each block's springs are solved by one thread, in the order of the model's list.

Blocks of one *phase* share no particle, and run at the same time. All of this is told world by world: what else is
simulated does not show.
"""

from itertools import pairwise

import numpy as np
import warp as wp

from ..model import Model
from .colouring import spring_colours

BLOCK = 512  # particles; 256 and 1,024 are as fast


def spring_levels(ends: np.ndarray, particle_count: int) -> np.ndarray:
    """Levels of springs such that solving them level by level is the same as one after the other.

    Springs of one level share no particle, so a processor may have several of them at work.

    Args:
        ends: their particles, int, shape [s, 2].

    Returns:
        Levels from 0, int, shape [s].
    """
    next_level = [0] * particle_count
    levels = np.empty(len(ends), np.int64)
    for s, (i, j) in enumerate(ends.tolist()):
        level = max(next_level[i], next_level[j])
        next_level[i] = next_level[j] = level + 1
        levels[s] = level
    return levels


def phases_of(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Phases of blocks, so that no two of one phase reach a common block.

    Args:
        low, high: the block that each spring belongs to, and the one that it reaches; int, shape [s].

    Returns:
        Phases from 0, int, shape [blocks].
    """
    count = int(max(low.max(initial=-1), high.max(initial=-1))) + 1
    reached: list[set[int]] = [{b} for b in range(count)]
    for b, other in set(zip(low.tolist(), high.tolist(), strict=True)):
        reached[b].add(other)
    taken: list[set[int]] = [set() for _ in range(count)]  # phases of the blocks that reach it
    phases = np.zeros(count, np.int64)
    for b in range(count):
        used = set().union(*(taken[other] for other in reached[b]))
        phases[b] = next(p for p in range(len(used) + 1) if p not in used)
        for other in reached[b]:
            taken[other].add(int(phases[b]))
    return phases


def block_of_particles(ends: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Blocks of the particles of one world: runs of them in their own order, or along the longest axis of what they
    form if that needs fewer phases.

    Args:
        ends: springs between them, shape [s, 2]. positions: [m], shape [n, 3].

    Returns:
        Blocks from 0, int, shape [n].
    """
    axis = int(np.argmax(np.ptp(positions, axis=0)))
    best, fewest = np.arange(len(positions)) // BLOCK, 0
    for rank in (np.arange(len(positions)), np.argsort(np.argsort(positions[:, axis], kind="stable"))):
        blocks = rank // BLOCK
        low, high = np.sort(blocks[ends], axis=1).T
        phases = int(phases_of(low, high).max(initial=0)) + 1
        if not fewest or phases < fewest:
            best, fewest = blocks, phases
        if fewest <= 2:
            break
    return best


def goes_on(ends: np.ndarray) -> bool:
    """Whether a list of springs, shape [s, 2], never stays at a particle, as that of a grid, which goes along threads.

    Sweeps in the order of a list that has all springs of a particle together overshoot, and blow up.
    """
    first, second, third = ends[:-2], ends[1:-1], ends[2:]

    def has(springs: np.ndarray, particle: np.ndarray) -> np.ndarray:
        return (springs == particle[:, None]).any(axis=1)

    return not any((has(second, first[:, k]) & has(third, first[:, k])).any() for k in (0, 1))


class SpringBlocks:
    """The springs of a model sorted by phase, block and, within it, by level or, where lists do not go on, by colour.

    Attributes:
        order: spring numbers, int, shape [spring_count].
        start: of each phase in ``order``, int, shape [phases + 1].
        ends: particle pairs, a Warp array per phase, vec2i.
        block_start: of each phase, where in it each block begins, and its length; a Warp array each, int32.
        in_list_order: which springs are solved as if one after the other in the order of the list, bool.
    """

    def __init__(self, model: Model):
        self.model = model
        ends = model.spring_indices.numpy().reshape(-1, 2)
        block, phase, self.in_list_order = self._blocks(ends)
        turn = np.zeros(len(ends), np.int64)
        for own, turns_of in ((self.in_list_order, spring_levels), (~self.in_list_order, spring_colours)):
            turn[own] = turns_of(ends[own], model.particle_count)
        self.order = np.lexsort((turn, block, phase))
        phases = int(phase.max(initial=-1)) + 1
        self.start = np.searchsorted(phase[self.order], np.arange(phases + 1))
        self.ends = self.views(model.array(ends[self.order], wp.vec2i))
        self.block_start = []
        for first, last in pairwise(self.start.tolist()):
            begins = np.flatnonzero(np.diff(block[self.order[first:last]], prepend=-1))
            self.block_start.append(model.array(np.append(begins, last - first), wp.int32))

    def views(self, whole: wp.array) -> list[wp.array]:
        """The part of each phase in an array in their order, shape [spring_count]."""
        return [whole[a:b] for a, b in pairwise(self.start.tolist())]

    def _blocks(self, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Block and phase of each spring, and whether the list of its world goes on."""
        world = self.model.particle_world.numpy()
        positions = self.model.particle_q.numpy()
        bounds = np.searchsorted(world, np.arange(self.model.world_count + 1))
        block, phase = (np.zeros(len(ends), np.int64) for _ in range(2))
        in_order = np.zeros(len(ends), bool)
        springs = np.searchsorted(world[ends[:, 0]], np.arange(self.model.world_count + 1))
        count = 0
        for w, (first, last) in enumerate(pairwise(bounds.tolist())):
            own = slice(springs[w], springs[w + 1])
            if springs[w] == springs[w + 1]:
                continue
            of_particle = block_of_particles(ends[own] - first, positions[first:last])
            low, high = np.sort(of_particle[ends[own] - first], axis=1).T
            block[own] = count + low
            phase[own] = phases_of(low, high)[low]
            in_order[own] = goes_on(ends[own])
            count += int(of_particle.max(initial=-1)) + 1
        return block, phase, in_order
