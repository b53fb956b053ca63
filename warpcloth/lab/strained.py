"""Flat specimens held at their border in a deformed shape, at rest, and the forces that it takes."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..cloth import Cloth, Pin
from ..model import Model
from ..simulation import Simulation
from .settle import settle
from .setup import Setup

Deformation = Callable[[np.ndarray], np.ndarray]  # of points [m], shape [n, 3]


@dataclass(frozen=True, eq=False)
class Strained:
    """A specimen at rest.

    Attributes:
        positions: [m], shape [n, 3]. forces: of the specimen on each vertex [N], shape [n, 3]; what holds it balances
            those on the held ones. energy: elastic [J]. settled: whether it came to rest.
    """

    positions: np.ndarray
    forces: np.ndarray
    energy: float
    settled: bool


def strained(cloth: Cloth, held: np.ndarray, deformation: Deformation, setup: Setup, length: float) -> Strained:
    """The specimen with the vertices ``held`` where ``deformation`` takes them, the others in equilibrium there.

    Without gravity; all vertices start where the deformation takes them, and the springs keep their rest lengths.

    Args:
        length: of the specimen [m].
    """
    pins = (Pin(np.asarray(held, np.int32)),)
    model = Model.build(replace(cloth, points=deformation(cloth.points), pins=pins), precision="float64")
    free = len(held) < len(cloth.points)
    still = (0.0, 0.0, 0.0)
    rest = settle(model, setup, length, gravity=still) if free else None
    probe = Simulation(model, gravity=still, contact="none")
    if rest is not None:
        probe.state.particle_q.assign(rest.positions)
    probe.forces.evaluate(probe.state)
    positions, forces = probe.state.particle_q.numpy(), probe.state.particle_f.numpy()
    settled = rest is None or rest.settled
    return Strained(positions, forces, probe.energy()["total"], settled)


def gradient(rest: np.ndarray, positions: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Deformation gradient in the xy plane, shape [2, 2], of the vertices ``inside``: what an extensometer shows."""
    x, y = rest[inside, :2], positions[inside, :2]
    fitted, *_ = np.linalg.lstsq(x - x.mean(axis=0), y - y.mean(axis=0), rcond=None)
    return np.asarray(fitted.T)
