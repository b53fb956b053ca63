"""Finds the throw that lands a cloth on a target: through flight in air, impact, sliding and coming to rest.

Unknown is the velocity with which all of the cloth leaves the hand. The loss is the squared distance of the cloth's
centre to the target at the end, and a little of the squared speed of the throw, as many throws get there.
"""

from dataclasses import dataclass

import numpy as np

from .. import Air, Cloth, Fabric, Model, Plane, Simulation
from ..gradients import Rollout
from .minimise import minimise

EFFORT = 1e-6  # [s²]: weight of |v|² beside the squared distance


@dataclass(frozen=True)
class Throw:
    """``velocity`` [m/s] of the best throw, its ``miss`` [m], that of the first one, and the number of roll-outs."""

    velocity: np.ndarray
    miss: float
    first_miss: float
    evaluations: int


class Thrower:
    """The cloth, the floor and the target.

    Args:
        target: where on the floor [m], (x, y). frames: of the throw, at 60 per second.
    """

    def __init__(self, target: tuple[float, float], resolution: int = 4, frames: int = 36, substeps: int = 10):
        fabric = Fabric(stretch_stiffness=40.0, shear_stiffness=10.0, thickness=0.01, friction=0.4)
        cloth = Cloth.grid((0.3, 0.3), (resolution, resolution), fabric, transform=(0.0, 0.0, 0.3))
        floor = Plane(friction=0.4)
        model = Model.build([cloth], [floor], precision="float64", differentiable=True)
        self.rollout = Rollout(Simulation(model, substeps=substeps, air=Air()), frames, observe=[frames])
        self.target = np.array(target)

    def landing(self, velocity: np.ndarray) -> np.ndarray:
        """Where the centre of the cloth is at the end, from the target [m], (x, y)."""
        self.rollout.start.particle_qd.assign(np.tile(velocity, (self.rollout.model.particle_count, 1)))
        self.rollout.forward()
        return self.rollout.end.particle_q.numpy().mean(axis=0)[:2] - self.target

    def loss(self, velocity: np.ndarray) -> tuple[float, np.ndarray]:
        """The loss [m²] and its gradient with respect to the velocity of the throw."""
        away = self.landing(velocity)
        count = self.rollout.model.particle_count
        gradients = self.rollout.backward(particle_q=np.tile([*(2.0 * away / count), 0.0], (count, 1)))
        by_velocity = gradients["particle_qd"].numpy().sum(axis=0) + 2.0 * EFFORT * velocity
        return float(away @ away + EFFORT * velocity @ velocity), by_velocity


def throw(target: tuple[float, float] = (1.5, 0.6), most: int = 40, **size: int) -> Throw:
    """From a weak throw straight ahead to one that lands on the target."""
    thrower = Thrower(target, **size)
    first = np.array([1.0, 0.0, 0.5])
    first_miss = float(np.linalg.norm(thrower.landing(first)))
    velocity, evaluations = minimise(thrower.loss, first, most)
    return Throw(velocity, float(np.linalg.norm(thrower.landing(velocity))), first_miss, evaluations)


def main() -> None:
    """Prints the throw."""
    result = throw()
    print(f"thrown with {np.round(result.velocity, 3)} m/s, {1000.0 * result.miss:.2f} mm off the target")
    print(f"the first throw was {1000.0 * result.first_miss:.0f} mm off; {result.evaluations} roll-outs")


if __name__ == "__main__":
    main()
