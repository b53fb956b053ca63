"""Newton's method for one implicit stage, on the device; the kernels are in ``kernels/implicit_step.py``.

Its loops end when a counter on the device is 0, also inside captured graphs (on GPUs: CUDA 12.4 or newer).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from .. import validate
from ..forces import Forces, Linearization
from ..kinematics import drive_pins
from ..launching import fill, launch, repeat_while
from ..model import Model
from ..state import State
from .conjugate_gradient import ConjugateGradient
from .figures import Figures

OVERSHOOT = 0.5  # slope after a step, relative to the slope before it, above which the step is shortened
SHORTEST_STEP = 1e-3
LOOSEST = 0.1  # accuracy of the linear solves far from the solution
ROUNDING = 8.0  # positions that are off by so many units in the last place cannot be told from converged ones


@dataclass(frozen=True, eq=False)
class _Problem:
    """One stage: where it is solved, of which forces, γ [s], when [s after the start]."""

    state: State
    forces: Forces
    gamma: float
    time: float
    matrix: Linearization


class Newton:
    """Solves M (v − v̄) = γ f(x̄ + γ v, v) for v, in each world until the velocities change by no more than a tolerance.

    Linear systems are solved by conjugate gradients; steps are shortened where they overshoot. Compressed springs can
    make the matrix indefinite. So it is projected at first, at the price of linear convergence, and less and less near
    the solution, where without projection and with accurate linear solves convergence is faster than linear.

    Args:
        model: the model.
        tolerance: root mean square of the last velocity update [m/s], over mass or over particles, whichever is larger;
            None is 1e-10 in float64 and 1e-3 in float32. What the rounding of positions allows, about 1e-6 of the
            largest coordinate of a world per γ in float32, is its lower limit.
        max_iterations: Newton iterations after which a world gives up, which :meth:`metrics` reports.
        cg_tolerance: error of a linear solve relative to its solution, once the matrix is not projected; None is 1e-3
            in float64 and 0.1 in float32.
        cg_iterations: conjugate gradient iterations after which a linear solve ends.

    Raises:
        InputError: an option is out of range.
    """

    def __init__(
        self,
        model: Model,
        tolerance: float | None = None,
        max_iterations: int = 100,
        cg_tolerance: float | None = None,
        cg_iterations: int = 1000,
    ):
        double = model.precision == "float64"
        tolerance = (1e-10 if double else 1e-3) if tolerance is None else tolerance
        cg_tolerance = (1e-3 if double else 1e-1) if cg_tolerance is None else cg_tolerance
        self.model = model
        self.tolerance = validate.number(tolerance, "tolerance", above=0.0)
        self.max_iterations = validate.integer(max_iterations, "max_iterations", minimum=1, maximum=10_000)
        self.cg_tolerance = validate.number(cg_tolerance, "cg_tolerance", above=0.0, maximum=LOOSEST)
        cg_iterations = validate.integer(cg_iterations, "cg_iterations", minimum=1, maximum=1_000_000)
        self.cg = ConjugateGradient(model, cg_iterations)
        self.kernels = model.kernels.implicit_step
        self.worlds = _make_worlds(model, self.kernels)
        told = ("iterations", "cg_iterations", "update", "converged", "newton_total", "cg_total", "failures")
        self.figures = Figures(*(getattr(self.worlds, name) for name in told))
        self._everywhere = wp.ones(model.world_count, dtype=wp.int32, device=model.device)
        self._leads = wp.zeros(model.world_count, dtype=wp.int32, device=model.device)
        self.position_base, self.velocity_base, self._start, self._residual = (
            wp.zeros_like(model.particle_q) for _ in range(4)
        )
        self._by_mass, self._by_count = (wp.zeros_like(self.cg.partial) for _ in range(2))
        self._rounding = ROUNDING * float(np.finfo(np.float64 if double else np.float32).eps)

    def solve(
        self, stage: State, forces: Forces, gamma: float, time_offset: float, takes_part: wp.array | None = None,
        changes: Sequence[wp.array] | None = None,
    ) -> None:  # fmt: skip
        """From the guess in ``stage`` to the solution there, γ in [s]; positions of pinned particles are kept.

        x̄ and v̄ are in ``position_base`` and ``velocity_base``; moving pins go to their place at ``time_offset`` [s].
        ``takes_part`` (int32, shape [world_count]) is 1 for worlds to solve in, None: all; others stay at their guess.
        ``changes`` [m/s], two arrays, vec3, shape [particle_count], are what the solutions of the last step, and of the
        one before it, were more than the velocities in ``stage``; they are brought up to date, and with them Newton's
        method begins nearer (``kernels/implicit_guess.py``).
        """
        model, worlds = self.model, self.worlds
        fill(worlds.at_work)
        taking_part = self._everywhere if takes_part is None else takes_part
        masses, sums = [model.particle_mass, model.particle_inv_mass], [self.cg.partial, self._by_mass, self._by_count]
        self._launch("survey", self.cg.lane_count, [self.cg.lanes, *masses, stage.particle_q], sums)
        limits = [self.tolerance, self._rounding / gamma, LOOSEST]
        inputs = [self.cg.lanes, taking_part, *sums, *limits]
        self._launch("start_worlds", model.world_count, inputs, [worlds])
        if changes is not None:
            self._lead(taking_part, changes, stage)
        place = [model.particle_inv_mass, self.position_base, gamma]
        self._launch("place", model.particle_count, place, [stage.particle_q, stage.particle_qd])
        drive_pins(model, stage.world_time, time_offset, stage.particle_q, stage.particle_qd)
        matrix = Linearization(stage, gamma * gamma, gamma, worlds.project, time_offset)
        problem = _Problem(stage, forces, gamma, time_offset, matrix)
        self._evaluate(problem)
        repeat_while(worlds.at_work, lambda: self._iterate(problem))
        if changes is not None:
            inputs = [model.particle_inv_mass, model.particle_world, taking_part, stage.particle_qd]
            self._launch_guess("learn", model.particle_count, inputs, [changes[0]])

    def metrics(self) -> dict[str, Any]:
        """Of the latest step, the worst world: ``newton_iterations``, ``cg_iterations``, ``residual`` (the last update
        [m/s]), ``converged``. Since the start, of the worst world: totals, and ``unconverged_steps``."""
        worlds = self.worlds
        return {
            "newton_iterations": int(worlds.iterations.numpy().max()),
            "cg_iterations": int(worlds.cg_iterations.numpy().max()),
            "residual": float(worlds.update.numpy().max()),
            "converged": bool(worlds.converged.numpy().all()),
            "newton_iterations_total": int(worlds.newton_total.numpy().max()),
            "cg_iterations_total": int(worlds.cg_total.numpy().max()),
            "unconverged_steps": int(worlds.failures.numpy().max()),
        }

    def _iterate(self, problem: _Problem) -> None:
        model, cg, worlds = self.model, self.cg, self.worlds
        problem.forces.linearize(problem.matrix)
        cg.solve(problem.forces, problem.matrix, self._residual, worlds.active, worlds.forcing)
        inputs = [cg.lanes, model.particle_mass, problem.state.particle_qd, cg.x]
        sums = [self._by_mass, self._by_count]
        self._launch("start_search", cg.lane_count, inputs, [self._start, *sums])
        fill(worlds.at_search)
        self._launch("start_search_worlds", model.world_count, [cg.lanes, *sums, cg.solves], [worlds])
        repeat_while(worlds.at_search, lambda: self._attempt(problem))
        limits = [self.max_iterations, LOOSEST, self.cg_tolerance]
        self._launch("judge_worlds", model.world_count, [cg.solves, *limits], [worlds])

    def _attempt(self, problem: _Problem) -> None:
        """A step of the present length along the direction, its forces, and whether it is taken."""
        model, cg, worlds, state = self.model, self.cg, self.worlds, problem.state
        vectors = [self.position_base, self._start, cg.x]
        inputs = [model.particle_inv_mass, model.particle_world, worlds, *vectors, problem.gamma]
        self._launch("attempt", model.particle_count, inputs, [state.particle_q, state.particle_qd])
        self._evaluate(problem)
        inputs = [cg.lanes, cg.partial, cg.solves, OVERSHOOT, SHORTEST_STEP]
        self._launch("judge_step", model.world_count, inputs, [worlds])

    def _evaluate(self, problem: _Problem) -> None:
        """Forces, the residual, and its slope along the latest direction."""
        model, cg, state = self.model, self.cg, problem.state
        problem.forces.evaluate(state, problem.time)
        vectors = [self.velocity_base, state.particle_qd, state.particle_f, cg.x]
        inputs = [cg.lanes, model.particle_mass, model.particle_inv_mass, *vectors, problem.gamma]
        self._launch("residual", cg.lane_count, inputs, [self._residual, cg.partial])

    def _lead(self, takes_part: wp.array, changes: Sequence[wp.array], stage: State) -> None:
        """From the velocities at the start of the step to the guess, in worlds whose changes go on."""
        model, lanes, worlds, sums = self.model, self.cg.lanes, self.worlds, [self._by_mass, self._by_count]
        self._launch_guess("weigh", self.cg.lane_count, [lanes, model.particle_inv_mass, *changes], sums)
        inputs = [lanes, takes_part, worlds.tolerance, worlds.count, *sums]
        self._launch_guess("decide", model.world_count, inputs, [self._leads])
        inputs = [model.particle_inv_mass, model.particle_world, takes_part, self._leads]
        self._launch_guess("lead", model.particle_count, inputs, [*changes, stage.particle_qd])

    def _launch_guess(self, kernel: str, dim: int, inputs: list, outputs: list) -> None:
        launch(getattr(self.model.kernels.implicit_guess, kernel), dim, inputs, outputs, self.model.device)

    def _launch(self, kernel: str, dim: int, inputs: list, outputs: list) -> None:
        launch(getattr(self.kernels, kernel), dim=dim, inputs=inputs, outputs=outputs, device=self.model.device)


def _make_worlds(model: Model, kernels: Any) -> Any:
    worlds = kernels.Worlds()
    groups = [
        (wp.int32, ("active", "searching", "iterations", "cg_iterations", "converged", "failures")),
        (wp.int64, ("newton_total", "cg_total")),
        (wp.float64, ("update", "step", "tolerance", "forcing", "mass", "count")),
        (model.real, ("project",)),
    ]
    for dtype, names in groups:
        for name in names:
            setattr(worlds, name, wp.zeros(model.world_count, dtype=dtype, device=model.device))
    worlds.at_work, worlds.at_search = (wp.zeros(1, dtype=wp.int32, device=model.device) for _ in range(2))
    return worlds
