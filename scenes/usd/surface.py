"""Normals of a triangulated surface."""

import numpy as np

FALLBACK = np.array([0.0, 0.0, 1.0])


def vertex_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals at the vertices, float64, shape [n, 3].

    Face normals after the winding, weighted by area; (0, 0, 1) where they cancel or no face touches the vertex.
    """
    total = summed_area_vectors(points, triangles)
    length = np.linalg.norm(total, axis=1)
    return np.divide(total, length[:, None], out=np.tile(FALLBACK, (len(total), 1)), where=length[:, None] > 0.0)


def summed_area_vectors(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Sum over the faces at each vertex of face normal × twice the face area [m²], shape [n, 3]."""
    return _gather(_area_vectors(points, triangles), triangles, len(points))


def summed_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Sum over the faces at each vertex of twice the face area [m²], shape [n]."""
    areas = np.linalg.norm(_area_vectors(points, triangles), axis=1, keepdims=True)
    return _gather(areas, triangles, len(points))[:, 0]


def _area_vectors(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    corners = np.asarray(points, np.float64)[triangles]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _gather(per_face: np.ndarray, triangles: np.ndarray, count: int) -> np.ndarray:
    index = np.asarray(triangles).ravel()
    columns = [np.bincount(index, np.repeat(column, 3), minlength=count) for column in per_face.T]
    return np.stack(columns, axis=1)
