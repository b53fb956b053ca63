"""Normals of a triangulated surface."""

import numpy as np
import warp as wp

from ...kernels import KernelSet
from ...model import incident_rows


class VertexNormals:
    """Normals of a surface whose triangles stay as they are, frame after frame.

    Args:
        triangles: counter-clockwise seen from the front, shape [m, 3].
        count: number of vertices n.
    """

    def __init__(self, triangles: np.ndarray, count: int):
        kernels, self._device = KernelSet("float32").normals, wp.get_device("cpu")
        rows = incident_rows(np.asarray(triangles).reshape(-1, 1), count)
        corners, start, triangle = (self._array(a, wp.int32) for a in (triangles, rows[0], rows[1] // 3))
        self._points, self._normals = (wp.zeros(count, dtype=wp.vec3, device=self._device) for _ in range(2))
        vectors = wp.zeros(len(triangles), dtype=wp.vec3d, device=self._device)
        self._launches = [
            self._record(kernels.area_vectors, [corners, self._points], vectors),
            self._record(kernels.vertex_normals, [start, triangle, vectors], self._normals),
        ]

    def at(self, points: np.ndarray) -> np.ndarray:
        """Unit normals at the vertices, float32, shape [n, 3], of points as float32; valid until the next call.

        Face normals after the winding, weighted by area; (0, 0, 1) where they cancel or no face touches the vertex.
        """
        self._points.numpy()[:] = points
        for record in self._launches:
            record.launch()
        return self._normals.numpy()

    def _array(self, values: np.ndarray, dtype: type) -> wp.array:
        return wp.array(np.asarray(values).ravel(), dtype=dtype, device=self._device)

    def _record(self, kernel: wp.Kernel, inputs: list[wp.array], out: wp.array) -> wp.Launch:
        return wp.launch(kernel, len(out), inputs, [out], device=self._device, record_cmd=True)


def vertex_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals of a surface seen once; see :meth:`VertexNormals.at`."""
    return VertexNormals(triangles, len(points)).at(points)


def summed_area_vectors(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Sum over the faces at each vertex of face normal × twice the face area [m²], shape [n, 3]."""
    corners = np.asarray(triangles).T
    return np.stack([_gather(column, corners, len(points)) for column in _area_vectors(points, corners)], axis=1)


def summed_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Sum over the faces at each vertex of twice the face area [m²], shape [n]."""
    corners = np.asarray(triangles).T
    return _gather(np.linalg.norm(_area_vectors(points, corners), axis=0), corners, len(points))


def _area_vectors(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Face normal × twice the face area [m²], shape [3, m]: a row for each axis, a quarter of the time of columns."""
    rows = np.ascontiguousarray(np.asarray(points).T, np.float64)
    origin, second, third = (rows.take(corner, axis=1) for corner in corners)
    second -= origin
    third -= origin
    out = np.empty_like(origin)
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(second[i], third[j], out=out[k])
        out[k] -= second[j] * third[i]
    return out


def _gather(per_face: np.ndarray, corners: np.ndarray, count: int) -> np.ndarray:
    """What each vertex gets from its faces, shape [count]."""
    total = np.zeros(count)
    for corner in corners:
        total += np.bincount(corner, per_face, count)
    return total
