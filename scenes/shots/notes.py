"""What warpcloth notes in a stage besides what standards have words for.

Standards keep single precision, and have no words for easing or for air. So an exported stage has both: what other
tools read, and a note with the exact value. Whoever edits the stage edits the former; a note therefore counts only as
long as it says the same, but for rounding.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pxr import Sdf, Usd, Vt

NOTES = "warpcloth"
ROUNDING = 1e-5  # relative


def note(prim: Usd.Prim, name: str, value: Any, kind: Sdf.ValueTypeName) -> None:
    """Authors the custom attribute ``warpcloth:name``; None is not authored."""
    if value is not None:
        prim.CreateAttribute(f"{NOTES}:{name}", kind, custom=True).Set(value)


def noted(prim: Usd.Prim, name: str) -> Any:
    """The value of ``warpcloth:name``, or None."""
    attribute = prim.GetAttribute(f"{NOTES}:{name}")
    return attribute.Get() if attribute and attribute.HasAuthoredValue() else None


def doubles(array: Any) -> Vt.DoubleArray:
    """Numbers as a stage holds them."""
    return Vt.DoubleArray(np.asarray(array, float).ravel().tolist())


def double_vectors(array: Any) -> Vt.Vec3dArray:
    """Vectors as a stage holds them, of an array of shape [n, 3]."""
    return Vt.Vec3dArray.FromNumpy(np.ascontiguousarray(array, np.float64).reshape(-1, 3))


def agree(exact: Any, rounded: Any) -> Any:
    """``exact``, unless it is None or not the same as ``rounded`` but for rounding."""
    return exact if exact is not None and same(exact, rounded) else rounded


def same(exact: Any, rounded: Any) -> bool:
    """Whether two numbers or vectors differ by no more than rounding."""
    a, b = np.asarray(exact, float), np.asarray(rounded, float)
    return a.shape == b.shape and bool(np.abs(a - b).max(initial=0.0) <= ROUNDING * np.abs(a).max(initial=0.0))


def plain(value: Any) -> Any:
    """Metadata as Python's own types."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    return list(value) if isinstance(value, Vt.DoubleArray | Vt.StringArray | Vt.IntArray) else value
