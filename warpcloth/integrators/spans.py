"""Springs in a row, solved as one before the sweeps of XPBD; see ``kernels/spans.py``."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import pairwise

import numpy as np
import warp as wp

from ..launching import fill, launch
from ..model import Model
from .colouring import grouped, spring_colours
from .part import Part, Turn
from .rows import Rows
from .spring_sweeps import ListSweep, TileSweep

UNIT = 12  # springs, of the shortest spans


def unit_starts(first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where units begin in rows that begin at ``first``, and of which row each is; the last of both are the end's."""
    counts = np.maximum(1, np.rint(np.diff(first) / UNIT).astype(int))
    row = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    start = first[row] + np.diff(first)[row] * place // counts[row]
    return np.append(start, first[-1]), row


def span_levels(row: np.ndarray) -> list[np.ndarray]:
    """First and last unit (not included) of the spans of each level, shape [s, 2], the longest first.

    Those of level k have 2ᵏ units, the last of a row what is left, unless it is a span of a finer level, too.

    Args:
        row: of each unit, in rising order.
    """
    begin = np.searchsorted(row, row)
    place, count = np.arange(len(row)) - begin, np.bincount(row, minlength=1)[row]
    found = []
    size = 1
    while size == 1 or (size < 2 * count).any():
        first = np.flatnonzero((place % size == 0) & ((count - place > size // 2) | (size == 1)) & (size < 2 * count))
        found.append(np.column_stack([first, np.minimum(first + size, begin[first] + count[first])]))
        size *= 2
    return found[::-1]


def in_groups(spans: np.ndarray, lanes: int) -> tuple[np.ndarray, np.ndarray]:
    """Spans, shape [s, 2], as ``kernels/span_lanes.py`` takes them: in another order, and groups, shape [g, 4]."""
    length = spans[:, 1] - spans[:, 0]
    order = np.argsort(length, kind="stable")
    bounds = np.flatnonzero(np.diff(length[order], prepend=0, append=0))
    first = np.concatenate([np.arange(a, b, lanes) for a, b in pairwise(bounds.tolist())])
    count = np.minimum(first + lanes, bounds[np.searchsorted(bounds, first, "right")]) - first
    units = length[order][first]
    place = 3 * lanes * (np.cumsum(units) - units)
    return spans[order], np.column_stack([first, count, units, place])


class Spans:
    """The spans of the springs of one sweep.

    Args:
        model: the model. sweep: over some of its springs. rows: of structural springs among them, at least one.

    Attributes:
        parts: what to do before the sweep, whose forces are all there afterwards.
    """

    def __init__(self, model: Model, sweep: TileSweep | ListSweep, rows: Rows):
        self._model, self._sweep, slot = model, sweep, rows.slot
        start, row = unit_starts(rows.first)
        self._unit_start = model.array(start, wp.int32)
        self._row_spring, self._row_slot = (
            model.array(values, wp.int32) for values in (rows.spring, slot[rows.spring])
        )
        self._law, self._stretch, self._force = (
            wp.zeros(len(row), dtype=model.vec3, device=model.device) for _ in range(3)
        )
        self._compliance = wp.zeros(len(rows.spring), dtype=model.real, device=model.device)
        self.read_springs()
        ends = model.spring_indices.numpy()
        unit_ends = np.column_stack([ends[rows.spring[start[:-1]], 0], ends[rows.spring[start[1:] - 1], 1]])
        self._unit_ends = model.array(unit_ends, wp.vec2i)
        slot_unit = np.full(len(sweep.flat_force) // 3, -1)
        wide, lane = np.divmod(slot[rows.spring], 3 * sweep.stride)
        slot_unit[sweep.stride * wide + lane] = np.repeat(np.arange(len(row)), np.diff(start))
        self._slot_unit = model.array(slot_unit, wp.int32)
        spans = []
        for units in span_levels(row):
            reached = [[*unit_ends[a:b, 0], unit_ends[b - 1, 1]] for a, b in units.tolist()]
            order, bounds = grouped(spring_colours(reached, model.particle_count))
            spans += [units[order[a:b]] for a, b in pairwise(bounds.tolist())]
        solve = self._in_lanes(spans) if model.device.is_cpu else self._one_by_one(spans)
        self.parts = [Part(self._begin, []), *(Part(part, []) for part in solve), Part(self._end, [sweep.flat_force])]

    def _one_by_one(self, spans: Sequence[np.ndarray]) -> Iterator[Callable[[Turn, wp.array], None]]:
        """What solves the spans of each launch, a thread for each span."""
        self._direction = wp.zeros_like(self._force)
        for own in spans:
            inputs = [self._model.array(own, wp.vec2i)]
            yield partial(self._solve, "spans", "solve_spans", len(own), inputs, self._direction)

    def _in_lanes(self, spans: Sequence[np.ndarray]) -> Iterator[Callable[[Turn, wp.array], None]]:
        """The same, a thread for each group."""
        model, lanes = self._model, self._model.kernels.lanes.LANES
        launches = [in_groups(own, lanes) for own in spans]
        room = max(3 * lanes * int(groups[:, 2].sum()) for _, groups in launches)
        memory = wp.zeros(room, dtype=model.real, device=model.device)
        for own, groups in launches:
            inputs = [model.array(groups.ravel(), wp.int32), model.array(own, wp.vec2i)]
            yield partial(self._solve, "span_lanes", "solve_groups", len(groups), inputs, memory)

    def read_springs(self) -> None:
        """Takes over stiffness, damping and rest lengths of the model's springs, should they have changed."""
        model = self._model
        launch(
            model.kernels.spans.arrange_units,
            dim=len(self._law),
            inputs=[
                self._unit_start, self._row_spring, model.spring_rest_length, model.spring_stiffness,
                model.spring_damping,
            ],
            outputs=[self._law, self._compliance],
            device=model.device,
        )  # fmt: skip

    def _begin(self, turn: Turn, displacement: wp.array) -> None:
        if turn.kept == 0.0:  # of what there was before nothing counts
            fill(self._stretch)
            fill(self._force)
            return
        launch(
            self._model.kernels.spans.begin_units,
            dim=len(self._law),
            inputs=[
                self._unit_start, self._row_slot, self._compliance, self._sweep.stride, self._sweep.flat_force,
                turn.kept,
            ],
            outputs=[self._stretch, self._force],
            device=self._model.device,
        )  # fmt: skip

    def _solve(
        self, module: str, kernel: str, dim: int, spans: list[wp.array], memory: wp.array, turn: Turn,
        displacement: wp.array,
    ) -> None:  # fmt: skip
        model = self._model
        launch(
            getattr(getattr(model.kernels, module), kernel),
            dim=dim,
            inputs=[
                *spans, self._unit_ends, self._law, model.particle_inv_mass, turn.start.particle_q, self._stretch,
                turn.dt,
            ],
            outputs=[memory, displacement, self._force],
            device=model.device,
        )  # fmt: skip

    def _end(self, turn: Turn, displacement: wp.array) -> None:
        model, count, stride = self._model, len(self._slot_unit), self._sweep.stride
        kernel, dim, shape = model.kernels.spans.spread_units, count, [stride]
        if stride == model.kernels.lanes.LANES:
            kernel, dim, shape = model.kernels.span_lanes.spread_entries, count // stride, []
        launch(
            kernel,
            dim=dim,
            inputs=[self._slot_unit, *shape, self._force, turn.kept],
            outputs=[self._sweep.flat_force],
            device=model.device,
        )
