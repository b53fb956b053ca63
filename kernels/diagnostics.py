"""Measures of a state: strain, speed, non-finite values, torn cloth, penetration. Sums in float64."""

import sys

import warp as wp

from .counting import count_up
from .obstacle_hit import surface_point, to_float3
from .precision import FORWARD_ONLY, real, vec3
from .shapes import MESH, Placement, Shapes, distance, to_local

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.kernel
def spring_strain(
    # Model
    spring_indices: wp.array(dtype=wp.vec2i),
    spring_rest_length: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    strain_out: wp.array(dtype=real),
):
    """|d|/r − 1 of every spring [-]."""
    s = wp.tid()
    ends = spring_indices[s]
    d = particle_q[ends[1]] - particle_q[ends[0]]
    strain_out[s] = wp.length(d) / spring_rest_length[s] - real(1.0)


@wp.kernel
def greatest_speed(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    # State in
    particle_qd: wp.array(dtype=vec3),
    # Out
    speed_out: wp.array(dtype=wp.float64),
):
    """Greatest speed of each world [m/s]."""
    i = wp.tid()
    v = particle_qd[i]
    wp.atomic_max(speed_out, particle_world[i], wp.sqrt(wp.float64(wp.dot(v, v))))


@wp.kernel
def frame_motion(
    # Model
    particle_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_before: wp.array(dtype=vec3),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    bad_out: wp.array(dtype=wp.int32),
    moment_out: wp.array2d(dtype=wp.float64),
):
    """Per world: number of non-finite particles; (Σ m d², Σ m) of the free ones, d [m] the way since ``before``."""
    i = wp.tid()
    w = particle_world[i]
    if not (wp.isfinite(particle_q[i]) and wp.isfinite(particle_qd[i])):
        wp.atomic_add(bad_out, w, 1)
        return
    if particle_inv_mass[i] > real(0.0):
        m = wp.float64(particle_mass[i])
        way = particle_q[i] - particle_before[i]
        wp.atomic_add(moment_out, w, 0, m * wp.float64(wp.dot(way, way)))
        wp.atomic_add(moment_out, w, 1, m)


@wp.kernel
def count_torn(
    # Model
    thread_offset: int,
    tri_indices: wp.array2d(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    particle_rest: wp.array(dtype=vec3),
    limit: real,
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    torn_out: wp.array(dtype=wp.int32),
):
    """Counts, per world, edges of triangles over ``limit`` times as long as the longest of theirs at rest, or of no
    number. The longest, as a sliver's shortest edge may well grow so far with hardly any strain around it."""
    t = thread_offset + wp.tid()
    longest = real(0.0)
    for k in range(3):
        rest = particle_rest[tri_indices[t, (k + 1) % 3]] - particle_rest[tri_indices[t, k]]
        longest = wp.max(longest, wp.length(rest))
    for k in range(3):
        edge = particle_q[tri_indices[t, (k + 1) % 3]] - particle_q[tri_indices[t, k]]
        if not wp.length(edge) <= limit * longest:
            count_up(torn_out, particle_world[tri_indices[t, k]], 1)


@wp.kernel
def penetration(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    shapes: Shapes,
    # State in
    particle_q: wp.array(dtype=vec3),
    place: wp.array(dtype=Placement),
    reach: real,
    # Out
    depth_out: wp.array(dtype=real),
):
    """Depth of each particle below the true surface of the solid it is deepest in [m]; 0 outside.

    Inside a mesh means a generalised winding number above one half (Jacobson et al. 2013); shells have no inside.
    """
    i = wp.tid()
    w = particle_world[i]
    deepest = real(0.0)
    for s in range(shapes.world_start[w], shapes.world_start[w + 1]):
        x = to_local(place[s], particle_q[i])
        if shapes.solid[s] == 0:
            continue
        if shapes.kind[s] == MESH:
            near = wp.mesh_query_point_sign_winding_number(shapes.mesh[s], to_float3(x), wp.float32(reach))
            if near.result and near.sign < 0.0:
                deepest = wp.max(deepest, wp.length(x - surface_point(shapes.mesh[s], near.face, near.u, near.v)))
        else:
            deepest = wp.max(deepest, -distance(shapes.kind[s], shapes.size[s], x)[3])
    depth_out[i] = deepest
