"""The adjoint of an implicit step: the transposed linear system at its solution, instead of going back through Newton.

The stage of a scheme solves R = M (v − v̄) − γ f(x̄ + γ v, v) = 0 for the free particles. With the loss's gradient a with
respect to v, that through x = x̄ + γ v included, and

    Aᵀ λ = a,      A = ∂R/∂v = M − γ² ∂f/∂x − γ ∂f/∂v

the gradients are M λ with respect to v̄, γ (∂f/∂x)ᵀ λ with respect to x̄, −λ·(v − v̄) to m, and γ (∂f/∂p)ᵀ λ to whatever
else f depends on. Products with ∂fᵀ come from the adjoints of the force kernels, so they are exact; the symmetric
matrix that the steps are solved with leaves out parts of it, and is the preconditioner.
"""

from collections.abc import Callable

import numpy as np
import warp as wp

from ..errors import SimulationError
from ..forces import Linearization
from ..integrators.implicit import ImplicitScheme
from ..kinematics import drive_pins
from ..model import Model
from ..state import State
from .recording import Recording

INNER = 1e-2  # accuracy of the preconditioner's solves
MOST = 200  # Krylov vectors


def implicit_step(
    recording: Recording, scheme: ImplicitScheme, model: Model, start: State, end: State, dt: float
) -> None:
    """A step of one implicit stage; pins that are led go to their place before it is solved."""
    gamma, time = scheme.stage.gamma * dt, scheme.stage.time * dt
    position, velocity = (wp.zeros_like(start.particle_q, requires_grad=True) for _ in range(2))
    base = State(position, velocity, start.particle_f, start.world_time)
    with recording:
        if scheme.stage.at_start != 0.0:
            recording.forces.evaluate(start)
        scheme.launch_base(model, start, start, base, end, dt)
        drive_pins(model, start.world_time, time, end.particle_q, end.particle_qd)
    wp.copy(scheme.newton.position_base, base.particle_q)
    wp.copy(scheme.newton.velocity_base, base.particle_qd)
    scheme.newton.solve(end, recording.plain_forces, gamma, time, changes=scheme.changes[0])
    stage = _Stage(recording, scheme, model, base, end, gamma, time)
    recording.before_going_back_further(stage.backward)
    if scheme.stage.beyond != 0.0:
        with recording:
            scheme.finish(model, start, end, dt)


class _Stage:
    """A solved stage: ``base`` holds x̄ and v̄, ``end`` its solution, both with gradients."""

    def __init__(
        self,
        recording: Recording,
        scheme: ImplicitScheme,
        model: Model,
        base: State,
        end: State,
        gamma: float,
        time: float,
    ):
        self.recording, self.cg, self.model = recording, scheme.newton.cg, model
        self.base, self.end, self.gamma, self.time = base, end, gamma, time
        self._solution = [wp.clone(array, requires_grad=False) for array in (end.particle_q, end.particle_qd)]
        self._free = (model.particle_inv_mass.numpy() > 0.0)[:, None]
        self._mass = model.particle_mass.numpy().astype(np.float64)[:, None]

    def backward(self) -> None:
        """From gradients in ``end`` to those in ``base``, of the parameters, and of pins in ``end``."""
        base, end, free = self.base, self.end, self._free
        wp.copy(end.particle_q, self._solution[0])
        wp.copy(end.particle_qd, self._solution[1])
        q_grad, qd_grad = (array.grad.numpy().astype(np.float64) for array in (end.particle_q, end.particle_qd))
        end.particle_q.grad.zero_()
        end.particle_qd.grad.zero_()
        slopes = ForceSlopes(self.recording, end, self.time)
        multiplier = self._solve(slopes, np.where(free, qd_grad + self.gamma * q_grad, 0.0))
        by_q, _ = slopes.transposed(self.gamma * multiplier, lasting=True)
        _add(base.particle_q, np.where(free, q_grad + by_q, 0.0))
        _add(base.particle_qd, self._mass * multiplier)
        change = end.particle_qd.numpy() - base.particle_qd.numpy()
        _add(self.model.particle_mass, -(multiplier * change).sum(axis=1))
        end.particle_q.grad.assign(np.where(free, 0.0, q_grad + by_q))
        end.particle_qd.grad.zero_()

    def _solve(self, slopes: "ForceSlopes", right: np.ndarray) -> np.ndarray:
        """λ of Aᵀ λ = right; both are 0 for pinned particles."""
        model, gamma = self.model, self.gamma
        ones = model.array(np.ones(model.world_count), model.real)
        everywhere = wp.ones(model.world_count, dtype=wp.int32, device=model.device)
        accuracy = model.array(np.full(model.world_count, INNER), wp.float64)
        matrix = Linearization(self.end, gamma * gamma, gamma, ones, self.time)
        self.recording.plain_forces.linearize(matrix)

        def product(x: np.ndarray) -> np.ndarray:
            by_q, by_qd = slopes.transposed(x)
            return np.where(self._free, self._mass * x - gamma * gamma * by_q - gamma * by_qd, 0.0)

        def precondition(x: np.ndarray) -> np.ndarray:
            self.cg.solve(self.recording.plain_forces, matrix, model.array(-x, model.vec3), everywhere, accuracy)
            return self.cg.x.numpy().astype(np.float64)

        return flexible_gmres(product, precondition, right, 1e-11 if model.precision == "float64" else 1e-5)


