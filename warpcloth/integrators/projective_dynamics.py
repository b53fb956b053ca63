"""Projective dynamics: implicit Euler by local steps for springs and global ones with a constant matrix."""

import math

import warp as wp

from .. import validate
from ..forces import Forces, Linearization
from ..launching import fill, launch
from ..model import Model
from ..state import State
from .adjacency import SpringRows
from .conjugate_gradient import ConjugateGradient
from .position_step import MAX_ITERATIONS, PositionStep

SOLVERS = {"jacobi": 0.2, "chebyshev": 0.6, "cg": 1.0}  # sweeps of XPBD that an iteration is worth on hanging cloth
PLAIN_SHARE = 1.0 / 3.0  # of the iterations come before the accelerated ones: from far away, extrapolation diverges
DAMPING_EXPONENT = 2.0  # the accelerated ones together damp what they can by cosh of this
CG_TOLERANCE = 1e-2  # of a global step, which the next one corrects


class ProjectiveDynamics(PositionStep):
    """Implicit Euler by alternating local and global steps (see ``kernels/projective.py``), damping included.

    Converges to Newton's solution as ``iterations`` grows, whatever solves the global step. Momentum is conserved only
    as far as the steps are solved.

    Chebyshev's method with the true spectral radius, as in Wang (2015), needs more iterations than a frame has and
    diverges at large steps, where the spring directions change. Here the first third of the iterations is plain and
    the radius that the others assume is bounded by 1/cosh(2/n), n their number: a hanging 32 × 32 cloth, one substep of
    1/60 s and 30 iterations, then has a worst mean strain of 3.0 %, against 16 % with plain Jacobi iterations and
    divergence with the true radius.

    Args:
        model: the model.
        iterations: local and global steps per time step.
        solver: of the global step. "jacobi": one Jacobi iteration; "chebyshev": the same, accelerated; "cg": conjugate
            gradients to 1 %, up to ``max_cg_iterations`` of them.
        warm_start: share of the previous spring forces with which a step begins, 0 to 1.
        max_cg_iterations: bound per global step.

    Raises:
        InputError: a value out of range.
    """

    name = "projective_dynamics"
    needs_inertial = True
    order = 1
    conserves_linear_momentum = False
    reference = (
        "Liu, Bargteil, O'Brien, Kavan (2013), doi 10.1145/2508363.2508406; Wang (2015), 10.1145/2816795.2818063"
    )
    cost = "10 passes over the springs of each particle, one launch each"
    use = "implicit steps in few launches, without colours; xpbd is cheaper for the same strain"

    def __init__(
        self,
        model: Model,
        *,
        iterations: int = 10,
        solver: str = "chebyshev",
        warm_start: float = 0.5,
        max_cg_iterations: int = 50,
    ):
        super().__init__(model, iterations, warm_start)
        solver = validate.choice(solver, SOLVERS, "solver")
        self.sweep_value = SOLVERS[solver]
        most = validate.integer(max_cg_iterations, "max_cg_iterations", minimum=1, maximum=MAX_ITERATIONS)
        rows = self.rows = SpringRows(model)
        self.spare = wp.zeros_like(self.displacement)
        if solver == "cg":
            self.solver: _ByCg | _ByJacobi = _ByCg(model, rows, most)
        else:
            self.solver = _ByJacobi(model, rows, solver == "chebyshev", self.iterations)

    def prepare(self) -> None:
        """Takes over properties of springs that have changed."""
        self.rows.properties.read()

    def _solve(self, model: Model, state_in: State, forces: Forces, dt: float) -> wp.array:
        forces.evaluations += self.iterations
        self.solver.begin(state_in, dt)
        now, spare = self.displacement, self.spare
        for iteration in range(1, self.iterations + 1):
            now, spare = self.solver.improve(self.inertial, now, spare, iteration)
        return now


class _ByJacobi:
    """Global steps of one Jacobi iteration."""

    def __init__(self, model: Model, rows: SpringRows, accelerated: bool, iterations: int):
        self.model, self.rows, self.accelerated, self.dt = model, rows, accelerated, 0.0
        self.plain = math.ceil(PLAIN_SHARE * iterations)
        self.largest_radius = 1.0 / math.cosh(DAMPING_EXPONENT / max(1, iterations - self.plain))
        self.radius = wp.zeros(model.world_count, dtype=model.real, device=model.device)
        self.masses = [model.particle_mass, model.particle_inv_mass, model.particle_world]

    def begin(self, state: State, dt: float) -> None:
        """A step of dt from ``state``: the spectral radius of each world."""
        self.state, self.dt = state, dt
        if self.accelerated:
            fill(self.radius)
            launch_named(
                self.model, "spectral_radius", [*self.masses, self.rows.start[0], self.rows.law, dt], self.radius
            )

    def improve(self, inertial: wp.array, now: wp.array, spare: wp.array, iteration: int) -> tuple[wp.array, wp.array]:
        """The next iterate and the one to overwrite; ``spare`` holds the one before ``now``."""
        number = max(0, iteration - self.plain) if self.accelerated else 0
        rows = [self.rows.start[0], self.rows.other, self.rows.law]
        inputs = [
            *self.masses, *rows, self.state.particle_q, inertial, now,
            self.radius, number, self.largest_radius, self.dt,
        ]  # fmt: skip
        launch_named(self.model, "jacobi", inputs, spare)
        return spare, now


class _ByCg:
    """Global steps by preconditioned conjugate gradients; this object is the matrix, known by its products."""

    def __init__(self, model: Model, rows: SpringRows, max_iterations: int):
        self.model, self.rows = model, rows
        self.cg = ConjugateGradient(model, max_iterations)
        self.residual = wp.zeros_like(model.particle_q)
        self.world_project = wp.ones(model.world_count, dtype=model.real, device=model.device)
        self.world_tolerance = wp.full(model.world_count, CG_TOLERANCE, dtype=wp.float64, device=model.device)
        self.world_active = wp.ones(model.world_count, dtype=wp.int32, device=model.device)

    def begin(self, state: State, dt: float) -> None:
        """A step of dt from ``state``: the matrix M + h² K + h C."""
        self.at = Linearization(state, stiffness=dt * dt, damping=dt, world_project=self.world_project)

    def improve(self, inertial: wp.array, now: wp.array, spare: wp.array, iteration: int) -> tuple[wp.array, wp.array]:
        """The next iterate, in place."""
        model, rows = self.model, [self.rows.start[0], self.rows.other, self.rows.law]
        masses = [model.particle_mass, model.particle_inv_mass]
        state, dt = self.at.state, self.at.damping
        launch_named(model, "residual", [*masses, *rows, state.particle_q, inertial, now, dt], self.residual)
        self.cg.solve(self, self.at, self.residual, self.world_active, self.world_tolerance)
        launch_named(model, "correct", [self.cg.x], now)
        return now, spare

    def hessian_product(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds (h² K + h C) x."""
        launch_named(
            self.model, "matrix_product", [self.rows.start[0], self.rows.other, self.rows.law, at.damping, x], out
        )

    def hessian_diagonal(self, at: Linearization, out: wp.array) -> None:
        """Adds the diagonal of h² K + h C."""
        launch_named(self.model, "matrix_diagonal", [self.rows.start[0], self.rows.law, at.damping], out)


def launch_named(model: Model, kernel: str, inputs: list, out: wp.array) -> None:
    """A kernel of ``kernels/projective.py``, one thread per particle."""
    launch(
        getattr(model.kernels.projective, kernel),
        dim=model.particle_count,
        inputs=inputs,
        outputs=[out],
        device=model.device,
    )
