"""Keyframed rigid motion of obstacles and pins."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import validate
from .errors import InputError
from .transforms import rotation_matrix
from .validate import Array, ReadOnly

INTERPOLATIONS = ("linear", "smooth")


@dataclass(frozen=True, eq=False)
class Motion(ReadOnly):
    """Rigid motion relative to the initial placement: x(t) = pivot + R(t) (x0 − pivot) + p(t).

    Before the first and after the last key the pose is held. Rotation vectors are interpolated component by
    component, so a key of (0, 0, 4π) means two whole turns about z.

    Args:
        times: key times [s], shape [k], strictly increasing.
        positions: displacement p at each key [m], shape [k, 3].
        rotations: rotation vectors (axis × angle) at each key [rad], shape [k, 3].
        interpolation: "linear", or "smooth" (smoothstep inside each segment, so at rest at every key).
        pivot: fixed centre of rotation [m], shape [3]; None: the centroid of the pins or the centre of the obstacle.
        loop: repeat with the time of the last key as the period.

    Raises:
        InputError: on unequal lengths, times that do not increase, or values that are not finite.
    """

    times: Array
    positions: Array
    rotations: Array
    interpolation: str = "linear"
    pivot: Array = None
    loop: bool = False

    def __post_init__(self):
        times = validate.array(self.times, "motion: times", (None,))
        if times.size == 0:
            raise InputError("Motion: at least one key is needed.")
        late = np.flatnonzero(np.diff(times) <= 0.0)
        if late.size:
            first, second = times[late[0]], times[late[0] + 1]
            raise InputError(f"Motion: times must strictly increase, but {first:g} s is followed by {second:g} s.")
        checked = {
            "times": times,
            "positions": validate.array(self.positions, "motion: positions", (times.size, 3)),
            "rotations": validate.array(self.rotations, "motion: rotations", (times.size, 3)),
            "interpolation": validate.choice(self.interpolation, INTERPOLATIONS, "motion: interpolation"),
            "pivot": None if self.pivot is None else validate.vector(self.pivot, "motion: pivot"),
            "loop": validate.flag(self.loop, "motion: loop"),
        }
        if checked["loop"] and (times[-1] <= 0.0 or times[0] < 0.0):
            raise InputError("Motion: a loop needs keys from 0 s on and a last key later than 0 s, its period.")
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @staticmethod
    def still() -> "Motion":
        """The motion that does not move."""
        return Motion((0.0,), ((0.0, 0.0, 0.0),), ((0.0, 0.0, 0.0),))

    @staticmethod
    def keyframes(
        keys: Iterable[Sequence[Any]], *, interpolation: str = "linear", pivot: Any = None, loop: bool = False
    ) -> "Motion":
        """Motion from keys ``(time, position)`` or ``(time, position, rotation)``, in [s], [m], [rad]."""
        zero = (0.0, 0.0, 0.0)
        rows = validate.listed(keys)
        wrong = [row for row in rows if not isinstance(row, Sequence) or len(row) not in (2, 3)]
        if wrong or not rows:
            got = f", got {validate.shown(wrong[0])}" if wrong else ", and there must be at least one"
            raise InputError(f"Motion: each key must be (time, position) or (time, position, rotation){got}.")
        times, positions = [row[0] for row in rows], [row[1] for row in rows]
        rotations = [row[2] if len(row) == 3 else zero for row in rows]
        return Motion(times, positions, rotations, interpolation, pivot, loop)

    @staticmethod
    def spin(axis: Any, period: float, *, pivot: Any = None) -> "Motion":
        """Endless uniform rotation about ``axis``, one turn in ``period`` seconds."""
        direction = validate.vector(axis, "motion: axis")
        length = np.linalg.norm(direction)
        if length == 0.0:
            raise InputError("Motion: axis must not be zero.")
        turn = 2.0 * np.pi * direction / length
        last = validate.number(period, "motion: period", above=0.0)
        return Motion((0.0, last), np.zeros((2, 3)), (np.zeros(3), turn), "linear", pivot, True)

    @property
    def moves(self) -> bool:
        """Whether any key has another pose than the initial one."""
        keys = np.hstack([self.positions, self.rotations])
        return bool(np.any(keys != 0.0))

    def keys_at(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Displacement [m] and rotation vector [rad] at time ``t`` [s], shape [3] each."""
        period = float(self.times[-1])
        turns = np.floor(float(t) / period) if self.loop else 0  # as kernels/motion.py has it, to the last bit
        time = float(t) - float(turns) * period
        segment = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, max(0, self.times.size - 2)))
        if self.times.size == 1:
            return self.positions[0], self.rotations[0]
        begin, end = self.times[segment], self.times[segment + 1]
        u = min(1.0, max(0.0, (time - begin) / (end - begin)))
        if self.interpolation == "smooth":
            u = u * u * (3.0 - 2.0 * u)
        ends = slice(segment, segment + 2)
        weights = np.array([1.0 - u, u])
        return weights @ self.positions[ends], weights @ self.rotations[ends]

    def pose(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Displacement p [m], shape [3], and rotation matrix R, shape [3, 3], at time ``t`` [s]."""
        position, rotation = self.keys_at(t)
        return position, rotation_matrix(rotation)

    def matrix(self, t: float, pivot: Any = (0.0, 0.0, 0.0)) -> np.ndarray:
        """The 4 × 4 matrix that takes initial points to time ``t``; ``pivot`` is used unless the motion has its own."""
        center = np.asarray(pivot if self.pivot is None else self.pivot, float)
        position, rotation = self.pose(t)
        result = np.eye(4)
        result[:3, :3] = rotation
        result[:3, 3] = center - rotation @ center + position
        return result

    def evaluate(self, points: np.ndarray, t: float, pivot: Any = None) -> np.ndarray:
        """Initial points (n, 3) moved to time ``t``; without any pivot they turn about their centroid."""
        initial = np.asarray(points, float)
        center = initial.mean(axis=0) if pivot is None else np.asarray(pivot, float)
        position, rotation = self.pose(t)
        center = center if self.pivot is None else self.pivot
        return (initial - center) @ rotation.T + center + position
