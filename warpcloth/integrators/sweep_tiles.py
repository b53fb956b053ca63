"""The springs of grids, arranged for the CPU to solve eight at once; see ``kernels/xpbd_tiles.py``."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import warp as wp

from ..forces import lanes as lanes_module
from ..forces.lanes import LaneLaws, Lanes, copies, shares
from ..launching import fill, launch
from ..model import Model
from ..program import cores
from ..state import Memory
from .part import Turn

BLOCK_TO_REACH = 2  # particles; at least 1, so that every other block can be solved at the same time
PHASES = 2


def goes_on(ends: np.ndarray) -> bool:
    """Whether a list of springs, shape [s, 2], never stays at a particle, as that of a grid, which goes along threads.

    Sweeps in the order of a list that has all springs of a particle together overshoot, and blow up.
    """
    first, second, third = ends[:-2], ends[1:-1], ends[2:]

    def has(springs: np.ndarray, particle: np.ndarray) -> np.ndarray:
        return (springs == particle[:, None]).any(axis=1)

    return not any((has(second, first[:, k]) & has(third, first[:, k])).any() for k in (0, 1))


def arranged(listed: np.ndarray, count: int, lanes: int) -> Lanes | None:
    """Springs of one world in lanes, such that no two of an entry share a particle; None if the list does not go on.

    Entries come in the order of the list, by the first spring that they have. Blocks are told by the first and last
    particle of what they reach, shape [b, 2]. Arguments as for :func:`~warpcloth.forces.lanes.in_lanes`.
    """
    if not goes_on(listed):
        return None
    ends = np.sort(listed, axis=1)
    near, far = ends.T
    reach = int((far - near).max())
    size = max(lanes_module.SMALLEST_BLOCK, -(-BLOCK_TO_REACH * reach // lanes) * lanes)
    begins = np.arange(0, count, size)
    block = np.stack([begins, np.minimum(begins + size + reach, count)], axis=1)
    lane = near % lanes
    apart = lane // np.maximum(far - near, 1) % 2  # springs that end where those of other lanes begin
    key = np.stack([near // size, near - lane, far - near, apart, copies(ends)], axis=1)
    entry, of_spring = np.unique(key, axis=0, return_inverse=True)
    of_spring = of_spring.reshape(-1)
    lane_spring = np.full((len(entry), lanes), -1)
    lane_spring[of_spring, lane] = np.arange(len(ends))
    earliest = np.full(len(entry), len(ends))
    np.minimum.at(earliest, of_spring, np.arange(len(ends)))
    order = np.lexsort((earliest, entry[:, 0]))
    entry, lane_spring = entry[order, :3], lane_spring[order]
    order = np.lexsort((levels(ends, lane_spring), entry[:, 0]))
    return Lanes(block, np.arange(len(block)) % PHASES, entry[order], lane_spring[order])


def levels(ends: np.ndarray, lane_spring: np.ndarray) -> np.ndarray:
    """Levels of entries such that solving them level by level is the same as one after the other.

    Entries of one level share no particle, so a processor has several of them at work: along the threads of a grid each
    would wait for the one before, and the hang at 128² took 1.5 times as long.
    """
    next_level: dict[int, int] = {}
    found = np.empty(len(lane_spring), np.int64)
    for e, row in enumerate(lane_spring):
        particles = ends[row[row >= 0]].ravel().tolist()
        level = max(next_level.get(i, 0) for i in particles)
        next_level.update(dict.fromkeys(particles, level + 1))
        found[e] = level
    return found


@dataclass
class Phase:
    """Blocks that are solved at the same time, as the kernel takes them."""

    slot_start: wp.array
    block: wp.array
    entry: wp.array
    law: list[wp.array]
    force: wp.array


class TileSweep:
    """A sweep of XPBD over springs in lanes; its parts are phases.

    Args:
        model: the model. lanes: its springs in the order of :func:`arranged`, at least one.

    Attributes:
        forces: of the springs in the step before [N], as lanes, an array for each part. flat_force: all of them, real;
            components are ``stride`` apart.
    """

    def __init__(self, model: Model, lanes: Lanes):
        self._model, self._kernels = model, model.kernels.xpbd_tiles
        phase = lanes.phase[lanes.entry[:, 0]]
        order = np.argsort(phase, kind="stable")
        entry, lane_spring = lanes.entry[order], lanes.lane_spring[order]
        self._laws = LaneLaws(model, lane_spring)
        self._particle = entry[:, 1].astype(np.int32)
        self.flat_force = wp.zeros(3 * lane_spring.size, dtype=model.real, device=model.device)
        self.stride = lane_spring.shape[1]
        bounds = np.searchsorted(phase[order], np.arange(PHASES + 1)).tolist()
        wide = 3 * lane_spring.shape[1]
        self._phases = [
            self._phase(lanes.block, entry[a:b], self._laws.of_entries(a, b), self.flat_force[wide * a : wide * b])
            for a, b in pairwise(bounds)
            if a < b
        ]
        self.forces = [part.force for part in self._phases]
        room = int((lanes.block[:, 1] - lanes.block[:, 0]).max()) + 2 * lane_spring.shape[1]
        slots = max(len(part.slot_start) - 1 for part in self._phases)
        self._memory = wp.zeros((slots, self._kernels.ROWS * room), dtype=model.real, device=model.device)

    def _phase(self, block: np.ndarray, entry: np.ndarray, law: list[wp.array], force: wp.array) -> Phase:
        model = self._model
        own, begins = np.unique(entry[:, 0], return_index=True)
        rows = np.column_stack([begins, np.append(begins[1:], len(entry)), block[own]])
        starts = shares(len(own), cores())
        steps = np.column_stack([entry[:, 1], entry[:, 2]])
        return Phase(
            model.array(starts, wp.int32), model.array(rows, wp.int32), model.array(steps, wp.vec2i), law, force
        )  # fmt: skip

    def read_springs(self) -> None:
        """Takes over stiffness, damping and rest lengths of the model's springs, should they have changed."""
        self._laws.arrange()

    def reset(self) -> None:
        """Forgets the forces of the step before."""
        fill(self.flat_force)

    def memory(self) -> Memory:
        """The forces of the step before, a row for each entry."""
        row = wp.types.vector(3 * self._model.kernels.lanes.LANES, self._model.real)
        rows = wp.array(ptr=self.flat_force.ptr, dtype=row, shape=len(self._particle), device=self._model.device)
        return Memory(rows, self._particle)

    def slots(self) -> tuple[np.ndarray, np.ndarray]:
        """The numbers of the springs, and where in ``flat_force`` the force of each begins."""
        springs = self._laws.lane_spring.numpy().reshape(-1, self.stride)
        entry, lane = np.nonzero(springs >= 0)
        return springs[entry, lane], 3 * self.stride * entry + lane

    def solve(self, part: int, turn: Turn, displacement: wp.array) -> None:
        """Solves the springs of one part; changes their forces and ``displacement`` [m] in place."""
        model, own = self._model, self._phases[part]
        launch(
            self._kernels.solve_tiles,
            dim=len(own.slot_start) - 1,
            inputs=[
                own.slot_start, own.block, own.entry, *own.law, model.particle_inv_mass, turn.start.particle_q,
                turn.dt, turn.kept, int(turn.backwards),
            ],
            outputs=[self._memory, displacement, own.force],
            device=model.device,
        )  # fmt: skip
