"""A bare network of springs and point masses, without cloth."""

from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import model_validator

from .table import Table, field
from .values import ANY_LENGTH, Name, Number, OneOrEach, Rows, Vector, at_least_zero, positive, refuse

Masses = Annotated[float | tuple[float, ...], OneOrEach(positive("kg", 1e6))]
Lengths = Annotated[float | tuple[float, ...], OneOrEach(positive("m"))]
Stiffness = Annotated[float | tuple[float, ...], OneOrEach(at_least_zero("N", 1e9))]
Damping = Annotated[float | tuple[float, ...], OneOrEach(at_least_zero("N s", 1e9))]
Index = Number("", 0, 10_000_000, whole=True)


@dataclass(frozen=True, eq=False)
class Network:
    """Arrays of a spring network, as :meth:`warpcloth.Model.from_springs` takes them.

    Args:
        name: Name in the USD file.
        points: Start positions [m], shape [n, 3].
        masses: Masses [kg], shape [n].
        springs: Pairs of particles, shape [s, 2].
        rest_lengths: Rest lengths [m], shape [s].
        k_s: Stiffness [N], shape [s].
        k_d: Damping [N s], shape [s].
        pinned: Particles that are held.
        width: Diameter of the drawn springs [m].
    """

    name: str
    points: np.ndarray
    masses: np.ndarray
    springs: np.ndarray
    rest_lengths: np.ndarray
    k_s: np.ndarray
    k_d: np.ndarray
    pinned: list[int]
    width: float


class NetworkTable(Table):
    """Point masses joined by springs, e.g. a pendulum or a chain. A scene has either a network or cloths."""

    name: Name = field("network", "Name in the USD file.")
    positions: Annotated[tuple[tuple[float, ...], ...], Rows(Vector("x y z", ANY_LENGTH))] = field(
        ..., "Start positions of the particles."
    )
    masses: Masses = field(..., "Mass of all particles, or of each.")
    springs: Annotated[tuple[tuple[int, ...], ...], Rows(Vector("p q", Index))] = field(
        ..., "The two particles that each spring joins, counted from 0."
    )
    rest_lengths: Lengths | None = field(
        None, "Rest length of all springs, or of each; by default their lengths at the start."
    )
    k_s: Stiffness = field(..., "Stiffness of all springs, or of each: force per unit strain.")
    k_d: Damping = field(0.0, "Damping of all springs, or of each: force per unit strain rate.")
    pinned: Annotated[tuple[int, ...], Rows(Index, least=0)] = field((), "Particles that are held, counted from 0.")
    width: Annotated[float, positive("m")] = field(0.01, "Diameter that springs are drawn with.")

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        particles, springs = len(self.positions), len(self.springs)
        for key, values, count in (
            ("masses", self.masses, particles),
            ("rest_lengths", self.rest_lengths, springs),
            ("k_s", self.k_s, springs),
            ("k_d", self.k_d, springs),
        ):
            if isinstance(values, tuple) and len(values) != count:
                what = "particle" if key == "masses" else "spring"
                raise refuse(f"must have one of {key} for each {what}: {count}, not {len(values)}")
        for index, (p, q) in enumerate(self.springs):
            if p == q or max(p, q) >= particles:
                raise refuse(f"must join two different particles from 0 to {particles - 1} by springs.{index}")
        if self.pinned and max(self.pinned) >= particles:
            raise refuse(f"must have pinned particles from 0 to {particles - 1}")
        if self.rest_lengths is None and float(self._lengths().min()) == 0.0:
            raise refuse("must have rest_lengths, because a spring joins two particles in one place")
        return self

    def build(self) -> Network:
        """The network as arrays."""
        springs = len(self.springs)
        lengths = self._lengths() if self.rest_lengths is None else np.broadcast_to(self.rest_lengths, springs)
        return Network(
            name=self.name,
            points=np.array(self.positions),
            masses=np.array(np.broadcast_to(self.masses, len(self.positions))),
            springs=np.array(self.springs, dtype=np.int32),
            rest_lengths=np.array(lengths),
            k_s=np.array(np.broadcast_to(self.k_s, springs)),
            k_d=np.array(np.broadcast_to(self.k_d, springs)),
            pinned=sorted(set(self.pinned)),
            width=self.width,
        )

    def _lengths(self) -> np.ndarray:
        points, pairs = np.array(self.positions), np.array(self.springs)
        return np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
