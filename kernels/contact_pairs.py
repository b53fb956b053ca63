"""Pairs that may touch: a point and a triangle (kind 0), or two edges (kind 1), of cloth and of obstacles with edges.

Both kinds are four particles, treated by the weights of ``kernels/closest.py``. Everything about contact is in float64
inside: there are few pairs, and the guard must not be fooled by rounding.
"""

import sys

import warp as wp

from .closest import combine, from_mean, pair_weights, reach_of
from .contact_candidates import TrianglePairs, has, length_of
from .contact_culling import triangles_apart, ways_apart
from .contact_ways import Way, may_meet
from .counting import count_up
from .direct import int_at, pair_at, triple_at
from .precision import FORWARD_ONLY, real, vec3, vec4
from .shapes import Placement, to_world

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.struct
class Pairs:
    """A list of pairs; ``count`` goes on beyond the arrays' length when they are too short, ``peak`` remembers it."""

    count: wp.array(dtype=wp.int32)
    peak: wp.array(dtype=wp.int32)
    kind: wp.array(dtype=wp.int32)
    particles: wp.array(dtype=wp.vec4i)
    side: wp.array(dtype=vec3)  # unit distance vector when the pair was found
    distance: wp.array(dtype=real)  # contact distance [m]


@wp.struct
class Contacts:
    """What is known of pairs that touch: weights, unit normal, and by how much they are too close [m], else 0 or less.

    As precise as particles are, though reckoned in float64: memory counts, and rounding is no more than theirs.
    """

    weights: wp.array(dtype=vec4)
    normal: wp.array(dtype=vec3)
    depth: wp.array(dtype=real)


@wp.func
def wide(x: vec3):
    return wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2]))


@wp.func
def narrow(x: wp.vec3d):
    return vec3(real(x[0]), real(x[1]), real(x[2]))


@wp.func
def put_contact(contacts_out: Contacts, k: int, w: wp.vec4d, n: wp.vec3d):
    """Weights and normal of pair k."""
    contacts_out.weights[k] = vec4(real(w[0]), real(w[1]), real(w[2]), real(w[3]))
    contacts_out.normal[k] = narrow(n)


@wp.func
def weights_of(contacts: Contacts, k: int):
    w = contacts.weights[k]
    return wp.vec4d(wp.float64(w[0]), wp.float64(w[1]), wp.float64(w[2]), wp.float64(w[3]))


@wp.func
def four_of(points: wp.array(dtype=vec3), i: wp.vec4i):
    """The points of a pair."""
    return wp.matrix_from_rows(wide(points[i[0]]), wide(points[i[1]]), wide(points[i[2]]), wide(points[i[3]]))


@wp.func
def relative_motion(start: wp.array(dtype=vec3), end: wp.array(dtype=vec3), i: wp.vec4i, w: wp.vec4d):
    """Σ wₖ (end − start) [m]."""
    total = wp.vec3d()
    for m in range(4):
        total += w[m] * (wide(end[i[m]]) - wide(start[i[m]]))
    return total


@wp.kernel
def place_points(
    # Model
    thread_offset: int,
    first: int,
    point_shape: wp.array(dtype=wp.int32),
    point_local: wp.array(dtype=wp.vec3),
    # State in
    place: wp.array(dtype=Placement),
    # Out
    particle_out: wp.array(dtype=vec3),
):
    """Obstacle vertices in the world, after the ``first`` particles."""
    k = thread_offset + wp.tid()
    x = point_local[k]
    particle_out[first + k] = to_world(place[point_shape[k]], vec3(real(x[0]), real(x[1]), real(x[2])))


@wp.kernel
def foresee(
    # State in
    thread_offset: int,
    particle_qd: wp.array(dtype=vec3),
    dt: real,
    # Out
    particle_out: wp.array(dtype=vec3),
):
    """Where particles would be after dt [s] at their velocities."""
    i = thread_offset + wp.tid()
    particle_out[i] = particle_out[i] + dt * particle_qd[i]


