"""Extended position-based dynamics: springs and yarns as compliant constraints, solved one after the other."""

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from .. import validate
from ..forces import Forces
from ..forces.springs import LAW
from ..launching import fill, launch
from ..model import YARNS, ClothRange, Model
from ..state import Memory, State
from ..watch import Watch
from .colouring import TriangleColours
from .part import Part, Turn
from .position_step import PositionStep
from .rows import cloths_in_rows, row_solver, rows_in
from .spans import Spans
from .spring_sweeps import spring_sweeps


class Xpbd(PositionStep):
    """Implicit Euler, each step solved by sweeps over the springs (see ``kernels/xpbd.py``) and woven triangles.

    One spring is solved exactly by one sweep: it is implicit Euler to round-off, damping included. Networks converge
    to Newton's solution as ``iterations`` grows. Small steps of few sweeps give more for the same work than large steps
    of many (Macklin et al., Small Steps in Physics Simulation, 2019); too few of both act like a softer fabric. Two
    sweeps cost little more than one, as a step has more to do than to sweep. What a sweep leaves unsolved depends on
    where it begins, so the last of several goes back.

    A sweep passes load on by a spring or two. So where springs are in rows, as the threads of grids are, ``spans`` take
    it from one end of a row to the other before the first (``kernels/spans.py``), and after the last each row is solved
    as one (``kernels/rows.py``). Grids then need few substeps, and hardly more if they are finer. Meshes have no such
    rows.

    No force of a spring is expected from the step before, so that every spring solved lowers the energy of the step:
    stable at any step, damped or not. A share of them, ``warm_start``, removes a part of the strain error (a third with
    0.5); but of undamped cloth 0.5 made 20 % of strain with one sweep, where steps were as long as the springs' fastest
    period.

    Args:
        model: the model.
        iterations: sweeps over all springs per step.
        warm_start: share of the previous spring forces with which a step begins, 0 to 1.
        rows: whether springs in rows are solved as rows, too; not in differentiable models.

    Raises:
        InputError: a value out of range.
    """

    name = "xpbd"
    solved_forces = ("springs", "woven")
    order = 1
    sweep_value = 0.5
    reference = "Macklin, Müller, Chentanez, XPBD (2016), doi 10.1145/2994258.2994272"
    cost = "2 sweeps over the springs, rows of them solved as one before and after"
    use = "the fast choice for cloth: stable at any step, 5-30 substeps a frame of two sweeps each"

    def __init__(self, model: Model, *, iterations: int = 2, warm_start: float = 0.0, rows: bool = True):
        super().__init__(model, iterations, warm_start)
        self.sweeps = spring_sweeps(model)
        wanted = validate.flag(rows, "rows") and not model.differentiable
        found = [rows_in(model, sweep) if wanted else None for sweep in self.sweeps]
        of_sweep = [(sweep, own) for sweep, own in zip(self.sweeps, found, strict=True) if own is not None]
        self.spans = [Spans(model, sweep, own) for sweep, own in of_sweep]
        self.rows = [row_solver(model, sweep, own, self.warm_start > 0.0) for sweep, own in of_sweep]
        self._in_rows = cloths_in_rows(model, [own for _, own in of_sweep])
        self.triangles = TriangleColours(model)
        self._watch = Watch(model, *LAW)
        sizes = [YARNS * len(numbers) for numbers in self.triangles.numbers]
        whole: dict[str, Any] = {"dtype": model.vec3, "device": model.device, "requires_grad": model.differentiable}
        self._triangle_force = wp.zeros(sum(sizes), **whole)
        self._span_parts, self._row_parts = (
            [part for own in kind for part in own.parts] for kind in (self.spans, self.rows)
        )
        springs = self._spring_parts([own is not None for own in found])
        self._sweep_parts = [*springs, *self._triangle_parts(model, sizes)]

    def _spring_parts(self, in_rows: Sequence[bool]) -> Iterator[Part]:
        for sweep, begun in zip(self.sweeps, in_rows, strict=True):
            for k, force in enumerate(sweep.forces):
                yield Part(partial(sweep.solve, k), [force], begun=begun)

    def _triangle_parts(self, model: Model, sizes: list[int]) -> Iterator[Part]:
        ends = np.cumsum(sizes).tolist()
        for triangles, size, end in zip(self.triangles.numbers, sizes, ends, strict=True):
            force = self._triangle_force[end - size : end]
            yield Part(partial(self._solve_triangles, model, triangles, force), [force])

    def cloth_step(self, cloth: ClothRange, size: float, edge: float, load: float) -> float:
        """As elsewhere (:meth:`~warpcloth.integrators.position_step.PositionStep.advised_step`), but for cloth with
        most of its threads in rows of springs 0.16 (a/L)^(3/5) √(L/g): the same square then keeps its worst mean strain
        below 1 % with 4 substeps of 1/60 s at 64 × 64 vertices, 7 at 128 × 128 and 10 at 256 × 256. Coarser meshes
        would do with longer steps, but these slow the swing: 0.011 √(L/g) at most."""
        if cloth not in self._in_rows:
            return super().cloth_step(cloth, size, edge, load)
        return min(0.011, 0.162 * (edge / size) ** 0.6) * math.sqrt(size / load)

    def prepare(self) -> None:
        """Takes over stiffness, damping and rest lengths of the model's springs, should they have changed."""
        self._watch.if_changed(self._read_springs)

    def _read_springs(self) -> None:
        for own in (*self.sweeps, *self.spans, *self.rows):
            own.read_springs()

    def _forget_springs(self) -> None:
        super()._forget_springs()
        for sweep in self.sweeps:
            sweep.reset()
        fill(self._triangle_force)

    def memory(self) -> Sequence[Memory]:
        """The spring forces of the previous step and what they did, if any of it is expected again; those in lanes
        last, as not all models have them."""
        if self.warm_start == 0.0:
            return super().memory()
        corners = np.concatenate([np.zeros(0, int), *(np.repeat(corner, YARNS) for corner in self.triangles.corner)])
        springs = [sweep.memory() for sweep in reversed(self.sweeps)]
        return [*super().memory(), Memory(self._triangle_force, corners), *springs]

    def _solve(self, model: Model, state_in: State, forces: Forces, dt: float) -> wp.array:
        forces.evaluations += self.iterations
        for part, turn in self.pieces(state_in, dt):
            part.solve(turn, self.displacement)
        return self.displacement

    def pieces(self, start: State, dt: float) -> Iterator[tuple[Part, Turn]]:
        """All that is solved in a step of dt [s] from ``start``, in turn."""
        for iteration in range(self.iterations):
            kept = self.warm_start if iteration == 0 else 1.0
            turn = Turn(start, dt, kept, backwards=0 < iteration == self.iterations - 1)
            for part in (*(self._span_parts if iteration == 0 else ()), *self._sweep_parts):
                yield part, turn._replace(kept=1.0) if part.begun else turn
        for part in self._row_parts:
            yield part, turn

    def _solve_triangles(
        self, model: Model, triangles: wp.array, force: wp.array, turn: Turn, displacement: wp.array
    ) -> None:
        start = turn.start.particle_q
        launch(
            model.kernels.woven_xpbd.solve_triangles,
            dim=len(triangles),
            inputs=[triangles, model.woven, model.particle_inv_mass, start, turn.dt, turn.kept],
            outputs=[displacement, force],
            device=model.device,
        )
