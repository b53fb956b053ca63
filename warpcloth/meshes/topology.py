"""Edges of a triangle mesh."""

from dataclasses import dataclass

import numpy as np

from ..errors import MeshError
from ..validate import sentence

SIDES = np.array([[1, 2], [2, 0], [0, 1]])  # side i of a triangle lies opposite to its corner i


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """Each edge once, and which edge each side of each triangle is.

    ``edges`` (e, 2) with the smaller vertex first; ``of_side`` (3 m): edge of side i of triangle t at 3 t + i;
    ``counts`` (e,): triangles at each edge.
    """

    edges: np.ndarray
    of_side: np.ndarray
    counts: np.ndarray

    @staticmethod
    def of(triangles: np.ndarray) -> "EdgeTable":
        """The edges of ``triangles`` (m, 3), in lexical order."""
        sides = np.sort(triangles[:, SIDES].reshape(-1, 2), axis=1).astype(np.int64)
        stride = int(triangles.max(initial=0)) + 1
        keys, of_side, counts = np.unique(sides[:, 0] * stride + sides[:, 1], return_inverse=True, return_counts=True)
        edges = np.stack([keys // stride, keys % stride], axis=1).astype(np.int32)
        return EdgeTable(edges, of_side.ravel(), counts)

    @property
    def is_manifold(self) -> bool:
        """Whether every edge has one or two triangles."""
        return bool(self.counts.max(initial=0) <= 2)

    @property
    def is_closed(self) -> bool:
        """Whether every edge has exactly two triangles."""
        return bool(np.all(self.counts == 2))

    def side_pairs(self) -> np.ndarray:
        """For each edge with exactly two triangles, in order, its two sides (as numbers 3 t + i), shape [k, 2]."""
        order = np.argsort(self.of_side, kind="stable")
        first = np.searchsorted(self.of_side[order], np.flatnonzero(self.counts == 2))
        return np.stack([order[first], order[first + 1]], axis=1)


def oriented(triangles: np.ndarray, table: EdgeTable, label: str) -> np.ndarray:
    """Triangles (m, 3) turned so that neighbours agree on which side is the front; most keep theirs.

    Raises:
        MeshError: when the surface has only one side.
    """
    sides = table.side_pairs()
    directed = triangles[:, SIDES].reshape(-1, 2)
    clash = directed[sides[:, 0], 0] == directed[sides[:, 1], 0]
    if not clash.any():
        return triangles
    flips = _flips(len(triangles), sides // 3, clash)
    if np.any(flips[sides[:, 0] // 3] ^ flips[sides[:, 1] // 3] ^ clash):
        raise MeshError(
            f"{sentence(label)}: the surface has only one side, like a Möbius strip; cut it open along a line."
        )
    return np.where(flips[:, None], triangles[:, ::-1], triangles)


def _flips(count: int, pairs: np.ndarray, clash: np.ndarray) -> np.ndarray:
    """Which triangles to turn, by flooding each connected piece; the minority of each piece is turned."""
    neighbours: list[list[tuple[int, bool]]] = [[] for _ in range(count)]
    for (a, b), differs in zip(pairs.tolist(), clash.tolist(), strict=True):
        neighbours[a].append((b, differs))
        neighbours[b].append((a, differs))
    flips = np.zeros(count, bool)
    seen = np.zeros(count, bool)
    for seed in range(count):
        if seen[seed]:
            continue
        piece, seen[seed] = [seed], True
        for triangle in piece:  # grows while it is walked
            for other, differs in neighbours[triangle]:
                if not seen[other]:
                    seen[other], flips[other] = True, flips[triangle] ^ differs
                    piece.append(other)
        if 2 * np.count_nonzero(flips[piece]) > len(piece):
            flips[piece] ^= True
    return flips


def connected(a: np.ndarray, b: np.ndarray, count: int) -> np.ndarray:
    """For each of ``count`` nodes the lowest one that links a–b connect it with, shape [count]."""
    label = np.arange(count)
    while True:
        lower, before = np.minimum(label[a], label[b]), label.copy()
        np.minimum.at(label, a, lower)
        np.minimum.at(label, b, lower)
        label = label[label]
        if np.array_equal(label, before):
            return label


def near_groups(points: np.ndarray, distance: float) -> np.ndarray:
    """For each point the first of those in the same place, shape [n].

    Points nearer than ``distance`` are in the same place, points further apart than 7 times that are not. Two that are
    near share a cell of at least one of eight lattices, which are half a cell apart along the axes. Cells are counted
    in 20 bits, so ``distance`` must be above 2.5e-7 of the largest extent.
    """
    count = len(points)
    if distance <= 0.0:
        return np.zeros(count, np.int64)
    cells, firsts = (points - points.min(axis=0)) / (4.0 * distance), []
    for shift in np.ndindex(2, 2, 2):
        x, y, z = np.floor(cells + 0.5 * np.array(shift)).astype(np.int64).T
        _, first, group = np.unique((x << 40) + (y << 20) + z, return_index=True, return_inverse=True)
        firsts.append(first[group.ravel()])
    return connected(np.tile(np.arange(count), len(firsts)), np.concatenate(firsts), count)
