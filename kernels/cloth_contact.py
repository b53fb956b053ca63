"""Cloth against cloth: candidate pairs, their response in each step, and the guard that no motion may pass.

A pair is four particles and a kind: 0, a point and a triangle; 1, two edges. Both are treated by the weights of
``kernels/closest.py``. Everything here is in float64 inside: few pairs, and the guard must not be fooled by rounding.
"""

import sys

import warp as wp

from .closest import combine, pair_weights, time_of_impact
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


# Sums over pairs are taken in fixed point: integers add up to the same whatever the order of the pairs, so the result
# depends neither on the tree's shape, nor on the other worlds, nor on the device's threads.
MOVE_UNIT = wp.constant(wp.float64(2.0**50))  # per metre: up to 8 km by 1e-15 m
KICK_UNIT = wp.constant(wp.float64(2.0**40))  # per m/s: up to 8e6 m/s by 1e-12 m/s
SHARE_UNIT = wp.constant(wp.float64(2.0**40))


@wp.func
def add_fixed(sums_out: wp.array2d(dtype=wp.int64), i: int, x: wp.vec3d, unit: wp.float64):
    """Adds x to row i."""
    for m in range(3):
        wp.atomic_add(sums_out, i, m, wp.int64(wp.round(unit * x[m])))


@wp.func
def from_fixed(sums: wp.array2d(dtype=wp.int64), i: int, unit: wp.float64):
    """Row i as a vector."""
    return wp.vec3d(wp.float64(sums[i, 0]), wp.float64(sums[i, 1]), wp.float64(sums[i, 2])) / unit


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
def find_contacts(
    # Model
    pairs: Pairs,
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    weights_out: wp.array(dtype=wp.vec4d),
    normal_out: wp.array(dtype=wp.vec3d),
    depth_out: wp.array(dtype=wp.float64),
    share_out: wp.array(dtype=wp.int64),
):
    """Which pairs are closer than their contact distance: weights, normal, depth [m]; and Σ |weight| per particle."""
    k = wp.tid()
    if k >= wp.min(pairs.count[0], pairs.kind.shape[0]):
        return
    i = pairs.particles[k]
    x0 = wide(particle_q[i[0]])
    x1 = wide(particle_q[i[1]])
    x2 = wide(particle_q[i[2]])
    x3 = wide(particle_q[i[3]])
    zero = wp.float64(0.0)
    w = pair_weights(pairs.kind[k], x0, x1, x2, x3)
    d = combine(w, x0, x1, x2, x3)
    length = wp.length(d)
    n = pairs.side[k]
    # Through each other are only features whose closest points lie inside both; past a border d may turn as it likes.
    inside = w[0] != zero and w[1] != zero and w[2] != zero and w[3] != zero
    if length > wp.float64(1.0e-3) * pairs.distance[k]:
        if inside and wp.dot(d, n) < zero:
            n = -d / length
        else:
            n = d / length
    depth = pairs.distance[k] - wp.dot(d, n)
    depth_out[k] = depth
    if depth > zero:
        weights_out[k] = w
        normal_out[k] = n
        for m in range(4):
            wp.atomic_add(share_out, i[m], wp.int64(wp.round(SHARE_UNIT * wp.abs(w[m]))))


@wp.kernel
def push_contacts(
    # Model
    particle_inv_mass: wp.array(dtype=real),
    particle_friction: wp.array(dtype=real),
    pairs: Pairs,
    # State in
    particle_start: wp.array(dtype=vec3),
    particle_q: wp.array(dtype=vec3),
    dt: wp.float64,
    weights: wp.array(dtype=wp.vec4d),
    normal: wp.array(dtype=wp.vec3d),
    depth: wp.array(dtype=wp.float64),
    share: wp.array(dtype=wp.int64),
    # Out
    move_out: wp.array2d(dtype=wp.int64),
    kick_out: wp.array2d(dtype=wp.int64),
):
    """Positions leave the contact; velocities lose what brought them there; friction acts within Coulomb's cone.

    All pairs act at once (Jacobi), each by the part that keeps them together from overshooting: its diagonal over the
    sum of its row in the contact matrix J M⁻¹ Jᵀ. As it is one number for all four particles, momentum is conserved.
    A pair's part of the depth goes to the positions and, as far as the pair approached in this step, over dt to the
    velocities: contact stops what comes, but throws nothing back. Friction takes up to μ times that push from the
    tangential displacement. (Measured on a pile of four sheets at rest, root mean square velocity that the positions do
    not have: 0.12 m/s with the part of the approach instead, 0.012 m/s so.)
    """
    k = wp.tid()
    if k >= wp.min(pairs.count[0], pairs.kind.shape[0]):
        return
    if depth[k] <= wp.float64(0.0):
        return
    i = pairs.particles[k]
    w = weights[k]
    n = normal[k]
    zero = wp.float64(0.0)
    effective = zero
    crowd = zero
    moved = wp.vec3d()
    for m in range(4):
        mobility = wp.float64(particle_inv_mass[i[m]])
        effective += w[m] * w[m] * mobility
        crowd += wp.abs(w[m]) * mobility * wp.float64(share[i[m]]) / SHARE_UNIT
        moved += w[m] * (wide(particle_q[i[m]]) - wide(particle_start[i[m]]))
    if effective <= zero:
        return
    part = effective / crowd
    depth_share = part * depth[k]
    push = wp.min(depth_share, wp.max(-wp.dot(moved, n), zero))
    tangential = moved - wp.dot(moved, n) * n
    slip = wp.length(tangential)
    friction = wp.sqrt(wp.float64(particle_friction[i[0]]) * wp.float64(particle_friction[i[3]]))
    lost = zero
    if slip > zero:
        lost = wp.min(friction * push / (part * slip), wp.float64(1.0))
    slide = (lost * part) * tangential
    kick = (push * n - slide) / (effective * dt)
    move = (depth_share * n - slide) / effective
    for m in range(4):
        c = w[m] * wp.float64(particle_inv_mass[i[m]])
        add_fixed(move_out, i[m], c * move, MOVE_UNIT)
        add_fixed(kick_out, i[m], c * kick, KICK_UNIT)


