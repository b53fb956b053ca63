"""Motion of pins and obstacles along keyframes."""

import itertools
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from warpcloth.motion import Motion

from .table import Table, field
from .values import Number, Point, Turn, refuse


class KeyTable(Table):
    """A keyframe: where the moved thing is at one moment, relative to where it was placed."""

    time: Annotated[float, Number("s", -1e6, 1e6)] = field(..., "Moment of the keyframe.")
    position: Point = field((0.0, 0.0, 0.0), "Displacement from the place it was built at.")
    rotation: Turn = field(
        (0.0, 0.0, 0.0),
        "Rotation vector (axis times angle) about the pivot. Angles beyond 360° are several turns.",
    )


class MotionTable(Table):
    """A rigid motion through keyframes; before the first and after the last one the thing stands still."""

    keys: list[KeyTable] = Field(..., description="The keyframes, in order of time.", min_length=1, max_length=100_000)
    interpolation: Literal["linear", "smooth"] = field(
        "linear", "Between keyframes: at constant speed, or easing in and out of each."
    )
    loop: bool = field(False, "Whether to start again after the last keyframe.")
    pivot: Point | None = field(
        None, "Point that rotations turn about; by default the centre of the obstacle or of the pinned points."
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        times = [key.time for key in self.keys]
        for index, (before, after) in enumerate(itertools.pairwise(times), start=1):
            if after <= before:
                raise refuse(
                    f"must have keyframes in order of time, but keys.{index} does not come after the one before"
                )
        if self.loop and len(times) == 1:
            raise refuse("must have two keyframes or more to loop")
        return self

    def build(self) -> Motion:
        """The simulator's motion."""
        return Motion(
            times=np.array([key.time for key in self.keys]),
            positions=np.array([key.position for key in self.keys]),
            rotations=np.radians([key.rotation for key in self.keys]),
            interpolation=self.interpolation,
            loop=self.loop,
            pivot=None if self.pivot is None else np.array(self.pivot),
        )
