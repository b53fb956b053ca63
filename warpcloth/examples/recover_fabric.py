"""Recovers k_s, k_d and the bending stiffness of a cloth from how it was seen to move.

A cloth held at one edge is let go, sideways wind in it; its positions after every frame are the observation. Of the
fabric three factors are unknown, by which stiffness, damping and bending differ from a first guess; the logarithms of
these factors are found by quasi-Newton steps on the mean squared distance to what was seen.
"""

from dataclasses import dataclass

import numpy as np

from .. import Air, Cloth, Fabric, Model, Simulation
from ..gradients import Rollout
from .minimise import minimise

NAMES = ("k_s", "k_d", "bending")
FABRIC = Fabric(
    areal_density=0.2, stretch_stiffness=40.0, shear_stiffness=10.0, bending_rigidity=2e-4, bend_stiffness=0.0,
    damping_time=4e-3,
)  # fmt: skip


@dataclass(frozen=True)
class Recovery:
    """What was found: ``factors`` to multiply the first guess by, in the order of :data:`NAMES`, the true ones, and
    the number of roll-outs with gradients.
    """

    factors: np.ndarray
    true_factors: np.ndarray
    evaluations: int

    @property
    def error(self) -> float:
        """The largest relative difference of the three."""
        return float(np.abs(self.factors / self.true_factors - 1.0).max())


class Experiment:
    """The cloth, as a function of three factors on k_s, k_d and bending.

    Args:
        resolution: vertices along an edge. frames: observed, at 60 per second. substeps: per frame.
    """

    def __init__(self, resolution: int = 6, frames: int = 12, substeps: int = 16):
        cloth = Cloth.grid((0.5, 0.5), (resolution, resolution), FABRIC, "left", (0.0, 0.0, 1.0))
        model = Model.build([cloth], precision="float64", differentiable=True)
        simulation = Simulation(model, substeps=substeps, air=Air(wind=(0.0, 3.0, 0.0)))
        self.rollout = Rollout(simulation, frames)
        parameters = self.rollout.parameters
        self._first = {name: parameters[name].numpy().copy() for name in ("spring_stiffness", "spring_damping")}
        self._bending = parameters["bend_law"].numpy().copy()

    def motion(self, factors: np.ndarray) -> np.ndarray:
        """Positions after each frame [m], shape [frames, particle_count, 3]."""
        parameters = self.rollout.parameters
        for factor, (name, values) in zip(factors, self._first.items(), strict=False):
            parameters[name].assign(factor * values)
        parameters["bend_law"].assign(self._bending * [factors[2], factors[2], 1.0])
        return np.stack([state.particle_q.numpy().copy() for state in self.rollout.forward()])

    def misfit(self, logarithms: np.ndarray, seen: np.ndarray) -> tuple[float, np.ndarray]:
        """Mean squared distance [mm²] to ``seen``, and its gradient with respect to the logarithms of the factors."""
        away = self.motion(np.exp(logarithms)) - seen
        scale = 1e6 / (seen.shape[0] * seen.shape[1])
        for state, difference in zip(self.rollout.states, away, strict=True):
            state.particle_q.grad.assign(2.0 * scale * difference)
            state.particle_qd.grad.zero_()
        gradients = self.rollout.backward()
        parameters = self.rollout.parameters
        names = [*self._first, "bend_law"]
        products = [gradients[name].numpy() * parameters[name].numpy() for name in names]
        products[2] = products[2][:, :2]  # the rest curvature stays
        return scale * float((away**2).sum()), np.array([product.sum() for product in products])


def recover(
    true_factors: tuple[float, float, float] = (3.0, 1.0 / 3.0, 1.0 / 3.0), most: int = 60, **size: int
) -> Recovery:
    """Sees the motion with ``true_factors``, forgets them, and finds them again from the motion, from 1, 1, 1."""
    experiment = Experiment(**size)
    seen = experiment.motion(np.array(true_factors))
    found, evaluations = minimise(lambda p: experiment.misfit(p, seen), np.zeros(3), most)
    return Recovery(np.exp(found), np.array(true_factors), evaluations)


def main() -> None:
    """Prints what was found."""
    result = recover()
    for name, factor, truth in zip(NAMES, result.factors, result.true_factors, strict=True):
        print(f"{name:8s} first guess × {factor:.5f}, truth × {truth:.5f}")
    print(f"off by {100.0 * result.error:.3f} % after {result.evaluations} roll-outs")


if __name__ == "__main__":
    main()
