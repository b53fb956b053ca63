"""Polygons to triangles."""

from typing import Any

import numpy as np

_TRIANGLE = np.array([[0, 1, 2]])
_SPLIT_02 = np.array([[0, 1, 2], [0, 2, 3]])
_SPLIT_13 = np.array([[0, 1, 3], [1, 2, 3]])


def triangulate(points: np.ndarray, counts: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Cuts polygons, which may be concave or have straight corners, into triangles of the same orientation.

    Args:
        points: shape [n, 3].
        counts: corners of each polygon, >= 3, shape [f].
        corners: vertex of each corner, polygon after polygon.

    Returns:
        Positions in ``corners``, in the order of the polygons, shape [m, 3]: they index vertices and texture
        coordinates alike. Polygons that run along a line and back lose that spur, which has no area.
    """
    starts = np.cumsum(counts) - counts
    three, four = starts[counts == 3], starts[counts == 4]
    parts = [three[:, None] + _TRIANGLE, _split_quads(points, corners, four)]
    for start, count in zip(starts[counts > 4].tolist(), counts[counts > 4].tolist(), strict=True):
        parts.append(start + _split_polygon(points[corners[start : start + count]]))
    triangles = np.concatenate(parts)
    a, b, c = corners[triangles].T
    spur = (a == b) | (b == c) | (c == a)
    spur[: len(three)] = False  # a triangle as given is not ours to drop
    triangles = triangles[~spur]
    return triangles[np.argsort(np.searchsorted(starts, triangles[:, 0], side="right"), kind="stable")]


def without_holes(triangles: np.ndarray, counts: np.ndarray, holes: Any) -> np.ndarray:
    """Those of the triangles of :func:`triangulate` that are not of polygons named as ``holes``, shape [m, 3]."""
    numbers = np.array([] if holes is None else holes, np.int64)
    if numbers.size == 0:
        return triangles
    face = np.searchsorted(np.cumsum(counts), triangles[:, 0], side="right")
    return triangles[~np.isin(face, numbers)]


def _split_quads(points: np.ndarray, corners: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Along the diagonal 0–2, unless the quad is concave there or 1–3 makes much better triangles."""
    p = points[corners[starts[:, None] + np.arange(4)]]
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    smaller = [np.min([_facing(p[:, t], normal) for t in split], axis=0) for split in (_SPLIT_02, _SPLIT_13)]
    split = np.where((smaller[1] > 2.0 * smaller[0])[:, None, None], _SPLIT_13, _SPLIT_02)
    return (starts[:, None, None] + split).reshape(-1, 3)


def _facing(triangle: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Area of triangles (q, 3, 3) as seen along ``normal`` (q, 3), up to a common factor; negative: from behind."""
    return np.einsum("qi,qi->q", np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0]), normal)


def _split_polygon(polygon: np.ndarray) -> np.ndarray:
    """Ear clipping in the plane of Newell's normal; a fan where the polygon is strictly convex, shape [k − 2, 3]."""
    flat = _flattened(polygon)
    count = len(flat)
    tiny = 1e-9 * float(np.ptp(flat, axis=0).max()) ** 2
    turns = _cross(flat - np.roll(flat, 1, axis=0), np.roll(flat, -1, axis=0) - flat)
    if np.all(turns > tiny):
        first = np.arange(1, count - 1)
        return np.stack([np.zeros(count - 2, int), first, first + 1], axis=1)
    rest, triangles = list(range(count)), []
    while len(rest) > 3:
        ear = next((i for i in range(len(rest)) if _is_ear(flat, rest, i, tiny)), 0)
        triangles.append([rest[ear - 1], rest[ear], rest[(ear + 1) % len(rest)]])
        del rest[ear]
    return np.array([*triangles, rest])


def _is_ear(flat: np.ndarray, rest: list[int], i: int, tiny: float) -> bool:
    """Whether corner i of what is left turns left and no other corner lies in or on its triangle."""
    ring = [rest[i - 1], rest[i], rest[(i + 1) % len(rest)]]
    a, b, c = flat[ring]
    if _cross(b - a, c - b) <= tiny:
        return False
    others = flat[[k for k in rest if k not in ring]]
    inside = np.ones(len(others), bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= _cross(end - start, others - start) >= -tiny
    return not inside.any()


def _flattened(polygon: np.ndarray) -> np.ndarray:
    """Coordinates in the polygon's plane, counter-clockwise, shape [k, 2]."""
    centred = polygon - polygon.mean(axis=0)
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    axis = np.zeros(3)
    axis[np.argmin(np.abs(normal))] = 1.0
    u = np.cross(axis, normal)
    v = np.cross(normal, u)
    scale = np.array([np.linalg.norm(u), np.linalg.norm(v)])
    return centred @ np.stack([u, v], axis=1) / np.where(scale > 0.0, scale, 1.0)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
