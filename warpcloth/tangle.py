"""What is wrong with how cloth starts, world by world, and the best that was seen on the way out of it."""

import numpy as np

from .diagnostics import DEEP_START, penetration_depths
from .intersections import Triangles
from .model import Model
from .state import State


class Tangle:
    """A state on its way out of intersections. What is wrong in one world moves no other by a single bit.

    Attributes:
        found: for counting and parting triangles. world, free: of each particle, its number and whether it can move.
        wrong: by world, what is wrong with the best positions that were seen, see :meth:`measure`.
    """

    def __init__(self, model: Model, state: State):
        self.model, self.state, self.found = model, state, Triangles(model)
        self.world, self.free = model.particle_world.numpy(), model.particle_inv_mass.numpy() > 0.0
        self._best, self.wrong = self.positions, self.measure()

    @property
    def positions(self) -> np.ndarray:
        """Where the particles are, shape [n, 3] [m]."""
        return self.state.particle_q.numpy().copy()

    @property
    def tangled(self) -> np.ndarray:
        """Of each world, whether something is wrong with the best that was seen."""
        return self.wrong >= 1.0

    def depths(self) -> np.ndarray:
        """How deep each free particle is in solids [m]; 0 outside, and for pins."""
        return np.where(self.free, penetration_depths(self.model, self.state), 0.0)

    def figures(self) -> tuple[int, int]:
        """Pairs of triangles that intersect, and free particles too deep in solids, in all worlds."""
        return int(self.found.count(self.state).sum()), int(np.count_nonzero(self.depths() > DEEP_START))

    def worlds_with(self, particles: np.ndarray) -> np.ndarray:
        """Of each world, whether it has one of these particles, a mask."""
        return np.bincount(self.world[particles], minlength=len(self.wrong)) > 0

    def measure(self) -> np.ndarray:
        """Of each world the pairs of triangles that intersect and the free particles too deep in solids, in all, and a
        fraction that grows with the greatest depth; shape [world_count]."""
        wrong = self.found.count(self.state).sum(axis=1).astype(float)
        depths = self.depths()
        np.add.at(wrong, self.world, depths > DEEP_START)
        deepest = np.zeros(len(wrong))
        np.maximum.at(deepest, self.world, depths)
        return wrong + deepest / (1.0 + deepest)

    def look(self) -> np.ndarray:
        """Measures, and keeps those worlds that are better than ever; returns which are still tangled."""
        wrong = self.measure()
        better = wrong < self.wrong
        self._best = np.where(better[self.world, None], self.positions, self._best)
        self.wrong = np.where(better, wrong, self.wrong)
        return wrong >= 1.0

    def place(self, positions: np.ndarray, worlds: np.ndarray) -> None:
        """Moves the particles of some worlds, a mask, to ``positions`` [m]."""
        self.state.particle_q.assign(np.where(worlds[self.world, None], positions, self.positions))

    def back(self) -> None:
        """Goes back to the best that was seen."""
        self.state.particle_q.assign(self._best)
