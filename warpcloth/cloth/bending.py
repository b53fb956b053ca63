"""Bending elements: linear measures of curvature, each a weighted sum of a few particles' positions.

The curvature vector d = Σ w_i x_i [1/m] of an element stands for a second derivative of the surface, x_uu, x_vv or
x_uv, over the area A that the element owns. Cloth hardly stretches, so |d| is the curvature itself (Bergou et al., A
Quadratic Bending Model for Inextensible Surfaces, 2006), and ½ B A |d|² its bending energy. Two more sums over the same
particles, t₁ = Σ α_i x_i and t₂ = Σ β_i x_i, are the surface's tangents: their product tells the front from the back,
which rest curvature and hysteresis need. The law itself is in ``kernels/bending_law.py``.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .. import validate
from ..errors import InputError
from ..validate import Array, ReadOnly

SLIP_CURVATURE = 10.0  # [1/m] over which friction grows to its full moment; a bending test goes to 250/m
FLAT = 1e-5  # curvature times size of an element below which its rest shape counts as flat


@dataclass(frozen=True, eq=False)
class BendingElements(ReadOnly):
    """Bending elements over the particles of a cloth: e elements with m entries in all.

    Args:
        start: entries of element k are ``start[k]:start[k + 1]``, shape [e + 1], int32.
        particles: of each entry, shape [m], int32.
        weights: w [1/m²], α and β [1/m] of each entry, shape [m, 3]; each sums to 0 over an element. Entries with α
            or β come first in their element, which keeps the kernels short.
        stiffness: B A [N m³], shape [e], >= 0.
        rest_curvature: along t₁ × t₂ [1/m], shape [e].
        slip_moment: H A [N m²], shape [e], >= 0; H is half the hysteresis 2HB of a bending test.

    Raises:
        InputError: on unequal lengths or values out of range.
    """

    start: Array
    particles: Array
    weights: Array
    stiffness: Array
    rest_curvature: Array
    slip_moment: Array

    def __post_init__(self):
        start = validate.array(self.start, "bending: start", (None,), np.int32)
        count, entries = max(len(start) - 1, 0), int(start[-1]) if len(start) else 0
        values = {
            "start": start,
            "particles": validate.array(self.particles, "bending: particles", (entries,), np.int32),
            "weights": validate.array(self.weights, "bending: weights", (entries, 3)),
            "stiffness": validate.array(self.stiffness, "bending: stiffness", (count,)),
            "rest_curvature": validate.array(self.rest_curvature, "bending: rest_curvature", (count,)),
            "slip_moment": validate.array(self.slip_moment, "bending: slip_moment", (count,)),
        }
        if len(start) == 0 or start[0] != 0 or np.any(np.diff(start) < 1):
            raise InputError("Bending: start must rise from 0, by at least one entry for each element.")
        for name in ("stiffness", "slip_moment"):
            if np.any(values[name] < 0.0):
                raise InputError(f"Bending: {name} must not be negative.")
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.stiffness)

    @property
    def friction_stiffness(self) -> np.ndarray:
        """Of the springs before the slip [N m³], shape [e]."""
        return self.slip_moment / SLIP_CURVATURE

    @property
    def turning(self) -> bool:
        """Whether any element needs the surface's tangents."""
        return bool(np.any(self.rest_curvature) or np.any(self.slip_moment))

    @property
    def turning_end(self) -> np.ndarray:
        """Where the entries with α or β end, shape [e]."""
        turning = np.any(self.weights[:, 1:] != 0.0, axis=1)
        last = np.where(turning, np.arange(1, len(turning) + 1), 0)
        return np.maximum(_largest(self.element, last, len(self)).astype(np.int32), self.start[:-1])

    @property
    def element(self) -> np.ndarray:
        """Element of each entry, shape [m]."""
        return np.repeat(np.arange(len(self)), np.diff(self.start))

    @staticmethod
    def none() -> "BendingElements":
        """No elements."""
        return BendingElements(np.zeros(1, np.int32), [], np.zeros((0, 3)), [], [], [])

    @staticmethod
    def from_entries(
        element: np.ndarray,
        particle: np.ndarray,
        weights: np.ndarray,
        *,
        stiffness: np.ndarray,
        slip_moment: np.ndarray,
        points: np.ndarray,
    ) -> "BendingElements":
        """From loose entries (element, particle, weights), summed where they name the same pair, at rest at ``points``.

        What the rest shape gives d along the tangents is taken out of w, so that d is along the normal there; without
        rest curvature and slip the tangents are left out, which makes elements smaller.
        """
        if len(stiffness) == 0:
            return BendingElements.none()
        count = len(points)
        keys, place = np.unique(np.asarray(element, np.int64) * count + particle, return_inverse=True)
        element, particle = np.divmod(keys, count)
        weights = np.stack([np.bincount(place.ravel(), column, len(keys)) for column in weights.T], axis=1)
        e = len(stiffness)
        d, t1, t2 = (_sums(element, column, points[particle], e) for column in weights.T)
        normal = np.cross(t1, t2)
        curvature = np.einsum("ij,ij->i", d, normal)
        size = _largest(
            element, np.linalg.norm(points[particle] - points[particle[_firsts(element)]][element], axis=1), e
        )
        flat = np.abs(curvature) * size < FLAT
        curvature[flat] = 0.0
        level = np.linalg.norm(d, axis=1) * size < FLAT  # not so the twist of a ball, which has no curvature either
        for column, tangent in enumerate((t1, t2), start=1):
            along = np.where(level, 0.0, np.einsum("ij,ij->i", d, tangent))
            weights[:, 0] -= along[element] * weights[:, column]
        weights[(flat & (slip_moment == 0.0))[element], 1:] = 0.0
        largest = np.stack([_largest(element, np.abs(column), e) for column in weights.T], axis=1)[element]
        keep = np.any(np.abs(weights) > 1e-9 * largest, axis=1)
        element, particle, weights = element[keep], particle[keep], weights[keep]
        order = np.lexsort((particle, ~np.any(weights[:, 1:], axis=1), element))
        start = np.concatenate([[0], np.cumsum(np.bincount(element, minlength=e))])
        return BendingElements(start, particle[order], weights[order], stiffness, curvature, slip_moment)

    @staticmethod
    def joined(parts: Sequence["BendingElements"], first: Sequence[int]) -> "BendingElements":
        """All elements of several cloths; ``first`` is added to the particle numbers of each."""
        entries = np.concatenate([[0], np.cumsum([len(part.particles) for part in parts])])
        starts = [part.start[:-1] + n for part, n in zip(parts, entries, strict=False)]
        rest = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in ("weights", "stiffness", "rest_curvature", "slip_moment")
        }
        particles = np.concatenate([part.particles + n for part, n in zip(parts, first, strict=True)])
        return BendingElements(np.concatenate([*starts, entries[-1:]]), particles, **rest)


def _sums(element: np.ndarray, weight: np.ndarray, x: np.ndarray, count: int) -> np.ndarray:
    return np.stack([np.bincount(element, weight * column, count) for column in x.T], axis=1)


def _largest(element: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    out = np.zeros(count)
    np.maximum.at(out, element, values)
    return out


def _firsts(element: np.ndarray) -> np.ndarray:
    return np.unique(element, return_index=True)[1]
