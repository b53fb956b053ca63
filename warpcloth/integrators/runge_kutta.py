"""Explicit Runge–Kutta methods: a tableau each, one stepper for all."""

from typing import ClassVar

import numpy as np
from numpy.polynomial import Polynomial

from ..forces import Forces
from ..kinematics import drive_pins
from ..model import Model
from ..state import State
from . import oscillator
from .base import Integrator
from .stages import Stages, advance
from .tableau import FORWARD_EULER, HEUN, MIDPOINT, RK4, Tableau


class RungeKutta(Integrator):
    """Steps any explicit ``tableau``. Moving pins are where they belong at the time of every stage.

    Velocities are integrated as x′ = v, so the position at stage i is x + c_i h v + h² Σ_j (a²)_ij f_j/m: only forces
    are stored (Nyström's form of the same method).
    """

    tableau: ClassVar[Tableau]
    implicit = False
    symplectic = False
    capturable = True

    def __init__(self, model: Model):
        self.stages = Stages(model, self.tableau.stages)

    def step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """One step; see :class:`~warpcloth.integrators.base.Integrator`."""
        self.take_stages(model, state_in, forces, dt, 0.0, self.tableau.stages)
        self.finish(model, state_in, state_out, dt, 0.0)

    def take_stages(
        self, model: Model, start: State, forces: Forces, dt: float, time_offset: float, count: int
    ) -> None:
        """Forces of the first ``count`` stages of a step of dt [s] that begins ``time_offset`` [s] after the clock."""
        if not start.forces_current:
            forces.evaluate(start, time_offset)
        a, nodes = self.tableau.matrix, self.tableau.nodes
        for i in range(1, count):
            stage = self.stages.scratch(i, start.world_time)
            offset = time_offset + float(nodes[i]) * dt
            drift, w, p = float(nodes[i]) * dt, dt * a[i, :i], dt * dt * (a @ a)[i, :i]
            advance(model, start, start.particle_f, self.stages, stage, drift, w, p)
            drive_pins(model, start.world_time, offset, stage.particle_q, stage.particle_qd)
            forces.evaluate(stage, offset)

    def finish(self, model: Model, start: State, out: State, dt: float, time_offset: float) -> None:
        """The end of the step from the forces of its stages.

        Embedded pairs come here before their last stage, which has no weight: its force is still that of another step,
        perhaps of a rejected one that was not finite, and zero times that is not zero.
        """
        b = np.trim_zeros(np.array(self.tableau.b), "b")
        weights = dt * b, dt * dt * (b @ self.tableau.matrix[: len(b), : len(b)])
        advance(model, start, start.particle_f, self.stages, out, dt, *weights)
        drive_pins(model, start.world_time, time_offset + dt, out.particle_q, out.particle_qd)

    @classmethod
    def propagator(cls, omega: float, gamma: float) -> np.ndarray:
        """R(hA) for (x, v)′ = A (x, v): what a step does to the oscillator, 2×2 polynomials in h."""
        system = np.array([[0.0, 1.0], [-omega * omega, -gamma]])
        powers = [np.linalg.matrix_power(system, k) for k in range(cls.tableau.stages + 1)]
        coefficients = np.tensordot(np.diag(cls.tableau.stability_polynomial), powers, axes=1)
        return np.array([[Polynomial(coefficients[:, i, j]) for j in range(2)] for i in range(2)], dtype=object)

    @classmethod
    def stable_step(cls, omega: float, gamma: float) -> float:
        """From the stability polynomial of the tableau, see :mod:`warpcloth.integrators.oscillator`."""
        omega, gamma, unit = oscillator.scaled(omega, gamma)
        return oscillator.largest_stable_step(cls.propagator(omega, gamma)) / unit if unit else float("inf")

    @classmethod
    def usable_step(cls, omega: float, gamma: float) -> float:
        """Largest step [s] at which no mode grows faster than 0.1/s (by a tenth per second).

        Methods of order 1 and 2 let undamped motion grow at any step, so that "stable" would mean no step at all, and
        slower modes may have less damping than the fastest. So this looks at modes of frequency s ω and damping s² γ
        (damping in proportion to stiffness, as fabrics have it), s ≤ 1.
        """
        steps = [float("inf")]
        for s in oscillator.MODES:
            o, g, unit = oscillator.scaled(s * omega, s * s * gamma)
            if unit:
                rate = oscillator.GROWTH_RATE / unit
                steps.append(oscillator.largest_step_of_slow_growth(cls.propagator(o, g), rate) / unit)
        return min(steps)


class ForwardEuler(RungeKutta):
    """x ← x + h v, v ← v + h a(x, v).

    Motion across taut springs has no damping in the law, so it grows by ω² h/2 per second, ω² being about tension over
    mass and length. Automatic substeps do not know the tension to come: cotton of 9² vertices that hangs by two corners
    grows by 2 to 4/s, which its nonlinearity takes up, but under 1000 m/s² by 36 to 66/s, and diverged after 0.4 s with
    the automatic 48 substeps; with 4000 it moved as with other schemes.
    """

    name = "forward_euler"
    tableau = FORWARD_EULER
    order = 1
    reference = "Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), I.7"
    cost = "1 force evaluation"
    use = "to see why not: energy grows at every step size unless damping takes it out"


class Midpoint(RungeKutta):
    """A full step with the slope at the middle, which a forward Euler half step predicts."""

    name = "midpoint"
    tableau = MIDPOINT
    order = 2
    reference = "Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), II.1 (Runge 1895)"
    cost = "2 force evaluations"
    use = "for comparison: second order, but undamped motion slowly grows"


class Trapezoidal(RungeKutta):
    """The mean of the slopes at both ends, the far one predicted by forward Euler (Heun; explicit trapezoidal rule)."""

    name = "trapezoidal"
    tableau = HEUN
    order = 2
    reference = "Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), II.1 (Heun 1900)"
    cost = "2 force evaluations"
    use = "for comparison: as midpoint, of which it has the stability"


class ClassicalRungeKutta(RungeKutta):
    """The classical method of order four."""

    name = "rk4"
    tableau = RK4
    order = 4
    reference = "Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), II.1 (Kutta 1901)"
    cost = "4 force evaluations"
    use = "accurate motion of soft, smooth systems; reference solutions"
