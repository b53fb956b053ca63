"""Which triangles intersect: closed triangles, so that touching counts, by exact signs throughout."""

import sys

import warp as wp

from .contact_candidates import has
from .contact_ways import padding
from .direct import triple_at
from .exact_sign import side, turn
from .precision import FORWARD_ONLY, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

CLEAR = wp.constant(wp.float64(1.0e-12))  # of the sizes of what is subtracted; rounding takes some 1e-15


@wp.func
def flattened(x: wp.vec3d, axis: int):
    """Without the coordinate ``axis``."""
    return wp.vec2d(x[(axis + 1) % 3], x[(axis + 2) % 3])


@wp.func
def overlap(a: wp.vec2d, b: wp.vec2d, c: wp.vec2d, d: wp.vec2d):
    """Whether the boxes of two segments meet."""
    low = wp.max(wp.min(a, b), wp.min(c, d))
    high = wp.min(wp.max(a, b), wp.max(c, d))
    return low[0] <= high[0] and low[1] <= high[1]


@wp.func
def segments_meet_flat(a: wp.vec2d, b: wp.vec2d, c: wp.vec2d, d: wp.vec2d):
    """Whether the closed segments a–b and c–d meet in the plane."""
    return turn(a, b, c) * turn(a, b, d) <= 0 and turn(c, d, a) * turn(c, d, b) <= 0 and overlap(a, b, c, d)


@wp.func
def coplanar_segments_meet(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d):
    """Whether closed segments in one plane meet: if and only if they do along each axis.

    At least one view shows a plane without folding it, and the overlap of boxes settles what lies on one line.
    """
    axes = int(3)  # no constant: loops over exact signs, unrolled, compile for minutes
    for axis in range(axes):
        if not segments_meet_flat(flattened(a, axis), flattened(b, axis), flattened(c, axis), flattened(d, axis)):
            return False
    return True


@wp.func
def inside_flat(p: wp.vec2d, a: wp.vec2d, b: wp.vec2d, c: wp.vec2d):
    """Whether p lies in the closed triangle; in one without area, at least in its box."""
    low = wp.min(wp.min(a, b), c)
    high = wp.max(wp.max(a, b), c)
    if not (low[0] <= p[0] and p[0] <= high[0] and low[1] <= p[1] and p[1] <= high[1]):
        return False
    least = int(1)
    most = int(-1)
    edges = int(3)
    start = a
    end = b
    for k in range(edges):
        sign = turn(start, end, p)
        least = wp.min(least, sign)
        most = wp.max(most, sign)
        start = end
        end = wp.where(k == 0, c, a)
    return least >= 0 or most <= 0


