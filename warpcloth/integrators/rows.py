"""Springs in rows, and what solves them as one at the end of a step of XPBD; see ``kernels/rows.py``."""

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import warp as wp

from ..cloth.springs import STRUCTURAL
from ..forces.lanes import LaneLaws, shares
from ..launching import launch
from ..model import ClothRange, Model
from ..program import cores
from .colouring import grouped, spring_colours
from .part import Part, Turn
from .position_step import cloth_numbers
from .spring_sweeps import ListSweep, TileSweep

SHORTEST_ROW = 4  # springs; fewer than that a sweep does as well


class Rows(NamedTuple):
    """Springs one after the other, row after row.

    Attributes:
        spring: their numbers, int, shape [m]. first: where in it each row begins, and where the last ends, int.
        slot: of every spring of the model, where in the forces of the sweep that has it its own begins, int.
    """

    spring: np.ndarray
    first: np.ndarray
    slot: np.ndarray


def spring_rows(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of springs, each of which begins where the one before ends and leads as much further.

    The threads of a grid are such rows. By the triangle inequality no row can be shorter than the distance of its ends,
    so it does not matter that springs of irregular meshes, numbered by chance, may form some that bend.

    Args:
        ends: particles of each spring, the lower one first, int, shape [s, 2], s > 0.

    Returns:
        Numbers of springs, row after row, and where each row begins, and the last ends; int.
    """
    step = ends[:, 1] - ends[:, 0]
    begins, wanted = (ends[:, k] * (1 + int(step.max())) + step for k in (0, 1))
    order = np.argsort(begins, kind="stable")
    found = order[np.minimum(np.searchsorted(begins[order], wanted), len(ends) - 1)]
    lead_on = np.flatnonzero(begins[found] == wanted)
    _, once = np.unique(found[lead_on], return_index=True)  # the first of several springs that lead to the same one
    after = np.full(len(ends), -1)
    after[lead_on[once]] = found[lead_on[once]]
    columns = [np.setdiff1d(np.arange(len(ends)), after)]
    while (columns[-1] >= 0).any():
        columns.append(np.where(columns[-1] >= 0, after[columns[-1]], -1))
    table = np.stack(columns, axis=1)
    table = table[(table >= 0).sum(axis=1) >= SHORTEST_ROW]
    return table[table >= 0], np.concatenate([[0], np.cumsum((table >= 0).sum(axis=1))])


def rows_in(model: Model, sweep: TileSweep | ListSweep) -> Rows | None:
    """The rows of the structural springs of a sweep; None if there are none."""
    spring, slot = sweep.slots()
    ends, kind = model.spring_indices.numpy().reshape(-1, 2), model.spring_kind.numpy()
    chosen = np.sort(spring[(kind[spring] == STRUCTURAL) & (ends[spring, 0] < ends[spring, 1])])
    if len(chosen) == 0:
        return None
    found, first = spring_rows(ends[chosen])
    if len(found) == 0:
        return None
    of_spring = np.zeros(len(ends), np.int64)
    of_spring[spring] = slot
    return Rows(chosen[found], first, of_spring)


def in_launches(rows: Rows, ends: np.ndarray, particles: int) -> list[list[np.ndarray]]:
    """The springs of each row, launch by launch: rows of one launch share no particle."""
    springs = [rows.spring[a:b] for a, b in pairwise(rows.first.tolist())]
    reached = [np.append(ends[own, 0], ends[own[-1], 1]).tolist() for own in springs]
    order, bounds = grouped(spring_colours(reached, particles))
    return [[springs[r] for r in order[a:b].tolist()] for a, b in pairwise(bounds.tolist())]


def in_groups(rows: Sequence[np.ndarray], ends: np.ndarray, lanes: int) -> list[np.ndarray]:
    """Rows as groups, shape [springs, lanes], of up to ``lanes`` that are as long and lead as much further, by their
    first particles; what lanes are left repeat the first row.

    Args:
        rows: the springs of each. ends: particles of each spring.
    """
    alike: dict[tuple[int, int], list[np.ndarray]] = {}
    for row in sorted(rows, key=lambda row: int(ends[row[0], 0])):
        p, q = ends[row[0]].tolist()
        alike.setdefault((len(row), q - p), []).append(row)
    groups = []
    for own in alike.values():
        for first in range(0, len(own), lanes):
            group = own[first : first + lanes]
            groups.append(np.stack(group + group[:1] * (lanes - len(group)), axis=1))
    return groups


class ListRows:
    """Rows one by one, a thread each: for GPUs.

    Args:
        model: the model. sweep: over their springs. rows: at least one. keeps: whether forces are kept for later.

    Attributes:
        parts: what to do after the last sweep.
    """

    def __init__(self, model: Model, sweep: TileSweep | ListSweep, rows: Rows, keeps: bool):
        self._model, self._sweep, self._keeps = model, sweep, int(keeps)
        ends = model.spring_indices.numpy().reshape(-1, 2)
        launches = in_launches(rows, ends, model.particle_count)
        every = [row for own in launches for row in own]
        springs = np.concatenate(every)
        self._springs = model.array(springs, wp.int32)
        nodes = np.concatenate([np.append(ends[row, 0], ends[row[-1], 1]) for row in every])
        self._law, along = (wp.zeros(len(springs), dtype=model.vec3, device=model.device) for _ in range(2))
        self._tables = [
            model.array(np.cumsum([0, *map(len, every)]), wp.int32),
            model.array(nodes, wp.int32),
            model.array(rows.slot[springs], wp.int32),
            sweep.stride,
            self._law,
        ]
        self._memory = model.kernels.rows.RowMemory()
        self._memory.direction = along
        self._memory.upper, self._memory.impulse = (
            wp.zeros(len(springs), dtype=model.real, device=model.device) for _ in range(2)
        )
        begins = np.cumsum([0, *map(len, launches)]).tolist()
        self.parts = [Part(partial(self._solve, a, b - a), [sweep.flat_force]) for a, b in pairwise(begins)]
        self.read_springs()

    def read_springs(self) -> None:
        """Takes over stiffness, damping and rest lengths of the model's springs, should they have changed."""
        model = self._model
        inputs = [self._springs, model.spring_rest_length, model.spring_stiffness, model.spring_damping]
        launch(model.kernels.springs.arrange_law, len(self._springs), inputs, [self._law], model.device)

    def _solve(self, first: int, count: int, turn: Turn, displacement: wp.array) -> None:
        model = self._model
        launch(
            model.kernels.rows.solve_rows,
            dim=count,
            inputs=[first, *self._tables, model.particle_inv_mass, turn.start.particle_q, turn.dt, self._keeps],
            outputs=[self._memory, displacement, self._sweep.flat_force],
            device=model.device,
        )


class LaneRows:
    """Rows eight at once, for the CPU: see ``kernels/row_lanes.py``; arguments and attributes as of
    :class:`ListRows`."""

    def __init__(self, model: Model, sweep: TileSweep | ListSweep, rows: Rows, keeps: bool):
        self._model, self._sweep, self._kernels, self._keeps = model, sweep, model.kernels.row_lanes, int(keeps)
        lanes, ends = self._kernels.LANES, model.spring_indices.numpy().reshape(-1, 2)
        launches = [in_groups(own, ends, lanes) for own in in_launches(rows, ends, model.particle_count)]
        self._laws = LaneLaws(model, np.concatenate([group for own in launches for group in own]))
        longest = max(len(group) for own in launches for group in own)
        slots, room = min(cores(), max(map(len, launches))), self._kernels.ROWS * lanes * (longest + 1)
        self._memory = wp.zeros((slots, room), dtype=model.real, device=model.device)
        begin, self.parts = 0, []
        for own in launches:
            end = begin + sum(map(len, own))
            tables = [*self._tables(own, ends, rows.slot), sweep.stride, *self._laws.of_entries(begin, end)]
            self.parts.append(Part(partial(self._solve, tables), [sweep.flat_force]))
            begin = end

    def _tables(self, groups: list[np.ndarray], ends: np.ndarray, slot: np.ndarray) -> list[wp.array]:
        particle = [np.concatenate([ends[group, 0], ends[group[-1:], 1]]) for group in groups]
        tables = [
            np.array(shares(len(groups), cores())),
            np.cumsum([0, *map(len, groups)]),
            np.array([len(np.unique(group[0])) for group in groups]),
            np.concatenate(particle).ravel(),
            slot[np.concatenate(groups).ravel()],
        ]
        return [self._model.array(table, wp.int32) for table in tables]

    def read_springs(self) -> None:
        """Takes over stiffness, damping and rest lengths of the model's springs, should they have changed."""
        self._laws.arrange()

    def _solve(self, tables: list, turn: Turn, displacement: wp.array) -> None:
        model = self._model
        launch(
            self._kernels.solve_row_groups,
            dim=len(tables[0]) - 1,
            inputs=[*tables, model.particle_inv_mass, turn.start.particle_q, turn.dt, self._keeps],
            outputs=[self._memory, displacement, self._sweep.flat_force],
            device=model.device,
        )


def row_solver(model: Model, sweep: TileSweep | ListSweep, rows: Rows, keeps: bool) -> ListRows | LaneRows:
    """What solves rows at the end of a step; arguments as of :class:`ListRows`."""
    return (LaneRows if model.device.is_cpu else ListRows)(model, sweep, rows, keeps)


def cloths_in_rows(model: Model, rows: Sequence[Rows]) -> set[ClothRange]:
    """The cloths of which at least half of the structural springs are in rows."""
    count = len(model.cloths)
    first = model.spring_indices.numpy().reshape(-1, 2)[:, 0]
    number = cloth_numbers(model, first)
    structural = np.bincount(number[model.spring_kind.numpy() == STRUCTURAL], minlength=count)
    in_rows = sum((np.bincount(number[own.spring], minlength=count) for own in rows), np.zeros(count, int))
    return {
        cloth for cloth, most in zip(model.cloths, (in_rows > 0) & (2 * in_rows >= structural), strict=True) if most
    }
