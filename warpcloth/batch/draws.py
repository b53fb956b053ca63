"""Where samples lie in the space of their parameters: coordinates in [0, 1), and the values that belong to them."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .. import validate
from ..errors import InputError
from .extra import needed
from .schema import MOST_SAMPLES, ParameterTable

FARTHEST_DEVIATION = 4.0  # of a normal distribution [standard deviations]


def coordinates(design: str, count: int, dimensions: int, seed: int) -> np.ndarray:
    """Coordinates of all samples, shape [count, dimensions].

    Random ones and Sobol's do not depend on ``count``: a larger sweep begins with the smaller one.
    """
    if dimensions == 0:
        return np.zeros((count, 0))
    if design in ("random", "grid"):
        return np.random.default_rng([seed, 0]).random((count, dimensions))
    qmc = needed("scipy.stats").qmc
    if design == "sobol":
        return qmc.Sobol(dimensions, rng=np.random.default_rng(seed)).random_base2(max(1, (count - 1).bit_length()))[
            :count
        ]
    return qmc.LatinHypercube(dimensions, rng=np.random.default_rng(seed)).random(count)


def grid_coordinates(parameters: Sequence[ParameterTable], count: int | None, seed: int) -> np.ndarray:
    """Coordinates of every combination of the listed values, the last parameter fastest, over and over up to ``count``.

    Distributions have no list: they are drawn at random for each sample.
    """
    sizes = [len(levels(parameter) or [None]) for parameter in parameters]
    total = math.prod(sizes)
    if count is None and total > MOST_SAMPLES:
        raise InputError(f"The grid has {total:,} samples; give a count, or another design.")
    numbers = np.arange(total if count is None else count)
    result = coordinates("random", len(numbers), len(parameters), seed)
    for axis, parameter in enumerate(parameters):
        if levels(parameter) is not None:
            step = math.prod(sizes[axis + 1 :])
            ends = _bounds(parameter, sizes[axis])
            middles = 0.5 * (ends + np.concatenate([[0.0], ends[:-1]]))
            result[:, axis] = middles[numbers // step % sizes[axis]]
    return result


def levels(parameter: ParameterTable) -> list[Any] | None:
    """The listed values of a parameter; None for a distribution."""
    if parameter.values is not None:
        return parameter.values
    if parameter.range is not None:
        first, last, count = parameter.range
        return [_number(value, parameter.whole) for value in np.linspace(first, last, int(count))]
    return None


def quantile(parameter: ParameterTable) -> Callable[[float], Any]:
    """The value of a parameter at each coordinate in [0, 1): an item of its list, or a quantile of its distribution."""
    listed = levels(parameter)
    if listed is None:
        return lambda u: _number(_drawn(parameter, u), parameter.whole)
    ends = _bounds(parameter, len(listed))
    return lambda u: listed[min(int(np.searchsorted(ends, u, side="right")), len(listed) - 1)]


def _drawn(parameter: ParameterTable, u: float) -> float:
    if parameter.uniform is not None:
        low, high = parameter.uniform
        return low + u * (high - low)
    if parameter.log_uniform is not None:
        low, high = parameter.log_uniform
        return math.exp(math.log(low) + u * math.log(high / low))
    return _normal(parameter.normal, u)


def _bounds(parameter: ParameterTable, count: int) -> np.ndarray:
    """Where each of the listed values ends between 0 and 1, by its weight."""
    weights = np.ones(count) if parameter.weights is None else np.array(parameter.weights)
    return np.cumsum(weights) / weights.sum()


def _normal(shape: tuple[float, float] | None, u: float) -> float:
    """Quantile of the normal distribution, cut off where next to nothing is left."""
    from statistics import NormalDist

    assert shape is not None
    tail = NormalDist().cdf(-FARTHEST_DEVIATION)
    return shape[0] + shape[1] * NormalDist().inv_cdf(tail + u * (1.0 - 2.0 * tail))


def _number(value: float, whole: bool) -> int | float:
    return round(value) if whole else validate.number(float(value), "value of a parameter")
