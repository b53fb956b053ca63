"""Pins: which vertices of a cloth are held, and how they move."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import validate
from ..errors import InputError
from ..motion import Motion
from ..validate import Array, ReadOnly


@dataclass(frozen=True, eq=False)
class Pin(ReadOnly):
    """Vertices held in place, or moved together.

    Args:
        indices: particles of the cloth, shape [k], int32, each at most once.
        motion: rigid motion, about the centroid of the pin unless it has its own pivot; None: held still.
    """

    indices: Array
    motion: Motion | None = None

    def __post_init__(self):
        indices = validate.array(self.indices, "pin: indices", (None,), np.int32)
        if indices.size == 0:
            raise InputError("Pin: at least one vertex is needed.")
        if len(np.unique(indices)) < indices.size:
            raise InputError("Pin: a vertex is named twice.")
        if self.motion is not None and not isinstance(self.motion, Motion):
            raise InputError(f"Pin: motion must be a Motion or None, got {type(self.motion).__name__}.")
        object.__setattr__(self, "indices", indices)


@dataclass(frozen=True, eq=False)
class PinSpec:
    """Which vertices to pin, before the mesh is known.

    Args:
        select: vertex indices, the name of an edge or corner, or a function from world points (n, 3) [m] to indices.
        motion: rigid motion of the pinned vertices; None: held still.
    """

    select: Any
    motion: Motion | None = None


def pin(select: Any, motion: Motion | None = None) -> PinSpec:
    """Pins vertices by index or name, optionally moving: ``pin("left", Motion.keyframes(...))``."""
    return PinSpec(select, motion)


def pin_box(lower: Any, upper: Any, motion: Motion | None = None) -> PinSpec:
    """Pins every vertex in the world-space box from ``lower`` to ``upper`` [m], bounds included."""
    low, high = validate.vector(lower, "pin box: lower"), validate.vector(upper, "pin box: upper")
    if np.any(low > high):
        raise InputError(f"Pin box: lower {low} must not exceed upper {high}.")

    def select(points: np.ndarray) -> np.ndarray:
        inside = np.flatnonzero(np.all((points >= low) & (points <= high), axis=1))
        if inside.size == 0:
            extent = f"{points.min(axis=0)} to {points.max(axis=0)}"
            raise InputError(f"Pin box: no vertex lies between {low} and {high}; the cloth spans {extent}.")
        return inside

    return PinSpec(select, motion)


def pin_nearest(points: Any, motion: Motion | None = None) -> PinSpec:
    """Pins the vertex nearest to each of the world-space ``points`` (k, 3) or to one point (3,) [m]."""
    shape = (3,) if validate.axes(points) == 1 else (None, 3)
    targets = validate.array(points, "pin nearest: points", shape).reshape(-1, 3)
    if len(targets) == 0:
        raise InputError("Pin nearest: at least one point is needed.")

    def select(vertices: np.ndarray) -> np.ndarray:
        return np.unique([int(np.argmin(np.sum((vertices - target) ** 2, axis=1))) for target in targets])

    return PinSpec(select, motion)


def resolve_pins(pins: Any, points: np.ndarray, named: Mapping[str, np.ndarray], label: str) -> tuple[Pin, ...]:
    """Turns what a user gave as ``pins`` into disjoint :class:`Pin` groups.

    Bare indices and names that do not move form one group. A vertex may belong to several still groups, but not to a
    moving one and to another.
    """
    still: list[np.ndarray] = []
    moving: list[Pin] = []
    for spec in _as_specs(pins):
        indices = _select(spec.select, points, named, label)
        if spec.motion is None:
            still.append(indices)
        else:
            moving.append(Pin(indices, spec.motion))
    groups = ([Pin(np.unique(np.concatenate(still)))] if still else []) + moving
    return tuple(groups)


def _as_specs(pins: Any) -> list[PinSpec]:
    if pins is None:
        return []
    if isinstance(pins, PinSpec | Pin):
        return [PinSpec(pins.indices, pins.motion) if isinstance(pins, Pin) else pins]
    is_array = hasattr(pins, "__array__") or hasattr(pins, "__array_interface__")
    if isinstance(pins, str | int) or is_array or callable(pins):
        return [PinSpec(pins)]
    if isinstance(pins, bytes | bytearray) or not isinstance(pins, Iterable):
        raise InputError(f"Pins must be indices, names or pin specifications, got {type(pins).__name__}.")
    return [spec for item in pins for spec in _as_specs(item)]


def _select(select: Any, points: np.ndarray, named: Mapping[str, np.ndarray], label: str) -> np.ndarray:
    what = f"{label}: pins"
    if isinstance(select, str):
        if not named:
            raise InputError(
                f"{validate.sentence(what)} by name ({select!r}) need a grid or disc; use pin_box or pin_nearest."
            )
        return np.asarray(named[validate.choice(select, named, what)])
    if isinstance(select, list | tuple) and any(isinstance(item, str) for item in select):
        return np.unique(np.concatenate([_select(item, points, named, label) for item in select]))
    chosen = select(points) if callable(select) else select
    chosen = chosen if validate.axes(chosen) else [chosen]
    indices = np.unique(validate.array(chosen, what, (None,), np.int32))
    if indices.size == 0:
        raise InputError(f"{validate.sentence(what)} name no vertex.")
    if indices[0] < 0 or indices[-1] >= len(points):
        bad = indices[0] if indices[0] < 0 else indices[-1]
        raise InputError(f"{validate.sentence(what)}: vertex {bad} is not one of 0 to {len(points) - 1}.")
    return indices
