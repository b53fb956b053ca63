"""Colours for work in parallel: items of one colour touch no particle in common, or are no neighbours.

First fit in the given order, on the host, once: deterministic, and on regular grids (whose springs come family by
family, row by row) as few colours as the most connected particle has springs, which is the least possible.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import warp as wp

from ..model import Model


def spring_colours(ends: np.ndarray | Sequence[Sequence[int]], particle_count: int) -> np.ndarray:
    """Colour of each spring, triangle or row of springs, so that no two of one colour share a particle.

    Args:
        ends: their particles, int, shape [s, 2] or [s, 3], or lists of any length.

    Returns:
        Colours from 0, int32, shape [s].
    """
    used = [0] * particle_count  # bit c: a spring of colour c ends here
    colours = np.empty(len(ends), np.int32)
    for s, particles in enumerate(ends.tolist() if isinstance(ends, np.ndarray) else ends):
        taken = 0
        for i in particles:
            taken |= used[i]
        free = ~taken & (taken + 1)
        for i in particles:
            used[i] |= free
        colours[s] = free.bit_length() - 1
    return colours


def particle_colours(ends: np.ndarray, particle_count: int) -> np.ndarray:
    """Colour of each particle, so that no two particles of one colour share a spring.

    Returns:
        Colours from 0, int32, shape [particle_count].
    """
    both = np.concatenate([ends, ends[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    start = np.searchsorted(both[:, 0], np.arange(particle_count + 1)).tolist()
    other = both[:, 1].tolist()
    bits = [0] * particle_count  # bit of the colour, 0 while it has none
    for i in range(particle_count):
        taken = 0
        for j in other[start[i] : start[i + 1]]:
            taken |= bits[j]
        bits[i] = ~taken & (taken + 1)
    return np.array([b.bit_length() - 1 for b in bits], np.int32)


def grouped(colours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Items sorted by colour, in their old order within each.

    Returns:
        (order, start): colour c has the items ``order[start[c]:start[c + 1]]``.
    """
    order = np.argsort(colours, kind="stable")
    count = int(colours.max()) + 1 if len(colours) else 0
    return order, np.searchsorted(colours[order], np.arange(count + 1))


class SpringColours:
    """The springs of a model sorted by colour.

    Attributes:
        order: spring numbers, sorted by colour, int, shape [spring_count].
        start: of each colour in ``order``, int, shape [colour_count + 1].
        ends: particle pairs, a Warp array per colour, vec2i.
        block_start: none; the springs of a colour are solved in any order.
    """

    def __init__(self, model: Model):
        self.block_start: list[wp.array] = []
        ends = model.spring_indices.numpy()
        self.model = model
        self.order, self.start = grouped(spring_colours(ends, model.particle_count))
        self.ends = self.arranged(ends, wp.vec2i)

    def arranged(self, values: np.ndarray, dtype: type) -> list[wp.array]:
        """One array per colour from a row per spring: views of one piece of memory."""
        return self.views(self.model.array(values[self.order], dtype))

    def views(self, whole: wp.array) -> list[wp.array]:
        """The part of each colour in an array in their order, shape [spring_count]."""
        return [whole[a:b] for a, b in zip(self.start[:-1].tolist(), self.start[1:].tolist(), strict=True)]


class TriangleColours:
    """The woven triangles of a model sorted by colour.

    Attributes:
        numbers: of the triangles of each colour, a Warp array each, int32.
        corner: the first corner of each of them, int, on the host.
    """

    def __init__(self, model: Model):
        corners = model.woven.corners.numpy().reshape(-1, 3)
        order, start = grouped(spring_colours(corners, model.particle_count))
        parts = [order[a:b] for a, b in pairwise(start.tolist())]
        self.numbers = [model.array(part, wp.int32) for part in parts]
        self.corner = [corners[part, 0] for part in parts]
