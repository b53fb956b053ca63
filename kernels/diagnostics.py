"""Measures of a state: strain, speed, non-finite values, penetration, intersecting triangles. Sums in float64."""

import sys

import warp as wp

from .obstacle_contact import surface_point, to_float3
from .precision import OPTIONS, real, vec3
from .shapes import MESH, Placement, Shapes, distance, to_local

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


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

    Inside a mesh means a generalised winding number above one half (Jacobson et al. 2013); open meshes have no inside.
    """
    i = wp.tid()
    w = particle_world[i]
    deepest = real(0.0)
    for s in range(shapes.world_start[w], shapes.world_start[w + 1]):
        x = to_local(place[s], particle_q[i])
        if shapes.kind[s] == MESH:
            near = wp.mesh_query_point_sign_winding_number(shapes.mesh[s], to_float3(x), wp.float32(reach))
            if near.result and near.sign < 0.0:
                deepest = wp.max(deepest, wp.length(x - surface_point(shapes.mesh[s], near.face, near.u, near.v)))
        else:
            deepest = wp.max(deepest, -distance(shapes.kind[s], shapes.size[s], x)[3])
    depth_out[i] = deepest


@wp.func
def orientation(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d):
    """Six times the signed volume of the tetrahedron a, b, c, d [m³]."""
    return wp.dot(wp.cross(b - a, c - a), d - a)


@wp.func
def segment_crosses_triangle(p: wp.vec3d, q: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """True if the open segment p–q passes through the triangle, by the signs of five volumes."""
    zero = wp.float64(0.0)
    if orientation(a, b, c, p) * orientation(a, b, c, q) >= zero:
        return False
    u = orientation(p, q, a, b)
    v = orientation(p, q, b, c)
    w = orientation(p, q, c, a)
    return (u >= zero and v >= zero and w >= zero) or (u <= zero and v <= zero and w <= zero)


@wp.func
def corner(points: wp.array(dtype=vec3), indices: wp.array2d(dtype=wp.int32), t: int, k: int):
    x = points[indices[t, k]]
    return wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2]))


@wp.func
def edges_cross(points: wp.array(dtype=vec3), indices: wp.array2d(dtype=wp.int32), s: int, t: int):
    """True if an edge of triangle s passes through triangle t."""
    a = corner(points, indices, t, 0)
    b = corner(points, indices, t, 1)
    c = corner(points, indices, t, 2)
    for k in range(3):
        if segment_crosses_triangle(corner(points, indices, s, k), corner(points, indices, s, (k + 1) % 3), a, b, c):
            return True
    return False


@wp.kernel
def triangle_bounds(
    # Model
    tri_indices: wp.array2d(dtype=wp.int32),
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    lower_out: wp.array(dtype=wp.vec3),
    upper_out: wp.array(dtype=wp.vec3),
):
    """Axis-aligned box of every triangle, rounded outward to float32."""
    t = wp.tid()
    a = to_float3(particle_q[tri_indices[t, 0]])
    b = to_float3(particle_q[tri_indices[t, 1]])
    c = to_float3(particle_q[tri_indices[t, 2]])
    low = wp.min(wp.min(a, b), c)
    high = wp.max(wp.max(a, b), c)
    pad = wp.vec3(1.0e-6) + 1.0e-6 * wp.max(wp.abs(low), wp.abs(high))
    lower_out[t] = low - pad
    upper_out[t] = high + pad


@wp.kernel
def count_intersections(
    # Model
    tri_indices: wp.array2d(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    # State in
    particle_q: wp.array(dtype=vec3),
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    bvh: wp.uint64,
    # Out
    count_out: wp.array(dtype=wp.int32),
):
    """Adds to ``count_out[world]`` the pairs of triangles of one world that share no vertex and cross each other."""
    s = wp.tid()
    world = particle_world[tri_indices[s, 0]]
    query = wp.bvh_query_aabb(bvh, lower[s], upper[s])
    t = int(0)
    while wp.bvh_query_next(query, t):
        if t <= s or particle_world[tri_indices[t, 0]] != world:
            continue
        shared = int(0)
        for k in range(3):
            for m in range(3):
                if tri_indices[s, k] == tri_indices[t, m]:
                    shared += 1
        if shared == 0 and (
            edges_cross(particle_q, tri_indices, s, t) or edges_cross(particle_q, tri_indices, t, s)
        ):  # fmt: skip
            wp.atomic_add(count_out, world, 1)
