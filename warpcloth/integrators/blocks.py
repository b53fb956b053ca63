"""Springs in blocks for the CPU: each block's springs are solved by one thread, colour by colour.

Blocks of one *phase* share no particle, and run at the same time. All of this is told world by world: what else is
simulated does not show.
"""

from itertools import pairwise

import numpy as np
import warp as wp

from ..forces.lanes import springs_by_world
from ..model import Model
from .colouring import spring_colours

BLOCK = 512  # particles; 256 and 1,024 are as fast


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


class SpringBlocks:
    """Springs of a model sorted by phase, block and, within it, by colour.

    Args:
        model: the model. springs: which of its springs, int.

    Attributes:
        order: spring numbers, int, shape [s].
        start: of each phase in ``order``, int, shape [phases + 1].
        ends: particle pairs, a Warp array per phase, vec2i.
        block_start: of each phase, where in it each block begins, and its length; a Warp array each, int32.
    """

    def __init__(self, model: Model, springs: np.ndarray):
        self.model = model
        ends = model.spring_indices.numpy().reshape(-1, 2)
        block, phase = self._blocks(ends, springs)
        colour = spring_colours(ends[springs], model.particle_count)
        by_turn = np.lexsort((colour, block, phase))
        self.order = springs[by_turn]
        block, phase = block[by_turn], phase[by_turn]
        phases = int(phase.max(initial=-1)) + 1
        self.start = np.searchsorted(phase, np.arange(phases + 1))
        self.ends = self.views(model.array(ends[self.order], wp.vec2i))
        self.block_start = []
        for first, last in pairwise(self.start.tolist()):
            begins = np.flatnonzero(np.diff(block[first:last], prepend=-1))
            self.block_start.append(model.array(np.append(begins, last - first), wp.int32))

    def views(self, whole: wp.array) -> list[wp.array]:
        """The part of each phase in an array in their order, shape [s]."""
        return [whole[a:b] for a, b in pairwise(self.start.tolist())]

    def _blocks(self, ends: np.ndarray, springs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Block and phase of each spring."""
        positions = self.model.particle_q.numpy()
        block, phase = (np.zeros(len(ends), np.int64) for _ in range(2))
        count = 0
        for whole, first, last in springs_by_world(self.model):
            own = np.intersect1d(whole, springs, assume_unique=True)
            if len(own) == 0:
                continue
            of_particle = block_of_particles(ends[own] - first, positions[first:last])
            low, high = np.sort(of_particle[ends[own] - first], axis=1).T
            block[own] = count + low
            phase[own] = phases_of(low, high)[low]
            count += int(of_particle.max(initial=-1)) + 1
        return block[springs], phase[springs]
