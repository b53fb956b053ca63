"""The springs of a model in the order in which the CPU sums their forces; see ``kernels/spring_rows.py``."""

import numpy as np
import warp as wp

from ..launching import launch
from ..model import Model
from ..state import State


class SpringRows:
    """Rows of springs, and copies of their properties that :meth:`arrange` brings up to date.

    Args:
        model: the model. springs: which of its springs, int. ranges: into how many equal ranges of particles launches
            are cut.
    """

    def __init__(self, model: Model, springs: np.ndarray, ranges: int):
        self.model = model
        count = model.particle_count
        ends = np.sort(model.spring_indices.numpy().reshape(-1, 2)[springs], axis=1)
        order = np.lexsort((ends[:, 1], ends[:, 0]))
        first, other = ends[order].T
        bounds = np.array([count * k // ranges for k in range(ranges + 1)])
        beyond = np.searchsorted(bounds, first, "right") != np.searchsorted(bounds, other, "right")
        self._start = model.array(np.searchsorted(first, np.arange(count + 1)), wp.int32)
        again = np.flatnonzero(beyond)
        again = again[np.argsort(other[again], kind="stable")]
        receivers, begins = np.unique(other[again], return_index=True)
        self._receiver = model.array(receivers, wp.int32)
        self._receiver_start = model.array(len(order) + np.array([*begins, len(again)]), wp.int32)
        self._other = model.array(np.concatenate([np.where(beyond, -1 - other, other), first[again]]), wp.int32)
        self._spring = model.array(springs[np.concatenate([order, order[again]])], wp.int32)
        self._law = wp.zeros(len(order) + len(again), dtype=model.vec3, device=model.device)
        self.arrange()

    def arrange(self) -> None:
        """Takes over stiffness, damping and rest lengths of the model's springs, should they have changed."""
        model = self.model
        launch(
            model.kernels.springs.arrange_law,
            dim=len(self._spring),
            inputs=[self._spring, model.spring_rest_length, model.spring_stiffness, model.spring_damping],
            outputs=[self._law],
            device=model.device,
        )

    def accumulate(self, state: State) -> None:
        """Adds spring forces [N] to ``state.particle_f``."""
        kernels, device = self.model.kernels.spring_rows, self.model.device
        where = [state.particle_q, state.particle_qd]
        if len(self._receiver) > 0:
            launch(
                kernels.receive,
                dim=len(self._receiver),
                inputs=[self._receiver, self._receiver_start, self._other, self._law, *where],
                outputs=[state.particle_f],
                device=device,
            )
        launch(
            kernels.pull_rows,
            dim=self.model.particle_count,
            inputs=[self._start, self._other, self._law, *where],
            outputs=[state.particle_f],
            device=device,
        )
