"""Where edges pass through triangles, and which way out is shortest; see ``warpcloth/untangle.py``."""

import sys

import warp as wp

from .contact_candidates import has
from .direct import triple_at
from .intersections import point, segment_meets_triangle
from .precision import FORWARD_ONLY, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

SLANT = wp.constant(wp.float64(0.1))  # least |e·n|: edges that graze would be sent far


@wp.struct
class Crossings:
    """Edges through triangles; ``count`` goes on beyond the arrays' length when they are too short."""

    count: wp.array(dtype=wp.int32)
    where: wp.array(dtype=wp.vec4i)  # triangle with the edge, triangle passed, ends of the edge
    way: wp.array(dtype=wp.vec3d)


@wp.func
def way_out(p: wp.vec3d, q: wp.vec3d, third: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """r − 2 (e·r)/(e·n) n for the edge p–q of the triangle p, q, third, which passes through the triangle a, b, c."""
    e = wp.normalize(q - p)
    n = wp.normalize(wp.cross(b - a, c - a))
    r = wp.normalize(wp.cross(wp.cross(q - p, third - p), n))
    if wp.dot(r, third - p - wp.dot(third - p, e) * e) < wp.float64(0.0):
        r = -r
    slant = wp.dot(e, n)
    if wp.abs(slant) < SLANT:
        slant = wp.where(slant < wp.float64(0.0), -SLANT, SLANT)
    return r - (wp.float64(2.0) * wp.dot(e, r) / slant) * n


@wp.func
def add_crossings(points: wp.array(dtype=vec3), mine: wp.vec3i, s: int, other: wp.vec3i, t: int, found: Crossings):
    """Adds the edges of triangle s that pass through triangle t."""
    a = point(points, other[0])
    b = point(points, other[1])
    c = point(points, other[2])
    edges = int(3)
    for k in range(edges):
        i = mine[k]
        j = mine[(k + 1) % 3]
        if has(other, i) or has(other, j):
            continue
        p = point(points, i)
        q = point(points, j)
        if segment_meets_triangle(p, q, a, b, c):
            n = wp.atomic_add(found.count, 0, 1)
            if n < found.where.shape[0]:
                found.where[n] = wp.vec4i(s, t, wp.min(i, j), wp.max(i, j))
                found.way[n] = way_out(p, q, point(points, mine[(k + 2) % 3]), a, b, c)


@wp.kernel
def find_crossings(
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
    found_out: Crossings,
):
    """Lists all edges that pass through triangles, once for each triangle at the edge; not of two obstacles."""
    s = wp.tid()
    mine = triple_at(tri_indices, s)
    root = wp.bvh_get_group_root(bvh, particle_world[mine[0]])
    query = wp.bvh_query_aabb(bvh, lower[s], upper[s], root)
    t = int(0)
    while wp.bvh_query_next(query, t):
        if t <= s or s >= cloth_tris:
            continue
        other = triple_at(tri_indices, t)
        first = mine
        second = other
        p = s
        q = t
        ways = int(2)  # no constant: unrolled, all that is inside compiles twice
        for _way in range(ways):
            add_crossings(particle_q, first, p, second, q, found_out)
            first = other
            second = mine
            p = t
            q = s
