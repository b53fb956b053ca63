"""Adaptive Runge–Kutta methods: embedded pairs under error control."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from .. import validate
from ..errors import StepSizeError
from ..forces import Forces
from ..launching import copy, fill, launch
from ..model import Model
from ..state import State
from .runge_kutta import RungeKutta
from .stages import padded
from .step_control import StepControl
from .tableau import BOGACKI_SHAMPINE, DORMAND_PRINCE

SMALLEST_STEP = 1e-9  # of the interval asked for


class EmbeddedPair(RungeKutta):
    """Divides the step it is given so that the error of each part, for the worst particle, is within tolerance.

    The error is the difference of the two methods of the pair; the better one is propagated. It is measured against

        position: position_tolerance + rtol · (way gone in the step)
        velocity: velocity_tolerance + rtol · (speed)

    The last stage is the first one of the next step, but where forces remember: hysteresis moves on with each of these
    steps. Sizes are chosen on the host, over all worlds together.

    Args:
        model: the model.
        rtol: relative tolerance [-]. position_tolerance: [m]. velocity_tolerance: [m/s].
        max_steps: most steps tried per call before giving up.

    Raises:
        InputError: on tolerances that are not positive numbers.
    """

    capturable = False
    adaptive = True
    couples_worlds = True
    convergence_options = {"rtol": 1e9, "position_tolerance": 1e9, "velocity_tolerance": 1e9}  # noqa: RUF012

    def __init__(
        self,
        model: Model,
        *,
        rtol: float = 1e-3,
        position_tolerance: float = 1e-5,
        velocity_tolerance: float = 1e-3,
        max_steps: int = 100_000,
    ):
        super().__init__(model)
        self.rtol = validate.number(rtol, "rtol", above=0.0)
        self.position_tolerance = validate.number(position_tolerance, "position_tolerance", above=0.0)
        self.velocity_tolerance = validate.number(velocity_tolerance, "velocity_tolerance", above=0.0)
        self.max_steps = validate.integer(max_steps, "max_steps", minimum=1, maximum=10**9)
        self._error = wp.zeros(1, dtype=model.real, device=model.device)
        self._trial = [State.of(model), State.of(model)]
        self.reset()
        self.remember()

    def reset(self) -> None:
        """Forgets the step size and the counts."""
        self.control = StepControl(self.order)
        self.size = math.inf
        self.accepted = self.rejected = 0

    def remember(self) -> None:
        """Keeps the step size, what it depends on, and the counts."""
        self._kept = replace(self.control), self.size, self.accepted, self.rejected

    def recall(self) -> None:
        """Back to what :meth:`remember` kept."""
        control, self.size, self.accepted, self.rejected = self._kept
        self.control = replace(control)

    def metrics(self) -> dict[str, Any]:
        """``accepted_steps`` and ``rejected_steps`` since the start, ``step_size`` [s] of the step to come."""
        return {"accepted_steps": self.accepted, "rejected_steps": self.rejected, "step_size": self.size}

    def step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """As many steps as needed; the last one ends at dt.

        Raises:
            StepSizeError: the tolerance cannot be met.
        """
        now, (trial, spare) = state_in, self._trial
        trial.world_time = spare.world_time = state_in.world_time
        time, tried = 0.0, 0
        while time < dt:
            h, last = self._next_size(dt - time)
            if tried == self.max_steps or h < SMALLEST_STEP * dt:
                self._give_up(dt, tried, h)
            tried += 1
            error = self._try(model, now, trial, forces, h, time)
            factor = self.control.factor(error)
            if not self.control.accepts(error):
                self.rejected += 1
                self.size = h * factor
                continue
            self.accepted += 1
            time = dt if last else time + h
            self.size = max(h * factor, self.size) if last and factor >= 1.0 else h * factor
            now, trial, spare = trial, spare, trial
            if time < dt:  # where the step asked for ends, whoever asked for it does so
                forces.advance(now)
        state_out.copy_from(now)
        state_out.forces_current = now.forces_current

    def _next_size(self, left: float) -> tuple[float, bool]:
        """The size of the next step and whether it ends the interval; two equal steps rather than a tiny last one."""
        if self.size >= 0.999 * left:
            return left, True
        return (0.5 * left, False) if self.size > 0.5 * left else (self.size, False)

    def _try(self, model: Model, now: State, trial: State, forces: Forces, h: float, time: float) -> float:
        """A step of h [s] from ``now`` to ``trial``; its error in units of the tolerance."""
        last = self.tableau.stages - 1
        self.take_stages(model, now, forces, h, time, last)
        now.forces_current = True
        self.finish(model, now, trial, h, time)
        end = self.stages.at(last, trial)
        forces.evaluate(end, time + h)
        copy(trial.particle_f, end.particle_f)
        trial.forces_current = True
        return self._measure(model, now, trial, h)

    def _measure(self, model: Model, now: State, trial: State, h: float) -> float:
        difference = np.array(self.tableau.error)
        kernels = model.kernels.explicit_step
        fill(self._error)
        launch(
            kernels.step_error,
            dim=model.particle_count,
            inputs=[
                model.particle_inv_mass, now.particle_q, now.particle_f, self.stages.forces, self.tableau.stages - 1,
                kernels.weights(*padded(h * h * (difference @ self.tableau.matrix))),
                kernels.weights(*padded(h * difference)),
                trial.particle_q, trial.particle_qd, self.rtol, self.position_tolerance, self.velocity_tolerance,
            ],
            outputs=[self._error],
            device=model.device,
        )  # fmt: skip
        return float(self._error.numpy()[0])

    def _give_up(self, dt: float, tried: int, h: float) -> None:
        raise StepSizeError(
            f"{self.name} could not meet its tolerances: after {tried} steps in {dt:g} s the next would be {h:.2g} s; "
            "raise rtol, position_tolerance or velocity_tolerance, soften the fabric, or use an implicit integrator."
        )

    @classmethod
    def stable_step(cls, omega: float, gamma: float) -> float:
        """No limit: unstable steps show as errors, and are made smaller."""
        return math.inf

    @classmethod
    def usable_step(cls, omega: float, gamma: float) -> float:
        """No limit, as for :meth:`stable_step`."""
        return math.inf


class BogackiShampine(EmbeddedPair):
    """Order three with an error estimate of order two."""

    name = "bogacki_shampine"
    tableau = BOGACKI_SHAMPINE
    order = 3
    reference = "Bogacki, Shampine, Applied Mathematics Letters 2 (1989) 321–325"
    cost = "3 force evaluations per step it chooses"
    use = "explicit, without choosing a step: rough tolerances, stiff cloth"


class DormandPrince(EmbeddedPair):
    """Order five with an error estimate of order four."""

    name = "dormand_prince"
    tableau = DORMAND_PRINCE
    order = 5
    reference = "Dormand, Prince, Journal of Computational and Applied Mathematics 6 (1980) 19–26"
    cost = "6 force evaluations per step it chooses"
    use = "reference solutions: accurate to a tolerance, without choosing a step"