@wp.func
def add_pair(
    kind: int, i: wp.vec4i, start: wp.array(dtype=vec3), end: wp.array(dtype=vec3), rest: wp.array(dtype=vec3),
    radius: wp.array(dtype=real), body: wp.array(dtype=wp.int32), margin: wp.float64, cloth_particles: int,
    leeway: wp.float64, pairs: Pairs,
):  # fmt: skip
    """Adds the pair if it can come within ``margin`` while its points move from start to end, all at the same time.

    With a ``leeway`` below 1 the closest points are taken along their way, and of other motion only that share counts.
    """
    x = four_of(start, i)
    u = from_mean(four_of(end, i) - x)
    w = pair_weights(kind, x)
    d = combine(w, x)
    nearest = wp.length(d)
    if leeway < wp.float64(1.0):
        way = combine(w, u)
        t = -wp.dot(d, way) / wp.max(wp.dot(way, way), wp.float64(1.0e-30))
        nearest = wp.length(d + wp.clamp(t, wp.float64(0.0), wp.float64(1.0)) * way)
    if not nearest <= margin + leeway * reach_of(kind, u):  # nor where a diverged particle is not a number
        return
    contact = wp.float64(radius[i[0]]) + wp.float64(radius[i[3]])
    if i[0] >= cloth_particles or i[3] >= cloth_particles:
        # The obstacle response keeps particles at the full distance; only edges and corners between them come closer.
        contact = wp.float64(0.9) * contact
    if body[i[0]] == body[i[3]]:
        r = four_of(rest, i)
        at_rest = wp.length(combine(pair_weights(kind, r), r))
        contact = wp.min(contact, wp.float64(0.5) * at_rest)
    n = count_up(pairs.count, 0, 1)
    if n < pairs.kind.shape[0]:
        pairs.kind[n] = kind
        pairs.particles[n] = i
        pairs.distance[n] = real(contact)
        pairs.side[n] = narrow(wp.normalize(d))


@wp.func
def feature_pair(f: int, t: wp.vec3i, u: wp.vec3i):
    """Of two triangles' fifteen pairs of features the f-th: three corners of t with u, three of u with t, the edges."""
    if f < 3:
        return wp.vec4i(t[f], u[0], u[1], u[2])
    if f < 6:
        return wp.vec4i(u[f - 3], t[0], t[1], t[2])
    k = (f - 6) / 3
    m = (f - 6) % 3
    return wp.vec4i(t[k], t[(k + 1) % 3], u[m], u[(m + 1) % 3])


@wp.func
def owned_pairs(t: int, u: int):
    """Which pairs of :func:`feature_pair` are of features that both triangles own, as bits; ``t``, ``u``: theirs."""
    edges = u >> 3
    return (t & 7) | ((u & 7) << 3) | edges * (((t >> 3) & 1) << 6 | ((t >> 4) & 1) << 9 | ((t >> 5) & 1) << 12)


@wp.func
def share_corner(kind: int, i: wp.vec4i):
    """Whether a particle belongs to both features."""
    if kind == 0:
        return i[0] == i[1] or i[0] == i[2] or i[0] == i[3]
    return i[0] == i[2] or i[0] == i[3] or i[1] == i[2] or i[1] == i[3]


@wp.func
def add_features(
    t: int, u: int, tri_indices: wp.array2d(dtype=wp.int32), tri_owned: wp.array(dtype=wp.int32),
    body: wp.array(dtype=wp.int32), radius: wp.array(dtype=real), rest: wp.array(dtype=vec3),
    start: wp.array(dtype=vec3), end: wp.array(dtype=vec3), margin: wp.float64, radii: wp.float64,
    cloth_particles: int, leeway: wp.float64, pairs: Pairs,
):  # fmt: skip
    """The pairs of two triangles' features. One of the two looks at a vertex or edge: the one that owns it (bits 0–2
    and 3–5 of ``tri_owned``)."""
    mine = triple_at(tri_indices, t)
    other = triple_at(tri_indices, u)
    near = margin + radii * (wp.float64(radius[mine[0]]) + wp.float64(radius[other[0]]))
    if triangles_apart(mine, other, start, end, real(near), real(leeway)):
        return
    left = owned_pairs(tri_owned[t], tri_owned[u])
    f = int(-1)
    while left != 0:
        f += 1
        mine_too = left & 1
        left = left >> 1
        i = feature_pair(f, mine, other)
        kind = wp.where(f < 6, 0, 1)
        if mine_too == 0 or share_corner(kind, i):
            continue
        if not ways_apart(kind, i, start, end, wp.float32(near)):
            add_pair(kind, i, start, end, rest, radius, body, near, cloth_particles, leeway, pairs)


