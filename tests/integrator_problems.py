"""Problems with known solutions that every integrator is tested on, and how to run one."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import warpcloth as wc
from warpcloth.cloth import pin
from warpcloth.integrators import INTEGRATORS

ALL = tuple(INTEGRATORS.values())
NAMES = [cls.name for cls in ALL]


def simulation(model: wc.Model, name: str, gravity=(0.0, 0.0, 0.0), substeps: int = 1, **kwargs) -> wc.Simulation:
    """With solver tolerances tight and steps of the given size, unless ``integrator_options`` says otherwise."""
    kwargs = {"integrator_options": INTEGRATORS[name].convergence_options, **kwargs}
    return wc.Simulation(model, name, gravity, substeps, **kwargs)


def phase(sim: wc.Simulation) -> np.ndarray:
    """Positions and velocities, shape [2, particle_count, 3]."""
    return np.stack([sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()])


@dataclass(frozen=True)
class Problem:
    """``build`` makes the model; ``exact`` is :func:`phase` after ``end`` [s]; ``rate`` [1/s] weighs positions."""

    build: Callable[[], wc.Model]
    gravity: tuple[float, float, float]
    end: float
    rate: float
    exact: np.ndarray

    def error(self, name: str, substeps: int) -> float:
        """Largest error of rate · x and v [m/s] over all particles."""
        sim = simulation(self.build(), name, self.gravity, substeps)
        sim.step(self.end)
        difference = phase(sim) - self.exact
        return float(np.abs(difference * np.array([self.rate, 1.0])[:, None, None]).max())


def oscillator(omega=1.0, zeta=0.0, x=0.0, v=0.0, precision="float64") -> wc.Model:
    """A mass of 1 kg on a spring of 1 m along x, ``x`` [m] beyond its rest length."""
    return wc.Model.from_springs(
        [[0, 0, 0], [1.0 + x, 0, 0]], 1.0, [[0, 1]], 1.0, omega * omega, 2.0 * zeta * omega, [0],
        velocities=[[0, 0, 0], [v, 0, 0]], precision=precision,
    )  # fmt: skip


def damped_spring() -> Problem:
    """Section 1 of the known answers: linear, so exact by the matrix exponential."""
    m, k_s, k_d, r, g, x0, end = 0.05, 20.0, 0.05, 0.25, 9.81, 0.30, 0.25
    rest = r * (1.0 + m * g / k_s)
    system = np.array([[0.0, 1.0], [-k_s / (m * r), -k_d / (m * r)]])
    x, v = expm(system * end) @ [x0 - rest, 0.0]
    exact = np.zeros((2, 2, 3))
    exact[:, 1, 0] = rest + x, v

    def build() -> wc.Model:
        return wc.Model.from_springs([[0, 0, 0], [x0, 0, 0]], [1.0, m], [[0, 1]], r, k_s, k_d, [0], precision="float64")

    return Problem(build, (g, 0.0, 0.0), end, 40.0, exact)


def elastic_pendulum() -> Problem:
    """Section 2: nonlinear, damped; ω = 44.7/s of the spring, 3.1/s of the swing."""
    m, k_s, k_d, end, gravity = 0.1, 200.0, 0.5, 0.25, np.array([0.0, -9.81, 0.0])
    x0 = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    net = Network(x0, np.array([[0, 1]]), np.array([1.0]), np.array([k_s]), np.array([k_d]), np.full(2, m))

    def build() -> wc.Model:
        return wc.Model.from_springs(x0, m, [[0, 1]], 1.0, k_s, k_d, [0], precision="float64")

    return Problem(build, tuple(gravity), end, 44.7, net.solve(gravity, end, pinned=[0], path=lambda t: x0[:1]))


def swinging_cloth() -> Problem:
    """A damped sheet hung by two corners, one of which moves and turns; strains of a third, so truly nonlinear."""
    motion = wc.Motion.keyframes(
        [(-0.5, (0, 0, 0)), (1.0, (0.2, 0.15, 0.25), (0, 0.5, 1.0))], interpolation="smooth", pivot=(0.1, 0.1, 0.0)
    )
    fabric = wc.Fabric(
        stretch_stiffness=20.0, shear_stiffness=5.0, bending_rigidity=1e-3, bend_stiffness=1.0, damping_time=5e-3
    )
    cloth = wc.Cloth.grid(
        (0.3, 0.3), (4, 4), fabric, pins=["top_left", pin("top_right", motion)], velocity=(0.2, 1.0, 0.0)
    )
    end, gravity = 0.1, np.array([0.0, 0.0, -9.81])
    springs = cloth.springs
    bending = BendingReference.of(cloth)
    columns = (springs.indices, springs.rest_lengths, springs.stiffness, springs.damping)
    net = Network(cloth.points, *columns, cloth.masses, bending)
    pinned = [12, 15]

    def path(t: float) -> np.ndarray:
        moved = motion.evaluate(cloth.points[[15]], t, motion.pivot)
        return np.stack([cloth.points[12], moved[0]])

    start = np.broadcast_to(cloth.velocity, cloth.points.shape)
    exact = net.solve(gravity, end, pinned, path, start)

    def build() -> wc.Model:
        return wc.Model.build(cloth, precision="float64")

    return Problem(build, tuple(gravity), end, 60.0, exact)


@dataclass(frozen=True)
class BendingReference:
    """The bending law of cloth that is flat at rest once more, as full matrices: a row of ``rows`` for each element."""

    rows: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray

    @staticmethod
    def of(cloth: wc.Cloth) -> "BendingReference":
        elements = cloth.bending
        rows = np.zeros((len(elements), len(cloth.points)))
        rows[elements.element, elements.particles] = elements.weights[:, 0]
        return BendingReference(rows, elements.stiffness, cloth.fabric.damping_time * elements.stiffness)

    def force(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        d, u = self.rows @ x, self.rows @ v
        damped = (self.damping * np.sum(u * d, axis=1) / (np.sum(d * d, axis=1) + 1.0))[:, None] * d
        return -self.rows.T @ (self.stiffness[:, None] * d + damped)


@dataclass(frozen=True)
class Network:
    """The spring law once more in numpy, and scipy's solver for it: a reference that shares no code with us."""

    positions: np.ndarray
    ends: np.ndarray
    rest: np.ndarray
    k_s: np.ndarray
    k_d: np.ndarray
    masses: np.ndarray
    bending: "BendingReference | None" = None

    def acceleration(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Of the springs [m/s²]."""
        p, q = self.ends.T
        d, u = x[q] - x[p], v[q] - v[p]
        length = np.linalg.norm(d, axis=1)
        n = d / length[:, None]
        f = (self.k_s * (length / self.rest - 1.0) + self.k_d * np.sum(u * n, axis=1) / self.rest)[:, None] * n
        total = np.zeros_like(x)
        np.add.at(total, p, f)
        np.add.at(total, q, -f)
        if self.bending is not None:
            total += self.bending.force(x, v)
        return total / self.masses[:, None]

    def solve(self, gravity, end, pinned, path, velocities=None) -> np.ndarray:
        """Positions and velocities at ``end`` [s], with particles ``pinned`` on ``path(t)``."""
        n = len(self.positions)
        free = np.setdiff1d(np.arange(n), pinned)

        def full(t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            x, v = np.zeros((n, 3)), np.zeros((n, 3))
            x[free], v[free] = y.reshape(2, -1, 3)
            x[pinned] = path(t)
            h = 1e-3  # differences of fourth order
            v[pinned] = (8.0 * (path(t + h) - path(t - h)) - path(t + 2.0 * h) + path(t - 2.0 * h)) / (12.0 * h)
            return x, v

        def rhs(t: float, y: np.ndarray) -> np.ndarray:
            x, v = full(t, y)
            return np.concatenate([v[free].ravel(), (self.acceleration(x, v) + gravity)[free].ravel()])

        start = np.zeros((n, 3)) if velocities is None else np.array(velocities)
        y0 = np.concatenate([self.positions[free].ravel(), start[free].ravel()])
        result = solve_ivp(rhs, (0.0, end), y0, method="DOP853", rtol=3e-14, atol=1e-15)
        return np.stack(full(end, result.y[:, -1]))


PROBLEMS = {f.__name__: f for f in (damped_spring, elastic_pendulum, swinging_cloth)}
