"""Particles that go on as one (``kernels/contact_clusters.py``)."""

import warp as wp

from ..launching import copy, fill, launch
from ..model import Model
from ..surface import Surface


class Clusters:
    """Clusters of the particles of a surface.

    Attributes:
        sums: of each cluster, and which one each particle belongs to.
        next_parent: where kernels unite clusters; :meth:`find` takes it over. int32, shape [particle_count].
    """

    def __init__(self, model: Model, surface: Surface):
        self.model, self.surface, self._kernels = model, surface, model.kernels.contact_clusters
        n, device = surface.particle_count, model.device
        self._parent, self.next_parent = (wp.zeros(n, dtype=wp.int32, device=device) for _ in range(2))
        self.sums = self._kernels.Clusters()
        self.sums.root, self.sums.size = (wp.zeros(n, dtype=wp.int32, device=device) for _ in range(2))
        self.sums.mass = wp.zeros(n, dtype=wp.int64, device=device)
        self.sums.way = wp.zeros((n, 3), dtype=wp.int64, device=device)

    def part(self) -> None:
        """Each particle is a cluster of its own."""
        count, device = self.surface.particle_count, self.model.device
        launch(self._kernels.part_clusters, count, [], [self.next_parent, self.sums.root], device)

    def find(self, start: wp.array, end: wp.array) -> None:
        """All that was united is one cluster now, which goes by the mean of its particles' ways from start to end."""
        copy(self._parent, self.next_parent)
        for sums in (self.sums.size, self.sums.mass, self.sums.way):
            fill(sums)
        inputs = [self.surface.inv_mass, start, end, self._parent]
        launch(self._kernels.find_clusters, self.surface.particle_count, inputs, [self.sums], self.model.device)
