"""From triangles to particles, without atomics: every particle sums its triangles in the order of their numbers."""

import sys

import warp as wp

from .direct import int_at, put, vector_at
from .precision import OPTIONS, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.kernel
def add_corners(
    # Model
    thread_offset: int,
    particle_corner_start: wp.array(dtype=wp.int32),
    particle_corner_ids: wp.array(dtype=wp.int32),
    tri_corner_share: wp.array(dtype=vec3),
    # State in
    tri_vector: wp.array(dtype=vec3),
    # Out
    particle_out: wp.array(dtype=vec3),
):
    """Adds to each particle its share of each of its triangles; corner c is the (c mod 3)rd of triangle c/3."""
    i = thread_offset + wp.tid()
    total = vector_at(particle_out, i)
    for k in range(int_at(particle_corner_start, i), int_at(particle_corner_start, i + 1)):
        corner = int_at(particle_corner_ids, k)
        t = corner / 3
        total += vector_at(tri_corner_share, t)[corner - 3 * t] * vector_at(tri_vector, t)
    put(particle_out, i, total)
