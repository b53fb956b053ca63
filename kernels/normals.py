"""Normals at the vertices of a triangulated surface, weighted by area; float64 holds the area of any triangle."""

import sys

import warp as wp

from .direct import int_at, vector_at
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.kernel
def area_vectors(
    # Model
    corners: wp.array(dtype=wp.int32),
    # State in
    points: wp.array(dtype=vec3),
    # Out
    tri_vector_out: wp.array(dtype=wp.vec3d),
):
    """Face normal × twice the face area [m²] of each triangle; corner c of triangle t is ``corners[3 t + c]``."""
    t = wp.tid()
    a = wp.vec3d(vector_at(points, int_at(corners, 3 * t)))
    b = wp.vec3d(vector_at(points, int_at(corners, 3 * t + 1)))
    c = wp.vec3d(vector_at(points, int_at(corners, 3 * t + 2)))
    tri_vector_out[t] = wp.cross(b - a, c - a)


@wp.kernel
def vertex_normals(
    # Model
    vertex_start: wp.array(dtype=wp.int32),
    vertex_triangle: wp.array(dtype=wp.int32),
    # State in
    tri_vector: wp.array(dtype=wp.vec3d),
    # Out
    normal_out: wp.array(dtype=vec3),
):
    """Unit normals; (0, 0, 1) where area vectors cancel or no triangle touches the vertex."""
    i = wp.tid()
    total = wp.vec3d()
    for k in range(int_at(vertex_start, i), int_at(vertex_start, i + 1)):
        total += tri_vector[int_at(vertex_triangle, k)]
    length = wp.length(total)
    normal = vec3(real(0.0), real(0.0), real(1.0))
    if length > wp.float64(0.0):
        normal = vec3(total / length)
    normal_out[i] = normal
