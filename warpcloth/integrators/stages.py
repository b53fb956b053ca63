"""Scratch memory and the one update (``kernels/explicit_step.py``) of all explicit schemes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from ..model import Model
from ..state import State

NO_WEIGHTS = np.zeros(0)


class Stages:
    """Forces of the stages of a step, and one scratch state to evaluate them at. Allocated once.

    Args:
        model: the model.
        count: stages of the scheme. The force of the first one stays in ``particle_f`` of the state it belongs to.
        kept: each stage has positions and velocities of its own, and all arrays have gradients.
    """

    def __init__(self, model: Model, count: int, *, kept: bool = False):
        self.count = count
        further = max(count - 1, 1)
        wide: dict[str, Any] = {"dtype": model.vec3, "device": model.device, "requires_grad": kept}
        self.forces = wp.zeros((further, model.particle_count), **wide)
        own = further if kept else 1
        q, qd = (wp.zeros((own, model.particle_count), **wide) for _ in range(2))
        self._rows = [(q[j % own], qd[j % own], self.forces[j]) for j in range(further)]

    def scratch(self, stage: int, clock: wp.array) -> State:
        """The scratch state, whose force is that of ``stage`` ≥ 1."""
        return State(*self._rows[stage - 1], clock)

    def at(self, stage: int, state: State) -> State:
        """Positions and velocities of ``state``, with the force of ``stage`` ≥ 1."""
        return State(state.particle_q, state.particle_qd, self._rows[stage - 1][2], state.world_time)


def advance(
    model: Model,
    start: State,
    first_force: wp.array,
    stages: Stages,
    out: State,
    drift: float,
    velocity_weights: Sequence[float] | np.ndarray = NO_WEIGHTS,
    position_weights: Sequence[float] | np.ndarray = NO_WEIGHTS,
) -> None:
    """x ← x + drift v + (1/m) Σ p_j f_j and v ← v + (1/m) Σ w_j f_j, from ``start`` to ``out`` (may be the same).

    Args:
        first_force: f_0 [N], shape [particle_count]; the others are those of ``stages``.
        drift: [s]. velocity_weights: w [s]. position_weights: p [s²]; missing ones are 0.
    """
    weights = model.kernels.explicit_step.weights
    model.launch_particles(
        "explicit_step",
        "advance",
        [
            model.particle_inv_mass, start.particle_q, start.particle_qd, first_force, stages.forces,
            max(len(velocity_weights), len(position_weights), 1) - 1, drift,
            weights(*padded(position_weights)), weights(*padded(velocity_weights)),
        ],
        [out.particle_q, out.particle_qd],
    )  # fmt: skip


def padded(values: Sequence[float] | np.ndarray) -> list[float]:
    """Eight weights, the missing ones 0."""
    return [*map(float, values), *[0.0] * (8 - len(values))]