@wp.kernel
def commit_push(
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
    move_out: wp.array2d(dtype=wp.int64),
    kick_out: wp.array2d(dtype=wp.int64),
    share_out: wp.array(dtype=wp.int64),
):
    """Adds what the contacts ask for, and clears the sums for the next round."""
    i = wp.tid()
    if share_out[i] > wp.int64(0):
        particle_q_out[i] = narrow(wide(particle_q_out[i]) + from_fixed(move_out, i, MOVE_UNIT))
        particle_qd_out[i] = narrow(wide(particle_qd_out[i]) + from_fixed(kick_out, i, KICK_UNIT))
        share_out[i] = wp.int64(0)
        for m in range(3):
            move_out[i, m] = wp.int64(0)
            kick_out[i, m] = wp.int64(0)


@wp.kernel
def limit_motion(
    # Model
    particle_inv_mass: wp.array(dtype=real),
    pairs: Pairs,
    separation: wp.float64,
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    fraction: wp.array(dtype=wp.float64),
    # Out
    fraction_out: wp.array(dtype=wp.float64),
    held_back_out: wp.array(dtype=wp.int32),
    counts_out: wp.array(dtype=wp.int32),
):
    """For each pair that would meet on its way: its particles may go only as far as the meeting.

    Counts the particles that had to be held back further than before, and pairs that are pinched: they meet though
    none of them can be held back any more, as what moves is prescribed.
    """
    k = wp.tid()
    if k >= wp.min(pairs.count[0], pairs.kind.shape[0]):
        return
    i = pairs.particles[k]
    x0 = wide(particle_from[i[0]])
    x1 = wide(particle_from[i[1]])
    x2 = wide(particle_from[i[2]])
    x3 = wide(particle_from[i[3]])
    u0 = fraction[i[0]] * (wide(particle_to[i[0]]) - x0)
    u1 = fraction[i[1]] * (wide(particle_to[i[1]]) - x1)
    u2 = fraction[i[2]] * (wide(particle_to[i[2]]) - x2)
    u3 = fraction[i[3]] * (wide(particle_to[i[3]]) - x3)
    t = time_of_impact(pairs.kind[k], x0, x1, x2, x3, u0, u1, u2, u3, separation)
    if not t < wp.float64(1.0):
        return
    held = int(0)
    for m in range(4):
        f = fraction[i[m]]
        if particle_inv_mass[i[m]] > real(0.0) and f > wp.float64(0.0):
            g = wp.float64(0.9) * t * f
            if g < wp.float64(0.02):
                g = wp.float64(0.0)
            wp.atomic_min(fraction_out, i[m], g)
            held += 1
    if held > 0:
        wp.atomic_add(held_back_out, 0, held)
    else:
        wp.atomic_add(counts_out, 1, 1)


@wp.kernel
def count_torn(
    # Model
    tri_indices: wp.array2d(dtype=wp.int32),
    particle_rest: wp.array(dtype=vec3),
    limit: wp.float64,
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    torn_out: wp.array(dtype=wp.int32),
):
    """Counts triangles with an edge more than ``limit`` times as long as at rest, or of no number."""
    t = wp.tid()
    for k in range(3):
        a = tri_indices[t, k]
        b = tri_indices[t, (k + 1) % 3]
        rest = wp.length(wide(particle_rest[b]) - wide(particle_rest[a]))
        if not wp.length(wide(particle_q[b]) - wide(particle_q[a])) <= limit * rest:
            wp.atomic_add(torn_out, 0, 1)


@wp.kernel
def note_peak(
    # State in
    count: wp.array(dtype=wp.int32),
    # Out
    peak_out: wp.array(dtype=wp.int32),
):
    """Remembers the greatest count."""
    peak_out[0] = wp.max(peak_out[0], count[0])


@wp.kernel
def apply_limit(
    # State in
    particle_from: wp.array(dtype=vec3),
    fraction: wp.array(dtype=wp.float64),
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
    counts_out: wp.array(dtype=wp.int32),
):
    """Held-back particles stop where they may, and keep as much of their speed as of their way."""
    i = wp.tid()
    f = fraction[i]
    if f < wp.float64(1.0):
        x = wide(particle_from[i])
        particle_q_out[i] = narrow(x + f * (wide(particle_q_out[i]) - x))
        particle_qd_out[i] = real(f) * particle_qd_out[i]
        wp.atomic_add(counts_out, 0, 1)
