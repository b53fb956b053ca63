"""What a step solves in place, piece by piece."""

from collections.abc import Callable
from typing import NamedTuple

import warp as wp

from ..state import State


class Sweep(NamedTuple):
    """One of several sweeps of a step over all that it solves.

    Attributes:
        start: of the step. dt: its length [s].
        kept: the share of the forces of the sweep before that the displacements contain.
        backwards: whether it takes springs in reverse.
    """

    start: State
    dt: float
    kept: float
    backwards: bool


class Part(NamedTuple):
    """A piece of a sweep.

    Attributes:
        solve: does it, for a sweep and the displacements [m]; changes them and ``arrays`` in place.
        arrays: forces that it keeps.
    """

    solve: Callable[[Sweep, wp.array], None]
    arrays: list[wp.array]
