"""Arguments of the cloth constructors, checked."""

import operator
from typing import Any

import numpy as np

from .. import validate
from ..errors import InputError
from ..fabric import Fabric
from ..transforms import as_matrix

MAX_VERTICES = 1 << 24
SHORTEST = 1e-6  # [m]: smaller cloth has no digits left in float32


def checked_fabric(fabric: Fabric | None, label: str) -> Fabric:
    """The fabric, or the default one for None."""
    if fabric is not None:
        require(fabric, Fabric, f"{label}: fabric")
    return fabric or Fabric()


def require(value: Any, kind: type, what: str) -> None:
    """Refuses a value of another type than ``kind``."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise InputError(f"{validate.sentence(what)} must be {article} {kind.__name__}, got {type(value).__name__}.")


def rigid_matrix(transform: Any, label: str) -> np.ndarray:
    """A 4 × 4 matrix from a transform that neither scales nor mirrors."""
    matrix = as_matrix(transform, f"{label}: transform")
    turn = matrix[:3, :3]
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) or np.linalg.det(turn) < 0.0:
        raise InputError(
            f"{validate.sentence(label)}: transform must only turn and move; change the size instead of scaling."
        )
    return matrix


def grid_resolution(resolution: Any, label: str) -> tuple[int, int]:
    """Vertices along x and along y, at least 2 each, not too many together."""
    nx, ny = pair(resolution, f"{label}: resolution must be (vertices along x, vertices along y)")
    try:
        counts = [operator.index(n) for n in (nx, ny)]
    except TypeError:
        got = validate.shown(resolution)
        raise InputError(f"{validate.sentence(label)}: resolution must be two whole numbers, got {got}.") from None
    if min(counts) < 2:
        got = f"({counts[0]}, {counts[1]})"
        raise InputError(f"{validate.sentence(label)}: resolution must be at least 2 × 2 vertices, got {got}.")
    if counts[0] * counts[1] > MAX_VERTICES:
        total = f"{counts[0]} × {counts[1]} = {counts[0] * counts[1]:,}"
        raise InputError(
            f"{validate.sentence(label)}: resolution must be at most {MAX_VERTICES:,} vertices, got {total}."
        )
    return counts[0], counts[1]


def pair(value: Any, rule: str) -> tuple[Any, Any]:
    """Two items; ``rule`` is the sentence that is said otherwise."""
    sized = isinstance(value, tuple | list) or (isinstance(value, np.ndarray) and value.ndim == 1)
    items = list(value) if sized else []
    if len(items) != 2:
        raise InputError(f"{validate.sentence(rule)}, got {validate.shown(value)}.")
    return items[0], items[1]


def grid_size(size: Any, label: str) -> tuple[float, float]:
    """Width and height [m]."""
    width, height = pair(size, f"{label}: size must be (width, height)")
    return _length(width, f"{label}: width"), _length(height, f"{label}: height")


def disc_radius(radius: Any, label: str) -> float:
    """A radius [m]."""
    return _length(radius, f"{label}: radius")


def cloth_label(name: Any) -> str:
    """How messages call a cloth."""
    return f"cloth '{validate.text(name, 'cloth: name')}'"


def _length(value: Any, what: str) -> float:
    length = validate.number(value, what, above=0.0)
    if length < SHORTEST:
        raise InputError(f"{validate.sentence(what)} must be at least {SHORTEST:g} m, got {value!r}.")
    return length
