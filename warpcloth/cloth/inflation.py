"""Pressure inside closed cloth."""

from dataclasses import dataclass

import numpy as np

from .. import validate
from ..errors import InputError
from ..meshes.topology import EdgeTable, oriented

STANDARD_ATMOSPHERE = 101325.0  # [Pa]


@dataclass(frozen=True)
class Inflation:
    """What is inside a closed cloth.

    Args:
        pressure: over that outside, at the rest pose [Pa]; negative where it sucks.
        gas: whether a fixed amount of gas is shut in, whose pressure falls as the volume grows (p V = const); if not,
            the pressure stays as it is given.
        ambient: pressure outside [Pa], > 0; only a gas asks for it.

    Raises:
        InputError: on a value out of range.
    """

    pressure: float
    gas: bool = False
    ambient: float = STANDARD_ATMOSPHERE

    def __post_init__(self):
        object.__setattr__(self, "ambient", validate.number(self.ambient, "inflation: ambient", above=0.0))
        object.__setattr__(self, "gas", validate.flag(self.gas, "inflation: gas"))
        lowest = -self.ambient if self.gas else None
        object.__setattr__(self, "pressure", validate.number(self.pressure, "inflation: pressure", minimum=lowest))


def enclosed_volume(points: np.ndarray, triangles: np.ndarray) -> float:
    """Volume [m³] inside a closed surface, negative where its triangles face inward."""
    a, b, c = (points[triangles[:, i]] - points.mean(axis=0) for i in range(3))
    return float(np.einsum("ti,ti->", a, np.cross(b, c)) / 6.0)


def check_closed(points: np.ndarray, triangles: np.ndarray, label: str) -> None:
    """Refuses a surface that cannot hold pressure.

    Raises:
        InputError: it has a border, neighbours do not agree on the outside, or there is no room in it.
    """
    title, table = validate.sentence(label), EdgeTable.of(triangles)
    if not table.is_closed:
        count = int(np.count_nonzero(table.counts != 2))
        raise InputError(f"{title}: inflation needs a closed surface, and this one has {count} edges on a border.")
    if not np.array_equal(oriented(triangles, table, label), triangles):
        raise InputError(f"{title}: inflation needs triangles that agree on which side is outside.")
    size = float(np.ptp(points, axis=0).max())
    if abs(enclosed_volume(points, triangles)) < 1e-6 * size**3:
        raise InputError(f"{title}: inflation needs a surface with room in it at rest.")
