"""What a mesh must be to become an obstacle or cloth; each complaint is one sentence."""

import warnings
from typing import Any

import numpy as np

from .. import validate
from ..errors import MeshError, MeshWarning
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


def check_polygons(name: str, points: np.ndarray, counts: np.ndarray, corners: np.ndarray) -> None:
    """Refuses what cannot be cut into triangles.

    Args:
        name: of the mesh.
        points: [m], shape [n, 3].
        counts: corners of each face, shape [f].
        corners: vertex of each corner, face after face.

    Raises:
        MeshError: on non-finite points, a face of fewer than three corners, or a vertex that there is not.
    """
    refuse_non_finite(points, f"mesh '{name}'")
    small = np.flatnonzero(counts < 3)
    if small.size:
        raise MeshError(f"Mesh '{name}': face {small[0]} has {counts[small[0]]} corners, but needs 3 or more.")
    outside = corners[(corners < 0) | (corners >= len(points))]
    if outside.size:
        what = f"a face refers to vertex {outside[0]}"
        raise MeshError(f"Mesh '{name}': {what}, which is not one of 0 to {len(points) - 1}.")


def check_areas(points: np.ndarray, triangles: np.ndarray, label: str) -> None:
    """Refuses triangles without area.

    Raises:
        MeshError: naming how many there are, and the first.
    """
    flat = np.flatnonzero(without_area(points, triangles))
    if flat.size:
        raise MeshError(f"{_said_of(flat, triangles, label)}; remove degenerate triangles.")


def areas_only(points: np.ndarray, triangles: np.ndarray, label: str) -> np.ndarray:
    """The triangles with area, shape [k, 3]; others, which nothing can hit, are left out with a warning.

    Raises:
        MeshError: there are none, or an index is out of range.
    """
    points, triangles = checked_arrays(points, triangles, label)
    flat = without_area(points, triangles)
    if not flat.any():
        return triangles
    said = _said_of(np.flatnonzero(flat), triangles, label)
    if flat.all():
        raise MeshError(f"{said}, and no others are left to collide with.")
    warnings.warn(f"{said}; an obstacle does without.", MeshWarning, stacklevel=4)
    return triangles[~flat]


def without_area(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which triangles have no area, as far as float32 can tell, shape [m]."""
    corners = points[triangles]
    sides = corners - np.roll(corners, 1, axis=1)
    longest = np.einsum("tij,tij->ti", sides, sides).max(axis=1)
    doubled = np.linalg.norm(np.cross(sides[:, 1], sides[:, 2]), axis=1)
    return ~(doubled > FLATNESS * longest)


def _said_of(flat: np.ndarray, triangles: np.ndarray, label: str) -> str:
    what = "triangle has" if flat.size == 1 else "triangles have"
    first = f"triangle {flat[0]} with vertices {', '.join(map(str, triangles[flat[0]]))}"
    return f"{validate.sentence(label)}: {flat.size} {what} no area, first {first}"


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
    if validate.axes(points) != 2:
        return  # no points at all: the check of shape and type says so
    values = np.asarray(points)
    bad = np.flatnonzero(~np.isfinite(values)) if values.dtype.kind == "f" else values[:0]
    if bad.size:
        title = validate.sentence(label)
        vertices = np.unique(bad // values.shape[1])
        what = "vertex is" if vertices.size == 1 else "vertices are"
        raise MeshError(f"{title}: {vertices.size} {what} not finite (NaN or infinite), first vertex {vertices[0]}.")
