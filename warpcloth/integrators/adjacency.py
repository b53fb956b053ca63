"""The springs of each particle in rows, particles sorted by colour."""

import numpy as np
import warp as wp

from ..forces.springs import LAW
from ..model import Model
from .colouring import grouped
from .spring_properties import SpringProperties


class SpringRows:
    """Rows of (other particle, law) of every particle, sorted so that each colour is a contiguous range.

    Args:
        model: the model.
        colours: of each particle, int, shape [particle_count]; None for one colour, particles in their own order.

    Attributes:
        particles: particle numbers of each colour, int32.
        start: rows of those particles, int32, one more than there are particles, for each colour.
        other: particle at the other end, int32, shape [2 spring_count].
        properties, law: (r [m], k_s [N], k_d [N s]), vec3, shape [2 spring_count].
    """

    def __init__(self, model: Model, colours: np.ndarray | None = None):
        ends = model.spring_indices.numpy()
        n = model.particle_count
        order, bounds = grouped(np.zeros(n, np.int32) if colours is None else colours)
        place = np.empty(n, np.int64)
        place[order] = np.arange(n)
        this = np.concatenate([ends[:, 0], ends[:, 1]])
        rows = np.lexsort((np.tile(np.arange(len(ends)), 2), place[this]))
        start = np.concatenate([[0], np.cumsum(np.bincount(place[this], minlength=n))]).astype(np.int32)
        self.properties = SpringProperties(model, rows % len(ends), LAW)
        self.other = model.array(np.concatenate([ends[:, 1], ends[:, 0]])[rows].astype(np.int32), wp.int32)
        self.law = self.properties.values
        particles, starts = model.array(order.astype(np.int32), wp.int32), model.array(start, wp.int32)
        spans = list(zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True))
        self.particles = [particles[a:b] for a, b in spans]
        self.start = [starts[a : b + 1] for a, b in spans]
