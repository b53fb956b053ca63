"""Implicit schemes of one stage, and the one that damps most, implicit Euler; ``undamped.py`` has those that do not.

Each step solves M (v − v̄) = γ f(x̄ + γ v, v) once; the schemes differ in a handful of numbers.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
import warp as wp

from ..forces import Forces
from ..kinematics import drive_pins
from ..launching import launch
from ..model import Model
from ..state import Memory, State
from .base import Integrator
from .newton import Newton


@dataclass(frozen=True)
class Stage:
    """The stage of a scheme; everything in units of the step.

    Attributes:
        gamma: γ, weight of the forces and velocities at the stage.
        time: when the stage is, which is where moving pins and forces are evaluated.
        at_start: weight of the forces and velocities at the start of the step.
        past: weight of the change over the step before.
        beyond: how far the end of the step lies beyond the stage, in ways from the start to the stage.
    """

    gamma: float
    time: float = 1.0
    at_start: float = 0.0
    past: float = 0.0
    beyond: float = 0.0


class ImplicitScheme(Integrator):
    """Solves one :class:`Stage` a step by Newton's method; damping is implicit like everything else.

    Args:
        model: the model.
        tolerance, max_iterations, cg_tolerance, cg_iterations: see :class:`~warpcloth.integrators.newton.Newton`.

    Raises:
        InputError: an option is out of range.

    Attributes:
        changes: of each solve in a step, by how much it changed velocities in the last two [m/s]; see ``Newton.solve``.
    """

    implicit = True
    linearizes = True
    symplectic = False
    capturable = True
    steps_per_travel = 1.0
    convergence_options: ClassVar[dict[str, Any]] = {"tolerance": 1e-12}
    stage: ClassVar[Stage]
    solves: ClassVar[int] = 1  # in a step, at most, each with a guess of its own

    def __init__(
        self,
        model: Model,
        *,
        tolerance: float | None = None,
        max_iterations: int = 100,
        cg_tolerance: float | None = None,
        cg_iterations: int = 1000,
    ):
        self.newton = Newton(model, tolerance, max_iterations, cg_tolerance, cg_iterations)
        nothing = partial(wp.zeros_like, model.particle_q, requires_grad=False)
        self.changes = [(nothing(), nothing()) for _ in range(self.solves)]
        self._allocate(model)

    def step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """One step; see :class:`~warpcloth.integrators.base.Integrator`."""
        self._smooth_step(model, state_in, state_out, forces, dt)

    def _smooth_step(
        self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float,
        takes_part: wp.array | None = None,
    ) -> None:  # fmt: skip
        """The stage, in worlds that take part (see ``Newton.solve``), and from there to the end of the step."""
        if self.stage.at_start != 0.0:
            forces.evaluate(state_in)
        self._start(model, state_in, state_out, state_in, dt)
        self.newton.solve(state_out, forces, self.stage.gamma * dt, self.stage.time * dt, takes_part, self.changes[0])
        if self.stage.beyond != 0.0:
            self.finish(model, state_in, state_out, dt)

    def memory(self) -> Sequence[Memory]:
        """The changes of the last two steps."""
        return [Memory(change, np.arange(len(change))) for pair in self.changes for change in pair]

    def remember(self) -> None:
        """Keeps the figures of Newton's method."""
        self.newton.figures.remember()

    def recall(self) -> None:
        """Back to what :meth:`remember` kept."""
        self.newton.figures.recall()

    def metrics(self) -> dict[str, Any]:
        """See :meth:`~warpcloth.integrators.newton.Newton.metrics`."""
        return self.newton.metrics()

    def _allocate(self, model: Model) -> None:
        """What a scheme keeps besides, for those that keep anything."""
        return None

    @classmethod
    def stable_step(cls, omega: float, gamma: float) -> float:
        """Stable at any step."""
        return math.inf

    def _start(
        self, model: Model, state_in: State, state_out: State, past: State, dt: float, stage: Stage | None = None
    ) -> None:  # fmt: skip
        newton = self.newton
        base = State(newton.position_base, newton.velocity_base, state_in.particle_f, state_in.world_time)
        self.launch_base(model, state_in, past, base, state_out, dt, stage)

    def launch_base(
        self, model: Model, state_in: State, past: State, base: State, state_out: State, dt: float,
        stage: Stage | None = None,
    ) -> None:  # fmt: skip
        """x̄ and v̄ of a stage, None: the scheme's, into ``base`` and the guess, ``state_in``, into ``state_out``."""
        stage = stage or self.stage
        launch(
            model.kernels.implicit_schemes.stage_base,
            dim=model.particle_count,
            inputs=[
                model.particle_inv_mass, state_in.particle_q, state_in.particle_qd, state_in.particle_f,
                past.particle_q, past.particle_qd, dt, stage.at_start, stage.past,
            ],
            outputs=[base.particle_q, base.particle_qd, state_out.particle_q, state_out.particle_qd],
            device=model.device,
        )  # fmt: skip

    def finish(self, model: Model, state_in: State, state_out: State, dt: float) -> None:
        """From the stage to the end of the step, in place."""
        launch(
            model.kernels.implicit_schemes.extrapolate,
            dim=model.particle_count,
            inputs=[state_in.particle_q, state_in.particle_qd, self.stage.beyond],
            outputs=[state_out.particle_q, state_out.particle_qd],
            device=model.device,
        )
        drive_pins(model, state_in.world_time, dt, state_out.particle_q, state_out.particle_qd)


class ImplicitEuler(ImplicitScheme):
    """v ← v + dt a(x′, v′), x ← x + dt v′, with x′ and v′ at the end of the step."""

    name = "implicit_euler"
    order = 1
    contact_share = 1.0
    stage = Stage(gamma=1.0)
    reference = "Hairer, Wanner, Solving Ordinary Differential Equations II (1996), IV.3"
    cost = "a few Newton iterations, each of tens to hundreds of matrix products"
    use = "stiff cloth at frame-sized steps; damps motion, the more the larger the step, so drapes settle fast"
