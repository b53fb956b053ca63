"""Which points of a cloth are held, and how they move."""

from typing import Annotated, Literal

from warpcloth.cloth import PinSpec, pin_box, pin_nearest

from .motion import MotionTable
from .table import Choice, Table, choice, field
from .values import ANY_LENGTH, Number, Point, Rows, Vector

Edge = Literal["left", "right", "bottom", "top"]
Corner = Literal["bottom_left", "bottom_right", "top_left", "top_right"]


class RegionTable(Table):
    """A box along the axes, in world space."""

    lower: Point = field(..., "Corner with the smallest coordinates.")
    upper: Point = field(..., "Corner with the largest coordinates.")


class PinTable(Choice):
    """Points of a cloth that are held, or led along a motion; say which in exactly one way."""

    edge: Edge | None = choice("All vertices of one edge of a grid; left is −x, bottom is −y before it is placed.")
    corner: Corner | None = choice("One corner of a grid.")
    indices: Annotated[tuple[int, ...], Rows(Number("", 0, 2**31 - 1, whole=True))] | None = choice(
        "Vertices by number; a grid counts along x first, from its bottom left corner."
    )
    box: RegionTable | None = choice("All vertices inside a box along the axes.")
    nearest: Annotated[tuple[tuple[float, ...], ...], Rows(Vector("x y z", ANY_LENGTH))] | None = choice(
        "For each of these points, the vertex nearest to it."
    )
    motion: MotionTable | None = field(None, "Motion that leads the pinned points; without it they stand still.")

    def build(self) -> PinSpec:
        """The simulator's pin, not yet resolved to vertices."""
        motion = None if self.motion is None else self.motion.build()
        if self.box is not None:
            return pin_box(self.box.lower, self.box.upper, motion)
        if self.nearest is not None:
            return pin_nearest(self.nearest, motion)
        select = getattr(self, self.chosen) if self.indices is None else list(self.indices)
        return PinSpec(select, motion)
