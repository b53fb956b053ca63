"""Implicit schemes that damp nothing: the midpoint and the trapezoidal rule; and what they do after a jump.

They keep the energy of the stiffest modes, too, which their steps do not resolve. That is what they are for, as long as
motion is smooth. But what contact pushes out of something within a step is stretched at once, by more than any motion
would stretch it, and then it rings for ever: sheets that fell on each other gained speed until they tore. So the step
that follows a jump is taken as two of implicit Euler, half as long each (Rannacher, Finite element solution of
diffusion problems with irregular data, Numer. Math. 43, 1984), which damps such modes, and keeps the order where jumps
are few. While something lies on something, every step is such a step; so it is while a hand holds cloth, whose pull
comes at once as well and is led by jerks.

Nor do they keep the energy of springs that turn by much within a step, or are damped faster than it resolves. Newton's
method converges there, but the forces by which the rule steps do other work than those on the way: cotton of 17²
vertices that swung by two corners, a step a frame, came to 91 m/s. So the gain of each step is measured
(``kernels/step_work.py``), and one that would bring what was gained lately over a tenth of the kinetic energy is taken
again, damped; as is one that Newton's method could not solve. Steps of half a frame gain nothing there, and of those
none is.
"""

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import warp as wp

from ..forces import Forces
from ..launching import copy, fill, launch, only_if
from ..model import Model
from ..state import Memory, State
from .implicit import ImplicitEuler, ImplicitScheme, Stage
from .oscillator import GROWTH_RATE

MEMORY = 1.0  # [s] after which gains, and the energy that they are measured by, count for 1/e
MOST_GAINED = GROWTH_RATE * MEMORY  # share of the energy; what explicit schemes put up with, too


