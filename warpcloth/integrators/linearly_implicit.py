"""Schemes with one linear system per step, forces linearised at its start: Baraff and Witkin's, and IMEX Euler."""

import math
from typing import Any, ClassVar

import numpy as np
import warp as wp

from .. import validate
from ..forces import Forces, Linearization
from ..kinematics import drive_pins
from ..launching import copy, fill, launch
from ..model import Model
from ..state import State
from .base import Integrator
from .conjugate_gradient import ConjugateGradient
from .figures import Figures


class LinearlyImplicit(Integrator):
    """(M + dt C + s dt² K) Δv = dt f − s dt² K v, then x ← x + dt (v + Δv); with s = 0 elasticity is explicit.

    K and C are those at the start, K with compressed springs made semi-definite.

    Args:
        model: the model.
        cg_tolerance: error of the linear solve relative to Δv in the energy norm; None is 1e-10 in float64 and 1e-4 in
            float32.
        cg_iterations: conjugate gradient iterations after which the solve ends and the step counts as not converged.

    Raises:
        InputError: an option is out of range.
    """

    order = 1
    implicit = True
    capturable = True
    convergence_options: ClassVar[dict[str, Any]] = {"cg_tolerance": 1e-12}
    elastic: ClassVar[bool]

    def __init__(self, model: Model, *, cg_tolerance: float | None = None, cg_iterations: int = 1000):
        if cg_tolerance is None:
            cg_tolerance = 1e-10 if model.precision == "float64" else 1e-4
        cg_tolerance = validate.number(cg_tolerance, "cg_tolerance", above=0.0, maximum=1.0)
        cg_iterations = validate.integer(cg_iterations, "cg_iterations", minimum=1, maximum=1_000_000)
        self.cg = ConjugateGradient(model, cg_iterations)
        self._tolerance = model.array(np.full(model.world_count, cg_tolerance), wp.float64)
        self._residual, self._velocity, self._change = (wp.zeros_like(model.particle_q) for _ in range(3))
        self._ones = model.array(np.ones(model.world_count), model.real)
        self._everywhere = wp.ones(model.world_count, dtype=wp.int32, device=model.device)
        self._total = wp.zeros(model.world_count, dtype=wp.int64, device=model.device)
        self._failures = wp.zeros(model.world_count, dtype=wp.int32, device=model.device)
        self._figures = Figures(self.cg.solves.iterations, self._total, self._failures)

    def step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """One step; see :class:`~warpcloth.integrators.base.Integrator`."""
        forces.evaluate(state_in)
        self._place_pins(model, state_in, state_out, dt)
        self._right_side(model, state_in, forces, dt)
        at = Linearization(state_in, dt * dt if self.elastic else 0.0, dt, self._ones)
        if self.linearizes:
            forces.linearize(at)
        self.cg.solve(forces, at, self._residual, self._everywhere, self._tolerance)
        start = [state_in.particle_q, state_in.particle_qd]
        inputs = [model.particle_inv_mass, *start, self.cg.x, dt]
        self._launch(model, "apply_change", inputs, [state_out.particle_q, state_out.particle_qd])
        launch(
            model.kernels.implicit_schemes.count_solves,
            dim=model.world_count,
            inputs=[self.cg.solves, self.cg.max_iterations],
            outputs=[self._total, self._failures],
            device=model.device,
        )

    def remember(self) -> None:
        """Keeps what :meth:`metrics` tells."""
        self._figures.remember()

    def recall(self) -> None:
        """Back to what :meth:`remember` kept."""
        self._figures.recall()

    def metrics(self) -> dict[str, Any]:
        """Of the latest step, the worst world: ``cg_iterations``, ``converged``; totals since the start."""
        iterations = int(self.cg.solves.iterations.numpy().max())
        return {
            "cg_iterations": iterations,
            "converged": iterations < self.cg.max_iterations,
            "cg_iterations_total": int(self._total.numpy().max()),
            "unconverged_steps": int(self._failures.numpy().max()),
        }

    def _place_pins(self, model: Model, state_in: State, state_out: State, dt: float) -> None:
        """Pins at the end of the step in ``state_out``, and what is known of the velocities."""
        copy(state_out.particle_q, state_in.particle_q)
        fill(state_out.particle_qd)
        drive_pins(model, state_in.world_time, dt, state_out.particle_q, state_out.particle_qd)
        states = [state_in.particle_q, state_in.particle_qd, state_out.particle_q, state_out.particle_qd]
        self._launch(model, "pin_changes", [model.particle_inv_mass, *states, dt], [self._velocity, self._change])

    def _right_side(self, model: Model, state_in: State, forces: Forces, dt: float) -> None:
        """Minus the right side of the system, in ``_residual``."""
        fill(self._residual)
        if self.elastic:
            forces.hessian_product(Linearization(state_in, dt * dt, 0.0, self._ones), self._velocity, self._residual)
        forces.hessian_product(Linearization(state_in, 0.0, dt, self._ones), self._change, self._residual)
        inputs = [model.particle_inv_mass, state_in.particle_f, dt]
        self._launch(model, "linear_residual", inputs, [self._residual])

    def _launch(self, model: Model, kernel: str, inputs: list, outputs: list) -> None:
        function = getattr(model.kernels.implicit_schemes, kernel)
        launch(function, dim=model.particle_count, inputs=inputs, outputs=outputs, device=model.device)


class LinearImplicitEuler(LinearlyImplicit):
    """Implicit Euler with forces linearised at the start of the step: one linear system, no iteration."""

    name = "linear_implicit_euler"
    linearizes = True
    symplectic = False
    elastic = True
    steps_per_travel = 3.0  # with 1 `drape_bunny` was torn, with 2 it is good; a curtain hit at 7 m/s takes 3
    reference = "Baraff and Witkin, Large Steps in Cloth Simulation, SIGGRAPH 1998"
    cost = "one linear solve: tens to hundreds of matrix products"
    use = "fast drapes at frame-sized steps when the motion on the way need not be exact; damps like implicit Euler"

    @classmethod
    def stable_step(cls, omega: float, gamma: float) -> float:
        """Stable at any step as far as the linearisation holds."""
        return math.inf


class Imex(LinearlyImplicit):
    """Symplectic Euler with implicit damping: v ← v + dt a(x, v′), x ← x + dt v′."""

    name = "imex"
    symplectic = True
    conserves_angular_momentum = True
    elastic = False
    reference = "Ascher, Ruuth, Wetton, Implicit-Explicit Methods, SIAM J. Numer. Anal. 32 (1995)"
    cost = "1 force evaluation and a linear solve of few matrix products"
    use = "strongly damped cloth of moderate stiffness: damping never limits the step"

    @classmethod
    def stable_step(cls, omega: float, gamma: float) -> float:
        """Root of ω² dt² − 2 γ dt = 4: |λ| ≤ 1 for (1 + γ dt) λ² − (2 + γ dt − ω² dt²) λ + 1 = 0."""
        if omega == 0.0:
            return math.inf
        return (gamma + math.sqrt(gamma * gamma + 4.0 * omega * omega)) / (omega * omega)

    @classmethod
    def usable_step(cls, omega: float, gamma: float) -> float:
        """That of undamped modes, as the stiffest mode of a network need not be the most damped one."""
        return cls.stable_step(omega, 0.0)
