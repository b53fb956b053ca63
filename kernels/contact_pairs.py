"""Pairs that may touch: a point and a triangle (kind 0), or two edges (kind 1), of cloth and of obstacles with edges.

Both kinds are four particles, treated by the weights of ``kernels/closest.py``. Everything about contact is in float64
inside: there are few pairs, and the guard must not be fooled by rounding.
"""

import sys

import warp as wp

from .closest import combine, pair_weights
from .precision import OPTIONS, real, vec3
from .shapes import Placement, to_world

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.struct
class Pairs:
    """A list of pairs; ``count`` goes on beyond the arrays' length when they are too short, ``peak`` remembers it."""

    count: wp.array(dtype=wp.int32)
    peak: wp.array(dtype=wp.int32)
    kind: wp.array(dtype=wp.int32)
    particles: wp.array(dtype=wp.vec4i)
    side: wp.array(dtype=wp.vec3d)  # unit distance vector when the pair was found
    distance: wp.array(dtype=wp.float64)  # contact distance [m]


@wp.func
def wide(x: vec3):
    return wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2]))


@wp.func
def narrow(x: wp.vec3d):
    return vec3(real(x[0]), real(x[1]), real(x[2]))


@wp.func
def low_corner(x: vec3):
    return wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))


@wp.kernel
def place_points(
    # Model
    first: int,
    point_shape: wp.array(dtype=wp.int32),
    point_local: wp.array(dtype=wp.vec3),
    # State in
    place: wp.array(dtype=Placement),
    # Out
    particle_out: wp.array(dtype=vec3),
):
    """Obstacle vertices in the world, after the ``first`` particles."""
    k = wp.tid()
    x = point_local[k]
    particle_out[first + k] = to_world(place[point_shape[k]], vec3(real(x[0]), real(x[1]), real(x[2])))


@wp.kernel
def foresee(
    # State in
    particle_qd: wp.array(dtype=vec3),
    dt: real,
    # Out
    particle_out: wp.array(dtype=vec3),
):
    """Where particles would be after dt [s] at their velocities."""
    i = wp.tid()
    particle_out[i] = particle_out[i] + dt * particle_qd[i]


@wp.kernel
def swept_bounds(
    # Model
    tri_indices: wp.array2d(dtype=wp.int32),
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    margin: wp.float32,
    # Out
    lower_out: wp.array(dtype=wp.vec3),
    upper_out: wp.array(dtype=wp.vec3),
):
    """Box of every triangle on its straight way from one set of positions to another, grown by ``margin`` [m]."""
    t = wp.tid()
    low = low_corner(particle_from[tri_indices[t, 0]])
    high = low
    for k in range(3):
        i = tri_indices[t, k]
        a = low_corner(particle_from[i])
        b = low_corner(particle_to[i])
        low = wp.min(low, wp.min(a, b))
        high = wp.max(high, wp.max(a, b))
    pad = wp.vec3(margin, margin, margin) + 1.0e-6 * wp.max(wp.abs(low), wp.abs(high))
    lower_out[t] = low - pad
    upper_out[t] = high + pad