class UndampedScheme(ImplicitScheme):
    """A scheme of one stage, with a damped step in each world that a hand holds, or whose state was changed since its
    last step, or that would gain energy by too large a step.

    Attributes:
        gain_share: what the rule gains, as a share of the work of forces in the middle of its steps over that of their
            mean at the ends: by Simpson's rule 1/3 where it takes the former, −2/3 where it takes the latter.

    Not in differentiable models, whose adjoints know smooth steps only.
    """

    gain_share: ClassVar[float]
    solves = 3

    def _allocate(self, model: Model) -> None:
        self._middle, self._damped, self._end = (State.of(model) for _ in range(3))
        counts = (*[model.world_count] * 3, 1)
        self._jumped, self._smooth, self._damps, self._any = (
            wp.zeros(n, dtype=wp.int32, device=model.device) for n in counts
        )
        self._past_dt = wp.zeros(model.world_count, dtype=wp.float64, device=model.device)
        self._gains = model.kernels.step_work.Gains()
        for name in ("gained", "energy"):
            setattr(self._gains, name, wp.zeros(model.world_count, dtype=wp.float64, device=model.device))
        self._energy = wp.zeros_like(self.newton.cg.partial)

    def step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """One step; see :class:`~warpcloth.integrators.base.Integrator`."""
        if model.differentiable:
            super().step(model, state_in, state_out, forces, dt)
            return
        self._look(model, state_in, forces)
        self._smooth_step(model, state_in, state_out, forces, dt, self._smooth)
        self._judge(model, state_in, state_out, forces, dt)
        evaluated = forces.latest
        only_if(self._any, lambda: self._damped_step(model, state_in, state_out, forces, dt))
        forces.latest = evaluated  # always there, as the damped step is not
        end = self._end
        inputs = [model.particle_world, state_out.particle_q, state_out.particle_qd, dt]
        self._launch(model, "keep_end", inputs, [end.particle_q, end.particle_qd, self._past_dt])

    def reset(self) -> None:
        """Forgets the last step: the next one takes the state as it is."""
        for array in (self._past_dt, self._gains.gained, self._gains.energy):
            fill(array)

    def memory(self) -> Sequence[Memory]:
        """The end of the last step, its length, and what was gained."""
        if self.newton.model.differentiable:
            return super().memory()
        own = np.arange(len(self._end.particle_q))
        ends = [Memory(array, own) for array in (self._end.particle_q, self._end.particle_qd)]
        worlds = self._past_dt, self._gains.gained, self._gains.energy
        return [*super().memory(), *ends, *(Memory(array, None) for array in worlds)]

    def _look(self, model: Model, state_in: State, forces: Forces) -> None:
        """Which worlds are in somebody's hand, or not where their last step ended."""
        end = self._end
        forces.mark_jerked(self._jumped)
        fill(self._any)
        inputs = [state_in.particle_q, state_in.particle_qd, end.particle_q, end.particle_qd, self._past_dt]
        self._launch(model, "find_jumps", [model.particle_world, *inputs], [self._jumped])
        kernel = model.kernels.implicit_schemes.part_worlds
        launch(kernel, model.world_count, [self._jumped], [self._smooth, self._any], device=model.device)

    def _judge(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """Which worlds are to be damped: those that jumped, and those whose smooth step gained too much, or failed."""
        kernels, cg, middle = model.kernels.step_work, self.newton.cg, self._middle
        ends = [state_in.particle_q, state_in.particle_qd, state_out.particle_q, state_out.particle_qd]
        if self.stage.beyond == 0.0:  # the rule has evaluated the forces at both ends
            launch(
                kernels.find_middle, model.particle_count, ends, [middle.particle_q, middle.particle_qd], model.device
            )
            forces.evaluate(
                State(middle.particle_q, middle.particle_qd, middle.particle_f, state_in.world_time), 0.5 * dt
            )
            found = state_in.particle_f, middle.particle_f, state_out.particle_f
        else:
            forces.evaluate(state_in)
            end_q, end_qd = ends[2:]
            forces.evaluate(State(end_q, end_qd, middle.particle_f, state_in.world_time), dt)
            found = state_in.particle_f, state_out.particle_f, middle.particle_f
        forces.latest = state_out.particle_f
        masses = [cg.lanes, model.particle_mass, model.particle_inv_mass]
        launch(
            kernels.measure,
            dim=cg.lane_count,
            inputs=[*masses, state_in.particle_q, state_out.particle_q, state_out.particle_qd, *found],
            outputs=[cg.partial, self._energy],
            device=model.device,
        )
        limits = [self.gain_share, MOST_GAINED, math.exp(-dt / MEMORY)]
        worlds = self.newton.worlds
        inputs = [cg.lanes, cg.partial, self._energy, self._jumped, worlds.converged, *limits]
        outputs = [self._gains, worlds.failures, self._damps, self._any]
        launch(kernels.judge, model.world_count, inputs, outputs, model.device)

    def _damped_step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """Two half steps of implicit Euler, in worlds to be damped."""
        half, middle, damped = 0.5 * dt, self._middle, self._damped
        for state in (middle, damped):
            copy(state.world_time, state_in.world_time)
        self._start(model, state_in, middle, state_in, half, ImplicitEuler.stage)
        self.newton.solve(middle, forces, half, half, self._damps, self.changes[1])
        self._start(model, middle, damped, middle, half, ImplicitEuler.stage)
        self.newton.solve(damped, forces, half, dt, self._damps, self.changes[2])
        inputs = [model.particle_world, self._damps, damped.particle_q, damped.particle_qd]
        self._launch(model, "take_jumped", inputs, [state_out.particle_q, state_out.particle_qd])

    def _launch(self, model: Model, kernel: str, inputs: list, outputs: list) -> None:
        function = getattr(model.kernels.implicit_schemes, kernel)
        launch(function, dim=model.particle_count, inputs=inputs, outputs=outputs, device=model.device)


class ImplicitMidpoint(UndampedScheme):
    """Implicit Euler to the middle of the step, and on by as much again."""

    name = "implicit_midpoint"
    order = 2
    symplectic = True
    conserves_angular_momentum = True
    stage = Stage(gamma=0.5, time=0.5, beyond=1.0)
    gain_share = 1.0 / 3.0
    reference = "Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), II.1.2"
    cost = "a few Newton iterations, each of tens to hundreds of matrix products"
    use = "motion without numerical damping: momenta kept; damped where contact, hands, hooks or long steps add energy"


class ImplicitTrapezoid(UndampedScheme):
    """Mean of the accelerations, and of the velocities, at both ends; Newmark's scheme with β = 1/4, γ = 1/2."""

    name = "implicit_trapezoid"
    order = 2
    stage = Stage(gamma=0.5, at_start=0.5)
    gain_share = -2.0 / 3.0
    reference = "Newmark, A Method of Computation for Structural Dynamics, J. Eng. Mech. Div. ASCE 85 (1959)"
    cost = "a few Newton iterations, each of tens to hundreds of matrix products"
    use = "structural dynamics' standard; like the midpoint rule, and forces balance exactly at the ends of steps"
