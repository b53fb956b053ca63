"""The test problems, from one spring to cloth on a sphere. A new one is a function and a line in :data:`PROBLEMS`."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcloth import Air, Cloth, Fabric, Model, Simulation, Sphere

G = 9.81  # [m/s²]
Solution = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Problem:
    """An initial value problem.

    Attributes:
        name, title: for programs and for people.
        build: a new float64 model; its argument says whether the springs are damped.
        end: time at which errors are measured [s].
        first_step: coarsest step that is tried [s].
        gravity: acceleration [m/s²].
        contact: what the cloth collides with, as :class:`~warpcloth.Simulation` takes it; not smooth unless "none".
        air: what it moves through; None: a vacuum.
        exact: positions [m] and velocities [m/s] at ``end``, shape [particle_count, 3], where known in closed form.
        drift_end, drift_step: duration and step of the long undamped run [s]; 0: no such run.
        energy_scale: energy that drift is compared with [J].
    """

    name: str
    title: str
    build: Callable[[bool], Model]
    end: float
    first_step: float
    gravity: tuple[float, float, float] = (0.0, 0.0, -G)
    contact: str = "none"
    air: Air | None = None
    exact: Callable[[], Solution] | None = None
    drift_end: float = 0.0
    drift_step: float = 0.0
    energy_scale: float = 1.0

    def simulation(self, integrator: str, substeps: int | str, options: dict | None = None, **rest: Any) -> Simulation:
        """A simulation of it from the start."""
        model = self.build(True)
        settings = {"gravity": self.gravity, "contact": self.contact, "air": self.air, "check": False, **rest}
        return Simulation(model, integrator, substeps=substeps, integrator_options=options, **settings)


def oscillator() -> Problem:
    """One damped spring under gravity along it: m = 0.05 kg, k_s = 20 N, k_d = 0.05 N s, r = 0.25 m (ω = 40/s)."""
    mass, k_s, k_d, rest, start, end = 0.05, 20.0, 0.05, 0.25, 0.30, 0.6

    def build(damped: bool) -> Model:
        points = [[0, 0, 0], [0, 0, -start]]
        return Model.from_springs(
            points, [1.0, mass], [[0, 1]], rest, k_s, k_d * damped, [0], precision="float64", device="cpu"
        )

    def exact() -> Solution:
        omega, zeta = math.sqrt(k_s / (mass * rest)), k_d / (2.0 * math.sqrt(k_s * mass * rest))
        decay, frequency = zeta * omega, omega * math.sqrt(1.0 - zeta * zeta)
        still = rest * (1.0 + mass * G / k_s)
        a, b = start - still, (start - still) * decay / frequency
        c, s, e = math.cos(frequency * end), math.sin(frequency * end), math.exp(-decay * end)
        x = still + e * (a * c + b * s)
        v = e * ((b * frequency - decay * a) * c - (a * frequency + decay * b) * s)
        return np.array([[0, 0, 0], [0, 0, -x]]), np.array([[0, 0, 0], [0, 0, -v]])

    return Problem(
        "oscillator", "Damped oscillator", build, end, end / 15, exact=exact,
        drift_end=30.0, drift_step=0.005, energy_scale=0.5 * k_s / rest * (start - rest) ** 2,
    )  # fmt: skip


def elastic_pendulum() -> Problem:
    """A mass on an elastic string released at rest from the horizontal: m = 0.1 kg, k_s = 200 N, r = 1 m; nonlinear."""

    def build(damped: bool) -> Model:
        return Model.from_springs(
            [[0, 0, 0], [1, 0, 0]], [1.0, 0.1], [[0, 1]], 1.0, 200.0, 0.0, [0], precision="float64", device="cpu"
        )

    return Problem(
        "elastic_pendulum", "Elastic pendulum", build, 2.0, 1 / 30,
        drift_end=60.0, drift_step=0.01, energy_scale=0.1 * G,
    )  # fmt: skip


def hanging_chain(count: int = 20) -> Problem:
    """A chain of 1 m, 0.1 kg and k_s = 50 N, hung by one end, let go straight at 45°."""

    def build(damped: bool) -> Model:
        along = np.linspace(0.0, 1.0, count + 1)[:, None] * np.array([1.0, 0.0, -1.0]) / math.sqrt(2.0)
        masses = np.full(count + 1, 0.1 / count)
        masses[-1] *= 0.5
        springs = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
        laws = (springs, 1.0 / count, 50.0, 0.01 * damped)
        return Model.from_springs(along, masses, *laws, [0], precision="float64", device="cpu")

    return Problem("hanging_chain", f"Swinging chain of {count} springs", build, 1.0, 1 / 60)


def _cloth(cloth: Cloth, *obstacles: Sphere) -> Model:
    return Model.build(cloth, obstacles, precision="float64", device="cpu")


def _swinging(fabric: dict, count: int) -> Callable[[bool], Model]:
    def build(damped: bool) -> Model:
        sheet = Fabric(**fabric, damping_time=5e-4 * damped)
        return _cloth(Cloth.grid((1.0, 1.0), (count, count), sheet, "left"))

    return build


def swinging_cloth(count: int = 17) -> Problem:
    """Cotton of 1 m × 1 m let go horizontally with one edge held."""
    return Problem(
        "swinging_cloth", f"Swinging cloth, {count} × {count}", _swinging({}, count), 0.5, 1 / 60,
        drift_end=3.0, drift_step=5e-4, energy_scale=0.2 * G * 0.5,
    )  # fmt: skip


def stiff_cloth(count: int = 17) -> Problem:
    """The same of a fabric 50 times as stiff in the sheet: explicit schemes need steps below 0.1 ms."""
    stiff = {"name": "stiff", "stretch_stiffness": 2e4, "shear_stiffness": 4e3}
    return Problem("stiff_cloth", f"Stiff cloth, {count} × {count}", _swinging(stiff, count), 0.25, 1 / 60)


def drape_on_sphere(count: int = 17) -> Problem:
    """Cotton of 0.6 m × 0.6 m, laid on a sphere of radius 0.15 m, begins to drape; with friction.

    Contact and folds amplify differences a hundredfold within 0.2 s more, so there is no truth to compare with later.
    """

    def build(damped: bool) -> Model:
        cloth = Cloth.grid((0.6, 0.6), (count, count), Fabric(damping_time=5e-4 * damped), transform=(0, 0, 0.155))
        return _cloth(cloth, Sphere((0, 0, 0), 0.15))

    return Problem("drape_on_sphere", f"Drape on a sphere, {count} × {count}", build, 0.25, 1 / 60, contact="obstacles")


PROBLEMS: dict[str, Callable[[], Problem]] = {
    make.__name__: make
    for make in (oscillator, elastic_pendulum, hanging_chain, swinging_cloth, stiff_cloth, drape_on_sphere)
}