@wp.func
def coplanar_inside(p: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Whether p lies in the closed triangle in whose plane it is."""
    axes = int(3)
    for axis in range(axes):
        if not inside_flat(flattened(p, axis), flattened(a, axis), flattened(b, axis), flattened(c, axis)):
            return False
    return True


@wp.func
def coplanar_meets(p: wp.vec3d, q: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Whether the closed segment p–q meets the closed triangle, both in one plane or the triangle without area."""
    edges = int(3)
    start = a
    end = b
    for k in range(edges):
        if side(p, q, start, end) == 0 and coplanar_segments_meet(p, q, start, end):
            return True
        start = end
        end = wp.where(k == 0, c, a)
    return coplanar_inside(p, a, b, c)


@wp.func
def parted_along(m: wp.vec3d, p: wp.vec3d, q: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Whether p and q lie further along m than a, b and c do, by more than rounding can have done."""
    u = wp.dot(b - a, m)
    v = wp.dot(c - a, m)
    x = wp.dot(p - a, m)
    y = wp.dot(q - a, m)
    size = wp.max(wp.max(wp.abs(b - a), wp.abs(c - a)), wp.max(wp.abs(p - a), wp.abs(q - a)))
    return wp.min(x, y) - wp.max(wp.max(u, v), wp.float64(0.0)) > CLEAR * wp.dot(size, wp.abs(m))


@wp.func
def clearly_apart(p: wp.vec3d, q: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Whether a segment lies beyond one side of a triangle, plain to see: most neighbours in a flat sheet do.

    Exact signs of what is in one plane are zeros, which take the longest.
    """
    n = wp.cross(b - a, c - a)
    return (
        parted_along(wp.cross(b - a, n), p, q, a, b, c)
        or parted_along(wp.cross(c - b, n), p, q, a, b, c)
        or parted_along(wp.cross(a - c, n), p, q, a, b, c)
    )


@wp.func
def passes_within(p: wp.vec3d, q: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Whether the line p–q has all edges of a triangle, whose plane it crosses, on one side or meets them."""
    least = int(1)
    most = int(-1)
    edges = int(3)
    start = a
    end = b
    for k in range(edges):
        sign = side(p, q, start, end)
        least = wp.min(least, sign)
        most = wp.max(most, sign)
        start = end
        end = wp.where(k == 0, c, a)
    return least >= 0 or most <= 0


@wp.func
def segment_meets_triangle(p: wp.vec3d, q: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Whether the closed segment p–q and the closed triangle have a point in common."""
    if clearly_apart(p, q, a, b, c):
        return False
    s = side(a, b, c, p)
    t = side(a, b, c, q)
    if s * t > 0:
        return False
    if s == 0 and t == 0:
        return coplanar_meets(p, q, a, b, c)
    return passes_within(p, q, a, b, c)


@wp.func
def point(points: wp.array(dtype=vec3), i: int):
    x = points[i]
    return wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2]))


@wp.func
def edges_meet(points: wp.array(dtype=vec3), s: wp.vec3i, t: wp.vec3i):
    """Whether an edge of s meets t, apart from the vertices that they have in common."""
    a = point(points, t[0])
    b = point(points, t[1])
    c = point(points, t[2])
    edges = int(3)
    for k in range(edges):
        i = s[k]
        j = s[(k + 1) % 3]
        if not has(t, i) and not has(t, j) and segment_meets_triangle(point(points, i), point(points, j), a, b, c):
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
    i = triple_at(tri_indices, wp.tid())
    a = wp.vec3(particle_q[i[0]])
    b = wp.vec3(particle_q[i[1]])
    c = wp.vec3(particle_q[i[2]])
    low = wp.min(wp.min(a, b), c)
    high = wp.max(wp.max(a, b), c)
    lower_out[wp.tid()] = low - padding(0.0, low, high)
    upper_out[wp.tid()] = high + padding(0.0, low, high)


@wp.kernel
def count_intersections(
    # Model
    tri_indices: wp.array2d(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    cloth_tris: int,
    # State in
    particle_q: wp.array(dtype=vec3),
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    bvh: wp.uint64,
    # Out
    count_out: wp.array2d(dtype=wp.int32),
):
    """Adds the intersecting pairs of triangles of each world: of two of cloth to column 0, of one of cloth and one of
    an obstacle to column 1. Cloth's are the first ``cloth_tris``.

    Two that have one vertex in common intersect if an edge that is not at that vertex meets the other.
    """
    s = wp.tid()
    mine = triple_at(tri_indices, s)
    world = particle_world[mine[0]]
    query = wp.bvh_query_aabb(bvh, lower[s], upper[s], wp.bvh_get_group_root(bvh, world))
    t = int(0)
    while wp.bvh_query_next(query, t):
        if t <= s or s >= cloth_tris:
            continue
        other = triple_at(tri_indices, t)
        meet = int(0)
        ways = int(2)
        for way in range(ways):
            if meet == 0 and edges_meet(particle_q, wp.where(way == 0, mine, other), wp.where(way == 0, other, mine)):
                meet = 1
        if meet == 1:
            wp.atomic_add(count_out, world, wp.where(t < cloth_tris, 0, 1), 1)
