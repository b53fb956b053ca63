"""Candidates: pairs of triangles that may come near each other, kept while every triangle stays in its known box.

Each triangle has a *known* box; all pairs of triangles whose known boxes overlap are listed. As long as a triangle, on
its way, stays in its known box, nothing about it can be missing from the list. A triangle that leaves it gets a new
box, with room to spare, and only its pairs are looked up again. Cloth that lies still costs nothing but the check.
"""

import sys

import warp as wp

from .counting import count_up
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.struct
class TrianglePairs:
    """A list of pairs of triangles; ``count`` goes on beyond its length when it is too short, ``peak`` remembers it."""

    count: wp.array(dtype=wp.int32)
    peak: wp.array(dtype=wp.int32)
    pair: wp.array(dtype=wp.vec2i)


@wp.func
def low_corner(x: vec3):
    return wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))


@wp.func
def padding(margin: float, low: wp.vec3, high: wp.vec3):
    """``margin`` [m] and the rounding of float32."""
    return wp.vec3(margin) + 1.0e-6 * wp.max(wp.abs(low), wp.abs(high))


@wp.func
def triangle(tri_indices: wp.array2d(dtype=wp.int32), t: int):
    return wp.vec3i(tri_indices[t, 0], tri_indices[t, 1], tri_indices[t, 2])


@wp.func
def has(t: wp.vec3i, i: int):
    return t[0] == i or t[1] == i or t[2] == i


@wp.func
def common_vertex(t: wp.vec3i, u: wp.vec3i):
    return has(t, u[0]) or has(t, u[1]) or has(t, u[2])


@wp.kernel
def sum_drift(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    share: wp.array(dtype=wp.float64),
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    # Out
    drift_out: wp.array(dtype=wp.vec3d),
):
    """Adds to each world's mean motion [m] that of its particles; ``share`` is one over their number."""
    i = wp.tid()
    d = particle_to[i] - particle_from[i]
    w = particle_world[i]
    wp.atomic_add(drift_out, w, share[w] * wp.vec3d(wp.float64(d[0]), wp.float64(d[1]), wp.float64(d[2])))


@wp.kernel
def remove_drift(
    # Model
    thread_offset: int,
    particle_world: wp.array(dtype=wp.int32),
    # State in
    particle_to: wp.array(dtype=vec3),
    drift: wp.array(dtype=wp.vec3d),
    # Out
    particle_out: wp.array(dtype=vec3),
):
    """Ends of ways as seen by who moves with the mean of the world: cloth that falls does not sweep."""
    i = thread_offset + wp.tid()
    d = drift[particle_world[i]]
    particle_out[i] = particle_to[i] - vec3(real(d[0]), real(d[1]), real(d[2]))


@wp.kernel
def swept_bounds(
    # Model
    thread_offset: int,
    tri_indices: wp.array2d(dtype=wp.int32),
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    active: wp.array(dtype=wp.int32),
    margin: float,
    room: float,
    # Out
    lower_out: wp.array(dtype=wp.vec3),
    upper_out: wp.array(dtype=wp.vec3),
    known_lower_out: wp.array(dtype=wp.vec3),
    known_upper_out: wp.array(dtype=wp.vec3),
    moved_out: wp.array(dtype=wp.int32),
    any_moved_out: wp.array(dtype=wp.int32),
    tri_active_out: wp.array(dtype=wp.int32),
):
    """Box of every triangle on its straight way from one set of positions to another, grown by ``margin`` [m].

    Where the known box does not hold it, that becomes the same with ``room`` [m] more, and ``moved`` is 1, else 0.
    A triangle is active if one of its corners is; of others the way is the same as it was.
    """
    t = thread_offset + wp.tid()
    corners = triangle(tri_indices, t)
    looked_at = active[corners[0]] | active[corners[1]] | active[corners[2]]
    tri_active_out[t] = looked_at
    moved_out[t] = 0
    if looked_at == 0:
        return
    low = low_corner(particle_from[corners[0]])
    high = low
    for k in range(3):
        i = corners[k]
        a = low_corner(particle_from[i])
        b = low_corner(particle_to[i])
        low = wp.min(low, wp.min(a, b))
        high = wp.max(high, wp.max(a, b))
    pad = padding(margin, low, high)
    low = low - pad
    high = high + pad
    lower_out[t] = low
    upper_out[t] = high
    known_low = known_lower_out[t]
    known_high = known_upper_out[t]
    inside = int(1)
    for k in range(3):
        if not (low[k] >= known_low[k] and high[k] <= known_high[k]):
            inside = 0
    if inside == 0:
        moved_out[t] = 1
        any_moved_out[0] = 1
        known_lower_out[t] = low - wp.vec3(room)
        known_upper_out[t] = high + wp.vec3(room)


@wp.kernel
def keep_pairs(
    # Model
    thread_offset: int,
    stride: int,
    # State in
    old: TrianglePairs,
    moved: wp.array(dtype=wp.int32),
    # Out
    pairs_out: TrianglePairs,
):
    """Copies the pairs of two triangles that have not moved."""
    for k in range(thread_offset + wp.tid(), wp.min(old.count[0], old.pair.shape[0]), stride):
        pair = old.pair[k]
        if moved[pair[0]] == 0 and moved[pair[1]] == 0:
            n = count_up(pairs_out.count, 0, 1)
            if n < pairs_out.pair.shape[0]:
                pairs_out.pair[n] = pair


@wp.kernel
def find_triangle_pairs(
    # Model
    thread_offset: int,
    tri_indices: wp.array2d(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    cloth_tris: int,
    # State in
    moved: wp.array(dtype=wp.int32),
    known_lower: wp.array(dtype=wp.vec3),
    known_upper: wp.array(dtype=wp.vec3),
    bvh: wp.uint64,
    # Out
    pairs_out: TrianglePairs,
):
    """Adds all pairs of the triangles that have moved, once each: of one world, not of two obstacles, without
    common vertices."""
    t = thread_offset + wp.tid()
    if moved[t] == 0:
        return
    world = particle_world[tri_indices[t, 0]]
    query = wp.bvh_query_aabb(bvh, known_lower[t], known_upper[t], wp.bvh_get_group_root(bvh, world))
    u = int(0)
    while wp.bvh_query_next(query, u):
        if u == t or (t >= cloth_tris and u >= cloth_tris) or (moved[u] == 1 and u < t):
            continue
        if not common_vertex(triangle(tri_indices, t), triangle(tri_indices, u)):
            n = count_up(pairs_out.count, 0, 1)
            if n < pairs_out.pair.shape[0]:
                pairs_out.pair[n] = wp.vec2i(wp.min(t, u), wp.max(t, u))  # in an order that does not tell what moved


@wp.kernel
def note_peak(
    # State in
    count: wp.array(dtype=wp.int32),
    # Out
    peak_out: wp.array(dtype=wp.int32),
):
    """Remembers the greatest count."""
    peak_out[0] = wp.max(peak_out[0], count[0])
