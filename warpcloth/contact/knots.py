"""What a step leaves through each other goes on as one (``kernels/contact_knots.py``)."""

import warp as wp

from ..launching import copy, fill, launch, only_if, repeat_while
from ..model import Model
from ..state import State
from ..surface import Surface
from .clusters import Clusters
from .pair_list import PairList


class Knots:
    """Finds and joins what is through each other.

    Args:
        model: the model.
        surface: all that takes part in contact. pairs: those that are near. clusters: in use within :meth:`join` only.
        width: threads of a kernel that share the list of pairs.

    Attributes:
        crossed: where the passes of the response note that pairs are through each other.
        wary: for how many more intervals knots are joined; int32, shape [world_count].
    """

    def __init__(self, model: Model, surface: Surface, pairs: PairList, clusters: Clusters, width: int):
        self.model, self.surface, self._pairs, self._clusters = model, surface, pairs, clusters
        self._width = width
        self._kernels, device = model.kernels.contact_knots, model.device
        self.crossed = self._kernels.Crossed()
        self.crossed.world, self.wary = (wp.zeros(model.world_count, dtype=wp.int32, device=device) for _ in range(2))
        self.crossed.wary = self.wary
        self.crossed.any, self._united = (wp.zeros(1, dtype=wp.int32, device=device) for _ in range(2))
        self._momentum = wp.zeros((surface.particle_count, 3), dtype=wp.int64, device=device)

    def begin(self) -> None:
        """Before an interval."""
        self._launch(self._kernels.begin_interval, self.model.world_count, [], [self.wary])

    def be_wary(self, held_worlds: wp.array) -> None:
        """After the guard has held back something in worlds with a 1: int32, shape [world_count]."""
        self._launch(self._kernels.be_wary, self.model.world_count, [held_worlds], [self.wary])

    def forget(self) -> None:
        """Before a pass of all worlds."""
        fill(self.crossed.world)
        fill(self.crossed.any)

    def join(self, start: wp.array, now: wp.array, state: State) -> None:
        """Changes ``state``, the end of a step, if the last pass of any world has left pairs through each other.

        Args:
            start, now: positions of the surface when the step began, and at ``state`` [m]; ``now`` is overwritten.
        """
        only_if(self.crossed.any, lambda: self._join(start, now, state))

    def _join(self, start: wp.array, now: wp.array, state: State) -> None:
        self._clusters.part()
        self._find(start, now, state)
        repeat_while(self._united, lambda: self._round(start, now, state))

    def _find(self, start: wp.array, now: wp.array, state: State) -> None:
        copy(now, state.particle_q, count=self.model.particle_count)
        fill(self._united)
        surface, width = self.surface, self._width
        near = [surface.inv_mass, surface.world, self._pairs.pairs, width]
        self._launch(
            self._kernels.find_knots, width,
            [*near, start, now, self.crossed, self._clusters.sums],
            [self._clusters.next_parent, self._united],
        )  # fmt: skip

    def _round(self, start: wp.array, now: wp.array, state: State) -> None:
        """Moves clusters as one; it goes on while they meet others."""
        model, clusters = self.model, self._clusters
        clusters.find(start, now)
        fill(self._momentum)
        masses = [model.particle_inv_mass, state.particle_qd, clusters.sums]
        self._launch(self._kernels.sum_momentum, model.particle_count, masses, [self._momentum])
        self._launch(
            self._kernels.go_as_one, model.particle_count,
            [start, clusters.sums, self._momentum],
            [state.particle_q, state.particle_qd],
        )  # fmt: skip
        self._find(start, now, state)

    def _launch(self, kernel: wp.Kernel, dim: int, inputs: list, outputs: list) -> None:
        launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=self.model.device)
