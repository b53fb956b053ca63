"""Copies of what the springs of a model have, in the order in which a scheme takes them."""

import numpy as np
import warp as wp

from ..launching import launch
from ..model import Model
from ..watch import Watch


class SpringProperties:
    """Three properties of each spring.

    Args:
        model: the model. order: numbers of its springs, int; each may come several times.
        names: of the model's arrays, as in :class:`~warpcloth.Model`.

    Attributes:
        values: vec3, shape [len(order)].
    """

    def __init__(self, model: Model, order: np.ndarray, names: tuple[str, str, str]):
        self._model, self._names = model, names
        self._order = model.array(order, wp.int32)
        self.values = wp.zeros(len(order), dtype=model.vec3, device=model.device)
        self._watch = Watch(model, *names)
        self._read()

    def read(self) -> None:
        """Takes over what the model has now, should it have changed."""
        self._watch.if_changed(self._read)

    def _read(self) -> None:
        model = self._model
        inputs = [self._order, *(getattr(model, name) for name in self._names)]
        launch(model.kernels.springs.take_properties, len(self._order), inputs, [self.values], model.device)
