"""Bending forces smoothed so that they do not limit an explicit step; see ``kernels/bending_filter.py``."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from ..forces import Bending, Forces
from ..launching import fill, launch
from ..model import Model
from ..stability import bending_rates
from ..state import State

MARGIN = 1.0 + 1e-4  # the device counts stages with its own rounding; one that no world needs does nothing
# Strips of denim, 80 × 26 vertices, clamped at one end, came to rest with up to 13 stages a step. With 19 they went on
# trembling at 3 mm/s, with 23 at 7 cm/s. Most of the work is then in the stages, and longer steps would gain little.
MOST_STAGES = 13


class BendingFilter:
    """The filter for a model that bends, as it is when this is built.

    Args:
        model: the model; not a differentiable one.
    """

    def __init__(self, model: Model):
        self._model = model
        self._rates = bending_rates(model)
        self._world_rates = model.array(self._rates, model.kernels.precision.vec2)
        self._stages = wp.zeros(model.world_count, dtype=wp.int32, device=model.device)

    def stages(self, dt: float) -> int:
        """How many a step of dt [s] takes in the world that needs most; 1: it is stable as it is."""
        z = float((dt * (dt * self._rates[:, 0] + 2.0 * self._rates[:, 1])).max())
        needed = math.ceil(0.5 * (math.sqrt(1.0 + 4.0 * MARGIN * z) - 1.0))
        return min(max(needed, 1), self._model.kernels.bending_filter.LONGEST) | 1

    def longest_step(self) -> float:
        """The longest step [s] with no more than :data:`MOST_STAGES` stages."""
        z = MOST_STAGES * (MOST_STAGES + 1) / MARGIN
        stiff, damped = self._rates.T
        most = damped + np.sqrt(damped**2 + stiff * z)
        return float((z / most[most > 0.0]).min(initial=math.inf))

    def accumulate(self, state: State, forces: Forces, dt: float, scratch: Sequence[wp.array]) -> None:
        """Adds the force of bending [N], if it is among the forces, to ``state.particle_f``, smoothed for a step of
        dt [s].

        Overwrites the four arrays of ``scratch``, vec3, shape [particle_count].
        """
        bending = next((term for term in forces.terms if isinstance(term, Bending)), None)
        if bending is None:
            return
        kernels, most = self._model.kernels.bending_filter, self.stages(dt)
        force, before, now, product = scratch
        fill(force)
        bending.accumulate(State(state.particle_q, state.particle_qd, force, state.world_time), 0.0)
        launch(
            kernels.count_stages,
            dim=self._model.world_count,
            inputs=[self._world_rates, dt],
            outputs=[self._stages],
            device=self._model.device,
        )
        self._launch(kernels.begin, [force], [before, now, product])
        for stage in range(2, most + 1):
            bending.resist(now, dt, product)
            self._launch(kernels.improve, [force, now, stage], [before, product])
            before, now = now, before
        self._launch(kernels.end, [force, now], [state.particle_f])

    def _launch(self, kernel: wp.Kernel, inputs: list[Any], outputs: list[wp.array]) -> None:
        """One thread per particle."""
        model = self._model
        whose = [model.particle_inv_mass, model.particle_world, self._stages]
        launch(kernel, model.particle_count, [*whose, *inputs], outputs, model.device)
