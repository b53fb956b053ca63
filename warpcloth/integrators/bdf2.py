"""The second backward differentiation formula: an implicit stage that starts from the last two states."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from ..forces import Forces
from ..launching import copy, fill, launch, only_if
from ..model import Model
from ..state import Memory, State
from .implicit import ImplicitEuler, ImplicitScheme, Stage


class Bdf2(ImplicitScheme):
    """y′ = (4 y − y₋₁ + 2 dt ẏ′)/3 for positions and velocities.

    The state before is remembered on the device, with the step of each world: a first step, and one of another size
    than the last, start afresh, with a past that makes of it a step of implicit Euler. Between steps contact may change
    the state: the remembered one is changed with it.
    """

    name = "bdf2"
    order = 2
    stage = Stage(gamma=2.0 / 3.0, past=1.0 / 3.0)
    reference = "Hairer, Wanner, Solving Ordinary Differential Equations II (1996), V.1; Choi and Ko, SIGGRAPH 2002"
    cost = "a few Newton iterations, each of tens to hundreds of matrix products"
    use = "stiff cloth that should keep moving: damps high frequencies like implicit Euler, slow motion hardly"

    def _allocate(self, model: Model) -> None:
        self._past, self._end, self._first = (State.of(model) for _ in range(3))
        self._wanted = wp.zeros(1, dtype=wp.int32, device=model.device)
        self._past_dt = wp.zeros(model.world_count, dtype=wp.float64, device=model.device)

    def step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """One step; see :class:`~warpcloth.integrators.base.Integrator`."""
        fill(self._wanted)
        asked = model.kernels.implicit_schemes.ask_for_start
        launch(asked, model.world_count, [self._past_dt, dt], [self._wanted], device=model.device)
        only_if(self._wanted, lambda: self._step_first(model, state_in, forces, dt))
        self._recall(model, state_in, dt)
        self._start(model, state_in, state_out, self._past, dt)
        gamma, time = self.stage.gamma * dt, self.stage.time * dt
        self.newton.solve(state_out, forces, gamma, time, changes=self.changes[0])
        self._remember(model, state_in, state_out, dt)

    def reset(self) -> None:
        """Forgets the state before: the next step starts afresh."""
        fill(self._past_dt)

    def memory(self) -> Sequence[Memory]:
        """The two states before and the step between them."""
        own = np.arange(len(self._past.particle_q))
        states = [array for state in (self._past, self._end) for array in (state.particle_q, state.particle_qd)]
        return [*super().memory(), *(Memory(array, own) for array in states), Memory(self._past_dt, None)]

    def _step_first(self, model: Model, state_in: State, forces: Forces, dt: float) -> None:
        """A step of implicit Euler from ``state_in`` to ``self._first``."""
        copy(self._first.world_time, state_in.world_time)
        self._start(model, state_in, self._first, state_in, dt, ImplicitEuler.stage)
        self.newton.solve(self._first, forces, dt, dt)

    def _recall(self, model: Model, state: State, dt: float) -> None:
        launch(
            model.kernels.implicit_schemes.recall,
            dim=model.particle_count,
            inputs=[
                model.particle_world, state.particle_q, state.particle_qd, self._end.particle_q,
                self._end.particle_qd, self._first.particle_qd, self._past_dt, dt,
            ],
            outputs=[self._past.particle_q, self._past.particle_qd],
            device=model.device,
        )  # fmt: skip

    def _remember(self, model: Model, state_in: State, state_out: State, dt: float) -> None:
        past, end = self._past, self._end
        launch(
            model.kernels.implicit_schemes.remember,
            dim=model.particle_count,
            inputs=[
                model.particle_world, state_in.particle_q, state_in.particle_qd, state_out.particle_q,
                state_out.particle_qd, dt,
            ],
            outputs=[past.particle_q, past.particle_qd, end.particle_q, end.particle_qd, self._past_dt],
            device=model.device,
        )  # fmt: skip