@wp.kernel
def find_pairs(
    # Model
    thread_offset: int,
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_owned: wp.array(dtype=wp.int32),
    particle_body: wp.array(dtype=wp.int32),
    particle_radius: wp.array(dtype=real),
    particle_rest: wp.array(dtype=vec3),
    stride: int,
    # State in
    candidates: TrianglePairs,
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    way: wp.array(dtype=Way),
    tri_active: wp.array(dtype=wp.int32),
    margin: wp.float64,
    radii: wp.float64,
    cloth_particles: int,
    leeway: wp.float64,
    # Out
    pairs_out: Pairs,
):
    """Every point–triangle and edge–edge pair of the candidates that can come within ``margin`` [m] and so many
    ``radii`` of both, once.

    One triangle of the two must be active. The triangles' ways hold at least half the margin, and their radii.
    """
    stray = wp.where(leeway < wp.float64(1.0), wp.float32(leeway), wp.float32(0.0))
    for n in range(thread_offset + wp.tid(), length_of(candidates), stride):
        pair = pair_at(candidates.pair, n)
        t = pair[0]
        u = pair[1]
        if t < 0:
            continue
        if (int_at(tri_active, t) | int_at(tri_active, u)) == 0:
            continue
        if may_meet(way[t], way[u], stray):
            add_features(
                t, u, tri_indices, tri_owned, particle_body, particle_radius, particle_rest, particle_from,
                particle_to, margin, radii, cloth_particles, leeway, pairs_out,
            )  # fmt: skip


@wp.func
def common_vertices(t: wp.vec3i, u: wp.vec3i):
    """The first and the last vertex that two triangles have in common, which have at least one."""
    first = int(2147483647)
    last = int(-1)
    for k in range(3):
        if has(u, t[k]):
            first = wp.min(first, t[k])
            last = wp.max(last, t[k])
    return wp.vec2i(first, last)


@wp.kernel
def find_fan_pairs(
    # Model
    thread_offset: int,
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_owned: wp.array(dtype=wp.int32),
    particle_body: wp.array(dtype=wp.int32),
    particle_radius: wp.array(dtype=real),
    particle_rest: wp.array(dtype=vec3),
    particle_corner_start: wp.array(dtype=wp.int32),
    particle_corner_ids: wp.array(dtype=wp.int32),
    stride: int,
    # State in
    flat: wp.array(dtype=wp.int32),
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    tri_active: wp.array(dtype=wp.int32),
    margin: wp.float64,
    radii: wp.float64,
    cloth_particles: int,
    leeway: wp.float64,
    # Out
    pairs_out: Pairs,
):
    """The same of triangles with common vertices none of whose fans is flat (``contact_fans.py``), which are looked at
    from the first of these."""
    for i in range(thread_offset + wp.tid(), particle_corner_start.shape[0] - 1, stride):
        if flat[i] == 1:
            continue
        last = particle_corner_start[i + 1]
        for m in range(particle_corner_start[i], last):
            t = particle_corner_ids[m] / 3
            for n in range(m + 1, last):
                u = particle_corner_ids[n] / 3
                common = common_vertices(triple_at(tri_indices, t), triple_at(tri_indices, u))
                if common[0] == i and flat[common[1]] == 0 and (tri_active[t] | tri_active[u]) == 1:
                    add_features(
                        t, u, tri_indices, tri_owned, particle_body, particle_radius, particle_rest,
                        particle_from, particle_to, margin, radii, cloth_particles, leeway, pairs_out,
                    )  # fmt: skip
