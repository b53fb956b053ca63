"""What a mesh must be to become an obstacle or cloth; each complaint is one sentence."""

from typing import Any

import numpy as np

from .. import validate
from ..errors import MeshError
from .topology import EdgeTable

FLATNESS = 1e-6  # a triangle lower than this share of its longest edge has no area in float32


def checked_arrays(points: Any, triangles: Any, label: str) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) float64 and triangles (m, 3) int32, read-only; finite, not empty, indices in range.

    Raises:
        MeshError: on an empty mesh, non-finite points or an index out of range; InputError: on wrong shapes or types.
    """
    refuse_non_finite(points, label)
    vertices = validate.array(points, f"{label}: points", (None, 3))
    faces = validate.array(triangles, f"{label}: triangles", (None, 3), np.int32)
    title = validate.sentence(label)
    if len(vertices) == 0 or len(faces) == 0:
        raise MeshError(f"{title} is empty: it has {len(vertices)} vertices and {len(faces)} triangles.")
    outside = np.flatnonzero((faces < 0) | (faces >= len(vertices)))
    if outside.size:
        bad, where = faces.flat[outside[0]], outside[0] // 3
        raise MeshError(
            f"{title}: triangle {where} refers to vertex {bad}, which is not one of 0 to {len(vertices) - 1}."
        )
    return vertices, faces


def check_areas(points: np.ndarray, triangles: np.ndarray, label: str) -> None:
    """Refuses triangles without area.

    Raises:
        MeshError: naming how many there are, and the first.
    """
    corners = points[triangles]
    sides = corners - np.roll(corners, 1, axis=1)
    longest = np.einsum("tij,tij->ti", sides, sides).max(axis=1)
    doubled = np.linalg.norm(np.cross(sides[:, 1], sides[:, 2]), axis=1)
    flat = np.flatnonzero(~(doubled > FLATNESS * longest))
    if flat.size:
        what = "triangle has" if flat.size == 1 else "triangles have"
        first = f"triangle {flat[0]} with vertices {', '.join(map(str, triangles[flat[0]]))}"
        title = validate.sentence(label)
        raise MeshError(f"{title}: {flat.size} {what} no area, first {first}; remove degenerate triangles.")


def check_manifold(triangles: np.ndarray, table: EdgeTable, label: str) -> None:
    """Refuses repeated triangles, and edges with more than two.

    Raises:
        MeshError: naming how many there are, and the first.
    """
    title = validate.sentence(label)
    unique, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    if len(unique) < len(triangles):
        repeated = np.setdiff1d(np.arange(len(triangles)), first)
        raise MeshError(f"{title}: {repeated.size} triangles repeat others, first triangle {repeated[0]}; remove them.")
    crowded = np.flatnonzero(table.counts > 2)
    if crowded.size:
        a, b = table.edges[crowded[0]]
        what = "edge belongs" if crowded.size == 1 else "edges belong"
        rule = "cloth must be a surface that does not branch"
        raise MeshError(
            f"{title} is not manifold: {crowded.size} {what} to more than two triangles, first that from vertex {a} to "
            f"{b}; {rule}."
        )


def refuse_non_finite(points: Any, label: str) -> None:
    """Refuses NaN and infinite coordinates.

    Raises:
        MeshError: naming how many vertices have them, and the first.
    """
    try:
        values = np.asarray(points, float)
    except (TypeError, ValueError):
        return  # not numbers at all: the check of shape and type says so
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size and values.ndim == 2:
        title = validate.sentence(label)
        vertices = np.unique(bad // values.shape[1])
        what = "vertex is" if vertices.size == 1 else "vertices are"
        raise MeshError(f"{title}: {vertices.size} {what} not finite (NaN or infinite), first vertex {vertices[0]}.")
