"""Moves whole pieces of cloth out of what they cross, undeformed, by the least that frees them.

Where a piece goes all the way through another, or a solid is in its middle, the line in which they meet is as long
whichever way they move a little, and so says nothing about the way out.
"""

from dataclasses import dataclass

import numpy as np

from .diagnostics import DEEP_START
from .meshes.topology import connected
from .tangle import Tangle

STRIDES = 24  # in which ways are tried, as far as the largest piece is wide
ODD = 0.997  # of a stride: at round lengths faces of boxes and cloth would lie in one plane, and touch all over
HALVINGS = 6  # of the last of them
WORSE = 2.0  # times as much as at the start may be wrong on the way: a dress is not drawn through who wears it
FLAT = 0.1  # least part of a piece's area that its normals, added up, must come to for them to be a direction
SAME = 0.999  # |cosine| between directions that are as good as one


@dataclass(frozen=True)
class _Way:
    """A direction for a piece: its particles, and what is wrong below what, once it is free of all but itself."""

    members: np.ndarray
    direction: np.ndarray
    gap: float
    aim: float


def push_pieces(tangle: Tangle, trials: int) -> int:
    """Moves pieces of cloth without pins, each time the one that is freed of all that it crosses by the least.

    It starts from where the particles are, and ends with the best that was seen. Of each world it looks at ``trials``
    places of pieces, about, before it gives up.

    Returns:
        how many were moved.
    """
    pieces, moved = _Pieces(tangle), 0
    for world in np.flatnonzero(tangle.tangled).tolist():
        pieces.trials = trials
        while tangle.measure()[world] >= 1.0 and pieces.push(world):
            tangle.look()
            moved += 1
    tangle.back()
    return moved


class _Pieces:
    """Cloths and obstacles that hang together: each has the number of its first particle."""

    def __init__(self, tangle: Tangle):
        self.tangle, surface = tangle, tangle.found.surface
        self.trials = 0  # that are left
        self.tris = surface.tri_indices.numpy()
        links = np.concatenate([self.tris[:, :2], self.tris[:, 1:], tangle.model.spring_indices.numpy()])
        self.piece = connected(links[:, 0], links[:, 1], surface.particle_count)
        self.cloth = self.piece[: tangle.model.particle_count]

    def push(self, world: int) -> bool:
        """Frees the piece of a world that takes the shortest way; False, with nothing moved, where none can be."""
        begun, wrong_now = self.tangle.positions, float(self.tangle.measure()[world])
        ways = self._ways(world, wrong_now)
        stride = max((float(np.ptp(begun[way.members], axis=0).max()) for way in ways), default=0.0) * ODD / STRIDES
        for number in range(1, STRIDES + 1):
            wrong = [self._wrong(begun, world, way, number * stride) for way in ways]
            freed = [way for way, value in zip(ways, wrong, strict=True) if value < way.aim]
            if self.trials < 0:
                break
            if freed:
                self._rest(begun, world, freed, number, stride)
                return True
            ways = [way for way, value in zip(ways, wrong, strict=True) if value <= WORSE * wrong_now]
        self.tangle.state.particle_q.assign(begun)
        return False

    def _rest(self, begun: np.ndarray, world: int, ways: list[_Way], number: int, stride: float) -> None:
        """Moves the piece that needs the least, and a little further where that is free, too."""
        far = [self._least(begun, world, way, (number - 1) * stride, number * stride) for way in ways]
        way, least = ways[int(np.argmin(far))], min(far)
        if self._wrong(begun, world, way, least + way.gap) >= way.aim:
            self._wrong(begun, world, way, least)

    def _least(self, begun: np.ndarray, world: int, way: _Way, low: float, high: float) -> float:
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self._wrong(begun, world, way, middle) < way.aim else (middle, high)
        return high

    def _wrong(self, begun: np.ndarray, world: int, way: _Way, far: float) -> float:
        """Moves a piece ``far`` [m] from where it began; returns what is wrong with its world then."""
        self.trials -= 1
        self.tangle.state.particle_q.assign(np.where(way.members[:, None], begun + far * way.direction, begun))
        return float(self.tangle.measure()[world])

    def _ways(self, world: int, wrong_now: float) -> list[_Way]:
        """Ways for the pieces of a world that are in something and have no pins, the smallest first."""
        tangle = self.tangle
        where = np.unique(np.sort(tangle.found.crossings(tangle.state)[0][:, :2], axis=1), axis=0)
        crossed = self.piece[self.tris[where, 0]]
        deep = tangle.depths() > DEEP_START
        ways = []
        names, sizes = np.unique(self.cloth[tangle.world == world], return_counts=True)
        for name in names[np.argsort(sizes, kind="stable")].tolist():
            members = self.cloth == name
            own = crossed[(crossed == name).any(axis=1) & (crossed[:, 0] != crossed[:, 1])]
            wrong = len(own) + np.count_nonzero(members & deep)
            if wrong and tangle.free[members].all():
                gap = 2.0 * float(tangle.model.particle_radius.numpy()[members].max())
                aim = np.floor(wrong_now) - wrong + 1.0
                others = np.setdiff1d(own, [name]).tolist()
                ways += [_Way(members, d, gap, aim) for d in self._directions(name, others)]
        return ways

    def _directions(self, piece: int, others: list[int]) -> list[np.ndarray]:
        """Along the axes, across the piece or another that it crosses, and along either but across their line."""
        mine = self._normal(piece)
        candidates = [*np.eye(3), mine]
        for other in map(self._normal, others):
            line = np.cross(mine, other)
            candidates += [other, np.cross(line, mine), np.cross(line, other)]
        kept: list[np.ndarray] = []
        for candidate in candidates:
            length = float(np.linalg.norm(candidate))
            if length > FLAT and all(abs(candidate @ known) < SAME * length for known in kept):
                kept.append(candidate / length)
        return [sign * direction for direction in kept for sign in (1.0, -1.0)]

    def _normal(self, piece: int) -> np.ndarray:
        """The mean normal of a piece, shorter where it is not flat."""
        points = self.tangle.found.points.numpy()
        a, b, c = np.moveaxis(points[self.tris[self.piece[self.tris[:, 0]] == piece]].astype(float), 1, 0)
        across = np.cross(b - a, c - a)
        return across.sum(axis=0) / max(float(np.linalg.norm(across, axis=1).sum()), 1e-300)
