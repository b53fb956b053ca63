"""What a step solves in place, piece by piece."""

from collections.abc import Callable
from typing import NamedTuple

import warp as wp

from ..state import State


class Turn(NamedTuple):
    """One of several times that a step sweeps over all that it solves.

    Attributes:
        start: of the step. dt: its length [s].
        kept: the share of the forces of the turn before that the displacements contain.
        backwards: whether springs are taken in reverse, where they have an order: not by colours.
    """

    start: State
    dt: float
    kept: float
    backwards: bool


class Part(NamedTuple):
    """A piece of a sweep.

    Attributes:
        solve: does it, for a turn and the displacements [m]; changes them and ``arrays`` in place.
        arrays: forces that it keeps.
        begun: whether something else has had its forces in the same turn: the displacements contain all of them.
    """

    solve: Callable[[Turn, wp.array], None]
    arrays: list[wp.array]
    begun: bool = False
