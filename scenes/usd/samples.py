"""Arrays of vectors on their way into a stage and out of it."""

from typing import Any

import numpy as np
from pxr import Vt

from ...errors import UsdError

SAMPLE_OVERHEAD = 256  # bytes that one sample holds in memory besides its array, rounded up


def checked(values: np.ndarray, count: int, name: str, what: str) -> np.ndarray:
    """``values`` as stored, after a check that OpenUSD does not make: it takes any shape as a flat list.

    Raises:
        UsdError: when they are not ``count`` vectors.
    """
    array = np.asarray(values)
    if array.shape != (count, 3):
        raise UsdError(f"'{name}' needs {what} of shape ({count}, 3), got {array.shape}.")
    with np.errstate(over="ignore"):  # becomes infinite, which is the caller's to notice
        return np.ascontiguousarray(array, np.float32)


def vectors(array: np.ndarray) -> Vt.Vec3fArray:
    """An array of shape [n, 3] as OpenUSD holds it."""
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(array, np.float32))


def integers(array: np.ndarray) -> Vt.IntArray:
    """The elements of an array in row order."""
    return Vt.IntArray.FromNumpy(np.ascontiguousarray(array, np.int32).ravel())


def as_vectors(value: Any) -> np.ndarray:
    """A value as float64 of shape [n, 3]; empty if it holds anything but vectors."""
    array = np.array([] if value is None else value)
    fits = array.ndim == 2 and array.shape[1] == 3 and np.issubdtype(array.dtype, np.number)
    return array.astype(float) if fits else np.zeros((0, 3))