@wp.func
def add_pair(
    kind: int, i: wp.vec4i, start: wp.array(dtype=vec3), end: wp.array(dtype=vec3), rest: wp.array(dtype=vec3),
    radius: wp.array(dtype=real), body: wp.array(dtype=wp.int32), margin: wp.float64, cloth_particles: int,
    together: int, pairs: Pairs,
):  # fmt: skip
    """Adds the pair if it can come within ``margin`` while its points move from start to end.

    With ``together`` they move at the same time, so that only relative motion counts; else each in its own proportion.
    """
    x0 = wide(start[i[0]])
    x1 = wide(start[i[1]])
    x2 = wide(start[i[2]])
    x3 = wide(start[i[3]])
    w = pair_weights(kind, x0, x1, x2, x3)
    d = combine(w, x0, x1, x2, x3)
    length = wp.length(d)
    u0 = wide(end[i[0]]) - x0
    u1 = wide(end[i[1]]) - x1
    u2 = wide(end[i[2]]) - x2
    u3 = wide(end[i[3]]) - x3
    reach = margin + wp.length(combine(w, u0, u1, u2, u3))
    if together == 0:
        first = wp.length(u0)
        second = wp.max(wp.length(u2), wp.length(u3))
        if kind == 0:
            second = wp.max(second, wp.length(u1))
        else:
            first = wp.max(first, wp.length(u1))
        reach = margin + first + second
    if not length <= reach:  # nor where a diverged particle is not a number
        return
    contact = wp.float64(radius[i[0]]) + wp.float64(radius[i[3]])
    if i[0] >= cloth_particles or i[3] >= cloth_particles:
        # The obstacle response keeps particles at the full distance; only edges and corners between them come closer.
        contact = wp.float64(0.9) * contact
    if body[i[0]] == body[i[3]]:
        r0 = wide(rest[i[0]])
        r1 = wide(rest[i[1]])
        r2 = wide(rest[i[2]])
        r3 = wide(rest[i[3]])
        apart = wp.length(combine(pair_weights(kind, r0, r1, r2, r3), r0, r1, r2, r3))
        contact = wp.min(contact, wp.float64(0.5) * apart)
    n = wp.atomic_add(pairs.count, 0, 1)
    if n < pairs.kind.shape[0]:
        pairs.kind[n] = kind
        pairs.particles[n] = i
        pairs.distance[n] = contact
        pairs.side[n] = wp.normalize(d)


@wp.func
def has(t: wp.vec3i, i: int):
    return t[0] == i or t[1] == i or t[2] == i


@wp.func
def triangle(tri_indices: wp.array2d(dtype=wp.int32), t: int):
    return wp.vec3i(tri_indices[t, 0], tri_indices[t, 1], tri_indices[t, 2])


@wp.kernel
def find_pairs(
    # Model
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_owned: wp.array(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    particle_body: wp.array(dtype=wp.int32),
    particle_radius: wp.array(dtype=real),
    particle_rest: wp.array(dtype=vec3),
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    bvh: wp.uint64,
    margin: wp.float64,
    cloth_tris: int,
    cloth_particles: int,
    together: int,
    # Out
    pairs_out: Pairs,
):
    """Every point–triangle and edge–edge pair of two triangles whose boxes overlap, once; not of two obstacles.

    A vertex or edge is looked at by the one triangle that owns it (bits 0–2 and 3–5 of ``tri_owned``).
    """
    t = wp.tid()
    mine = triangle(tri_indices, t)
    owned = tri_owned[t]
    world = particle_world[mine[0]]
    query = wp.bvh_query_aabb(bvh, lower[t], upper[t])
    u = int(0)
    while wp.bvh_query_next(query, u):
        if u == t or (t >= cloth_tris and u >= cloth_tris):
            continue
        other = triangle(tri_indices, u)
        if particle_world[other[0]] != world:
            continue
        for k in range(3):
            if ((owned >> k) & 1) == 1 and not has(other, mine[k]):
                add_pair(
                    0, wp.vec4i(mine[k], other[0], other[1], other[2]), particle_from, particle_to, particle_rest,
                    particle_radius, particle_body, margin, cloth_particles, together, pairs_out,
                )  # fmt: skip
        if u < t:
            continue
        theirs = tri_owned[u]
        for k in range(3):
            if ((owned >> (k + 3)) & 1) == 1:
                a = mine[k]
                b = mine[(k + 1) % 3]
                for m in range(3):
                    c = other[m]
                    d = other[(m + 1) % 3]
                    if ((theirs >> (m + 3)) & 1) == 1 and a != c and a != d and b != c and b != d:
                        add_pair(
                            1, wp.vec4i(a, b, c, d), particle_from, particle_to, particle_rest, particle_radius,
                            particle_body, margin, cloth_particles, together, pairs_out,
                        )  # fmt: skip


@wp.kernel
def note_peak(
    # State in
    count: wp.array(dtype=wp.int32),
    # Out
    peak_out: wp.array(dtype=wp.int32),
):
    """Remembers the greatest count."""
    peak_out[0] = wp.max(peak_out[0], count[0])