class ForceSlopes:
    """Products with the transposed derivatives of the forces at a state, whose gradients must be zero."""

    def __init__(self, recording: Recording, state: State, time_offset: float):
        self.recording, self.state = recording, state
        self._tape = wp.Tape()
        with self._tape:
            recording.plain_forces.evaluate(state, time_offset)

    def transposed(self, x: np.ndarray, *, lasting: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """(∂f/∂x)ᵀ x and (∂f/∂v)ᵀ x; with ``lasting`` (∂f/∂p)ᵀ x is added to the gradients of the parameters, too."""
        state, recording = self.state, self.recording
        kept = [] if lasting else [(array.grad, wp.clone(array.grad)) for array in recording.lasting]
        state.particle_f.grad.assign(x)
        recording.go_back_through_forces(self._tape, state)
        for gradient, before in kept:
            wp.copy(gradient, before)
        found = [array.grad.numpy().astype(np.float64) for array in (state.particle_q, state.particle_qd)]
        state.particle_q.grad.zero_()
        state.particle_qd.grad.zero_()
        return found[0], found[1]


def flexible_gmres(
    product: Callable[[np.ndarray], np.ndarray],
    precondition: Callable[[np.ndarray], np.ndarray],
    right: np.ndarray,
    tolerance: float,
) -> np.ndarray:
    """Solution of A x = right by GMRES with a preconditioner that may change (Saad, SIAM J. Sci. Comput. 14, 1993).

    Args:
        product: A x. precondition: about A⁻¹ x. tolerance: of the residual, relative to ``right``.

    Raises:
        SimulationError: it takes more than ``MOST`` products.
    """
    size = float(np.linalg.norm(right))
    if size == 0.0:
        return np.zeros_like(right)
    basis, directions = [right / size], []
    hessenberg = np.zeros((MOST + 1, MOST))
    for k in range(MOST):
        directions.append(precondition(basis[k]))
        w = product(directions[k])
        for _ in range(2):  # twice is enough
            for j, v in enumerate(basis):
                part = float(np.vdot(v, w))
                hessenberg[j, k] += part
                w = w - part * v
        hessenberg[k + 1, k] = np.linalg.norm(w)
        goal = np.zeros(k + 2)
        goal[0] = size
        h = hessenberg[: k + 2, : k + 1]
        y = np.linalg.lstsq(h, goal, rcond=None)[0]
        if np.linalg.norm(goal - h @ y) <= tolerance * size:
            return sum((c * z for c, z in zip(y, directions, strict=True)), np.zeros_like(right))
        basis.append(w / hessenberg[k + 1, k])
    raise SimulationError(f"The adjoint of an implicit step did not converge in {MOST} products; take shorter steps.")


def _add(array: wp.array, addend: np.ndarray) -> None:
    array.grad.assign(array.grad.numpy() + addend)
