"""Splitting methods: kicks change velocities by forces, drifts change positions by velocities; a list of both each.

Without damping such a method is symplectic, so its energy error stays bounded; it conserves linear and angular momentum
with damping too, as every kick acts along the springs and every drift along the velocities.

With damping, forces depend on velocities, and a kick must follow v′ = a(x, v) at fixed x to the order of the method: it
is then a small Runge–Kutta step of its own, of more evaluations. Forces that do not depend on velocities need one.
"""

import math
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from ..forces import Forces, Move
from ..kinematics import drive_pins
from ..model import Model
from ..state import State
from . import oscillator
from .base import Integrator
from .stages import Stages, advance
from .tableau import FORWARD_EULER, RK4, Tableau


class Stage(NamedTuple):
    """A kick and the drift after it, as fractions of the step.

    ``inner`` is the method that a kick of velocity-dependent forces follows; None: one evaluation at the velocity that
    the force at the start of the step predicts for the end of the kick.
    """

    kick: float
    drift: float
    inner: Tableau | None = FORWARD_EULER

    def method(self, forces: Forces) -> Tableau | None:
        """What the kick follows with these forces."""
        return self.inner if forces.velocity_dependent else FORWARD_EULER


class Splitting(Integrator):
    """Steps any list of kicks and drifts. Time passes with the drifts, and moving pins with it."""

    sequence: ClassVar[tuple[Stage, ...]]
    implicit = False
    symplectic = True
    capturable = True
    conserves_angular_momentum = True

    def __init__(self, model: Model):
        self.stages = Stages(model, max(2 if s.inner is None else s.inner.stages for s in self.sequence))

    def step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """One step; see :class:`~warpcloth.integrators.base.Integrator`."""
        count = len(self.sequence)
        self.take(model, state_in, [state_out] * count, [self.stages] * count, forces, dt)
        state_out.forces_current = self.sequence[-1].drift == 0.0 and not forces.velocity_dependent

    def take(
        self,
        model: Model,
        start: State,
        ends: Sequence[State],
        scratch: Sequence[Stages],
        forces: Forces,
        dt: float,
    ) -> None:
        """All kicks and drifts; each has its end and its scratch memory, which may be the same ones for all."""
        now, time = start, 0.0
        for stage, end, stages in zip(self.sequence, ends, scratch, strict=True):
            kick, drift = stage.kick * dt, stage.drift * dt
            simple = kick != 0.0 and not now.forces_current and stage.method(forces) is FORWARD_EULER
            if not (simple and forces.advance_at_once(now, end, Move(drift, drift * kick, kick))):
                weights = self._kick(model, now, start, stages, forces, dt, time, stage)
                advance(model, now, now.particle_f, stages, end, drift, weights, drift * weights)
            time += drift
            if drift:
                drive_pins(model, start.world_time, time, end.particle_q, end.particle_qd)
            now = end

    def _kick(
        self,
        model: Model,
        now: State,
        start: State,
        stages: Stages,
        forces: Forces,
        dt: float,
        time: float,
        stage: Stage,
    ) -> np.ndarray:
        """Forces at ``now``, as many as the kick needs; their weights [s] in it."""
        h = stage.kick * dt
        if h == 0.0:
            return np.zeros(0)
        inner = stage.method(forces)
        if inner is None:
            predicted = stages.scratch(1, start.world_time)
            advance(model, now, start.particle_f, stages, predicted, 0.0, [h])
            forces.evaluate(predicted, time)
            return np.array([0.0, h])
        if not now.forces_current:
            forces.evaluate(now, time)
        for i in range(1, inner.stages):
            later = stages.scratch(i, start.world_time)
            advance(model, now, now.particle_f, stages, later, 0.0, h * inner.matrix[i, :i])
            forces.evaluate(later, time)
        return h * np.array(inner.b)

    @classmethod
    def propagator(cls, omega: float, gamma: float) -> np.ndarray:
        """What a step does to the oscillator, 2×2 polynomials in h."""
        degree = sum(3 if stage.inner is None else stage.inner.stages + 1 for stage in cls.sequence)
        starts = np.zeros((2, 2, degree + 1))  # x and v, from (1, 0) and from (0, 1), by powers of h
        starts[0, 0, 0] = starts[1, 1, 0] = 1.0
        ends = cls._linear_step(omega, gamma, *starts)
        return np.array([[Polynomial(column) for column in row] for row in ends], dtype=object)

    @classmethod
    def _linear_step(cls, omega: float, gamma: float, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """One step of the oscillator from (x, v); coefficients of powers of h in the last axis."""

        def times_h(p: np.ndarray) -> np.ndarray:
            return np.concatenate([np.zeros_like(p[..., :1]), p[..., :-1]], axis=-1)

        first = -omega * omega * x - gamma * v
        for stage in cls.sequence:
            slope = -omega * omega * x - gamma * v
            if stage.inner is None:
                kick = slope - gamma * stage.kick * times_h(first)
            else:
                r = [float(c) for c in stage.inner.stability_polynomial[1:]]
                kick = r[-1] * slope
                for c in reversed(r[:-1]):
                    kick = c * slope - gamma * stage.kick * times_h(kick)
            v = v + stage.kick * times_h(kick)
            x = x + stage.drift * times_h(v)
        return x, v

    @classmethod
    def stable_step(cls, omega: float, gamma: float) -> float:
        """From the eigenvalues of :meth:`propagator`."""
        omega, gamma, unit = oscillator.scaled(omega, gamma)
        return oscillator.largest_stable_step(cls.propagator(omega, gamma)) / unit if unit else math.inf

    @classmethod
    def usable_step(cls, omega: float, gamma: float) -> float:
        """Largest step that is stable whatever the damping up to γ.

        Modes of one network are damped differently, and some damping can stabilise a scheme beyond its undamped limit.
        """
        return min(cls.stable_step(omega, share * gamma) for share in np.linspace(0.0, 1.0, 17 if gamma else 1))


class SymplecticEuler(Splitting):
    """v ← v + h a(x, v), x ← x + h v. Stable up to ω h = 2 (√(1 + ζ²) − ζ), with γ = 2 ζ ω."""

    name = "symplectic_euler"
    sequence = (Stage(1.0, 1.0),)
    order = 1
    reference = "Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), I.1.2"
    cost = "1 force evaluation"
    use = "the plain choice for springs: robust and cheap, many small steps for stiff cloth"


class VelocityVerlet(Splitting):
    """Half a kick, a drift, half a kick at the predicted velocity. Stable up to ω h = 2 without damping."""

    name = "velocity_verlet"
    sequence = (Stage(0.5, 1.0), Stage(0.5, 0.0, None))
    order = 2
    reference = "Hairer, Lubich, Wanner, Acta Numerica 12 (2003) 399–450; prediction as in Groot, Warren (1997)"
    cost = "1 force evaluation, 2 with damping or obstacles"
    use = "long undamped motion: second order at the price of symplectic Euler"


class Pefrl(Splitting):
    """Position-extended Forest–Ruth-like method of order four.

    Of the fourth-order splittings tried (Forest–Ruth, Suzuki, Blanes–Moan S6 and RKN6) it lets the largest stable step
    through per evaluation (ω h ≤ 2.99 in 4) and is as accurate per evaluation as the best, 150 times more than
    Forest–Ruth. Two of its kicks go backwards in time; with damping these undo what the others took out. So it stays
    of order four, but damping of the fastest mode narrows its stability.
    """

    _XI, _LAMBDA, _CHI = 0.1786178958448091, -0.2123418310626054, -0.06626458266981849
    name = "pefrl"
    sequence = (
        Stage(0.0, _XI),
        Stage(0.5 - _LAMBDA, _CHI, RK4),
        Stage(_LAMBDA, 1.0 - 2.0 * (_CHI + _XI), RK4),
        Stage(_LAMBDA, _CHI, RK4),
        Stage(0.5 - _LAMBDA, _XI, RK4),
    )
    order = 4
    reference = "Omelyan, Mryglod, Folk, Computer Physics Communications 146 (2002) 188–202"
    cost = "4 force evaluations, 16 with damping"
    use = "long, accurate undamped motion: energy drift far below any other scheme at the same cost"
