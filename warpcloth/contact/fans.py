"""The fans of a mesh; see ``kernels/contact_fans.py``."""

from dataclasses import dataclass

import numpy as np

CLOSED, OPEN, BROKEN = 1, 0, -1


@dataclass(frozen=True)
class Fans:
    """The triangles around each vertex.

    Attributes:
        start, spokes: fan i has the entries ``start[i]:start[i + 1]`` of ``spokes``: of each of its triangles the other
            two corners, counter-clockwise; of an open fan the first triangle comes first. Shapes [n + 1], [3 m, 2].
        turns: CLOSED, OPEN or BROKEN, shape [n].
    """

    start: np.ndarray
    spokes: np.ndarray
    turns: np.ndarray


def fans_of(triangles: np.ndarray, vertex_count: int) -> Fans:
    """The fans of triangles, shape [m, 3].

    BROKEN are those of vertices where more than one fan meets, or whose triangles are not oriented alike.
    """
    corners = np.concatenate([triangles, triangles[:, [1, 2, 0]], triangles[:, [2, 0, 1]]]).astype(np.int64)
    order = np.argsort(corners[:, 0], kind="stable")
    centre, spokes = corners[order, 0], corners[order, 1:].astype(np.int32)
    start = np.searchsorted(centre, np.arange(vertex_count + 1))
    turns, first = _walk(centre, spokes, start)
    some = np.flatnonzero(np.diff(start))
    spokes[start[some]], spokes[first[some]] = spokes[first[some]], spokes[start[some]].copy()
    return Fans(start.astype(np.int32), spokes, turns)


def _walk(centre: np.ndarray, spokes: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """CLOSED, OPEN or BROKEN, and the first entry of each fan; all fans are walked at once."""
    count, valence = len(start) - 1, np.diff(start)
    leaving, arriving = (centre * count + spokes[:, k] for k in (0, 1))
    order = np.argsort(leaving)
    place = np.minimum(np.searchsorted(leaving[order], arriving), max(len(order) - 1, 0))
    follower = np.where(leaving[order][place] == arriving, order[place], -1)
    starts = np.flatnonzero(~np.isin(leaving, arriving))
    first = start[:-1].copy()
    first[centre[starts]] = starts
    open_ends = np.bincount(centre[starts], minlength=count)
    here, steps = first.copy(), np.minimum(valence, 1)
    for _ in range(int(valence.max(initial=0))):
        onward = np.where(valence > 0, follower[np.minimum(here, len(follower) - 1)], -1)
        goes = (onward >= 0) & (onward != first)
        here, steps = np.where(goes, onward, here), steps + goes
    twice = [np.unique(keys, return_counts=True) for keys in (leaving, arriving)]
    doubled = np.concatenate([keys[counts > 1] // count for keys, counts in twice])
    turns = np.where(open_ends == 0, CLOSED, OPEN).astype(np.int32)
    turns[(steps != valence) | (open_ends > 1) | np.isin(np.arange(count), doubled)] = BROKEN
    return turns, first
