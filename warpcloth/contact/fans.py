"""The fans of a mesh; see ``kernels/contact_fans.py``."""

from dataclasses import dataclass

import numpy as np

CLOSED, OPEN, BROKEN = 1, 0, -1


@dataclass(frozen=True)
class Fans:
    """The triangles around each vertex.

    Attributes:
        start, ring: the corners around vertex i, counter-clockwise, are ``ring[start[i]:start[i + 1]]``: as many as
            there are triangles around it, of an open fan one more, of a broken one none. Shapes [n + 1], [r].
        turns: CLOSED, OPEN or BROKEN, shape [n].
    """

    start: np.ndarray
    ring: np.ndarray
    turns: np.ndarray


def fans_of(triangles: np.ndarray, vertex_count: int) -> Fans:
    """The fans of triangles, shape [m, 3].

    BROKEN are those of vertices where more than one fan meets, or whose triangles are not oriented alike.
    """
    corners = np.concatenate([triangles, triangles[:, [1, 2, 0]], triangles[:, [2, 0, 1]]]).astype(np.int64)
    order = np.argsort(corners[:, 0], kind="stable")
    centre, spokes = corners[order, 0], corners[order, 1:].astype(np.int32)
    start = np.searchsorted(centre, np.arange(vertex_count + 1))
    turns, around = _walk(centre, spokes, start)
    valence = np.diff(start)
    length = np.where(turns == BROKEN, 0, valence + ((turns == OPEN) & (valence > 0)))
    ring_start = np.concatenate([[0], np.cumsum(length)])
    whole = turns[centre] != BROKEN
    place = ring_start[centre] + np.arange(len(centre)) - start[centre]
    ring = np.zeros(ring_start[-1], dtype=np.int32)
    ring[place[whole]] = spokes[around[whole], 0]
    ends = np.flatnonzero((turns == OPEN) & (valence > 0))
    ring[ring_start[ends + 1] - 1] = spokes[around[start[ends + 1] - 1], 1]
    return Fans(ring_start.astype(np.int32), ring, turns)


def _walk(centre: np.ndarray, spokes: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """CLOSED, OPEN or BROKEN, and the entries of each fan in their order around it; all fans are walked at once."""
    count, valence = len(start) - 1, np.diff(start)
    leaving, arriving = (centre * count + spokes[:, k] for k in (0, 1))
    order = np.argsort(leaving)
    place = np.minimum(np.searchsorted(leaving[order], arriving), max(len(order) - 1, 0))
    follower = np.where(leaving[order][place] == arriving, order[place], -1)
    starts = np.flatnonzero(~np.isin(leaving, arriving))
    first = start[:-1].copy()
    first[centre[starts]] = starts
    open_ends = np.bincount(centre[starts], minlength=count)
    around = np.arange(len(centre))
    here, steps = first.copy(), np.minimum(valence, 1)
    around[start[:-1][valence > 0]] = first[valence > 0]
    for _ in range(int(valence.max(initial=0))):
        onward = np.where(valence > 0, follower[np.minimum(here, len(follower) - 1)], -1)
        goes = (onward >= 0) & (onward != first)
        kept = goes & (steps < valence)
        around[(start[:-1] + steps)[kept]] = onward[kept]
        here, steps = np.where(goes, onward, here), steps + goes
    twice = [np.unique(keys, return_counts=True) for keys in (leaving, arriving)]
    doubled = np.concatenate([keys[counts > 1] // count for keys, counts in twice])
    turns = np.where(open_ends == 0, CLOSED, OPEN).astype(np.int32)
    turns[(steps != valence) | (open_ends > 1) | np.isin(np.arange(count), doubled)] = BROKEN
    return turns, around
