"""Quick tests that tell most pairs of triangles, and of their features, apart on their ways."""

import warp as wp

from .contact_ways import low_corner, padding
from .direct import vector_at
from .precision import real, vec3


@wp.struct
class Box:
    """An axis-aligned box [m]."""

    low: wp.vec3
    high: wp.vec3


@wp.func
def swept_box(i: int, start: wp.array(dtype=vec3), end: wp.array(dtype=vec3)):
    """Box of a particle's way."""
    a = low_corner(start[i])
    b = low_corner(end[i])
    box = Box()
    box.low = wp.min(a, b)
    box.high = wp.max(a, b)
    return box


@wp.func
def joined(a: Box, b: Box):
    box = Box()
    box.low = wp.min(a.low, b.low)
    box.high = wp.max(a.high, b.high)
    return box


@wp.func
def apart(a: Box, low: wp.vec3, high: wp.vec3):
    """Whether the box a does not reach the box from ``low`` to ``high``."""
    least = wp.max(a.low, low)
    most = wp.min(a.high, high)
    return least[0] > most[0] or least[1] > most[1] or least[2] > most[2]


@wp.func
def ways_apart(kind: int, i: wp.vec4i, start: wp.array(dtype=vec3), end: wp.array(dtype=vec3), margin: wp.float32):
    """Whether the boxes of the two features' ways stay further apart than ``margin`` along some axis."""
    one = swept_box(i[0], start, end)
    two = joined(swept_box(i[2], start, end), swept_box(i[3], start, end))
    if kind == 0:
        two = joined(two, swept_box(i[1], start, end))
    else:
        one = joined(one, swept_box(i[1], start, end))
    pad = padding(margin, one.low, one.high)
    return apart(two, one.low - pad, one.high + pad)


@wp.func
def gap_along(axis: vec3, a: vec3, b: vec3, c: vec3, p: vec3, q: vec3, r: vec3):
    """Least coordinate of p, q, r along an axis less the greatest of a, b, c."""
    low = wp.min(wp.min(wp.dot(axis, p), wp.dot(axis, q)), wp.dot(axis, r))
    return low - wp.max(wp.max(wp.dot(axis, a), wp.dot(axis, b)), wp.dot(axis, c))


@wp.func
def triangles_apart(
    t: wp.vec3i, u: wp.vec3i, start: wp.array(dtype=vec3), end: wp.array(dtype=vec3), margin: real, leeway: real
):  # fmt: skip
    """Whether two triangles stay further apart than ``margin`` along the line between their centres at the start.

    Coordinates along it are linear in time, so the gap between them, a least of linear functions, is concave: what it
    is at the start and at the end, it is at least in between. With a ``leeway`` below 1 by that share of their motion
    to each other further, as that is only foreseen.
    """
    origin = vector_at(start, t[0])  # so that numbers are small, and rounding with them
    b = vector_at(start, t[1]) - origin
    c = vector_at(start, t[2]) - origin
    p = vector_at(start, u[0]) - origin
    q = vector_at(start, u[1]) - origin
    r = vector_at(start, u[2]) - origin
    axis = p + q + r - b - c
    away = wp.length(axis)
    unit = axis / wp.max(away, real(1.0e-30))
    gap = gap_along(unit, vec3(), b, c, p, q, r)
    end_a = vector_at(end, t[0]) - origin
    end_b = vector_at(end, t[1]) - origin
    end_c = vector_at(end, t[2]) - origin
    end_p = vector_at(end, u[0]) - origin
    end_q = vector_at(end, u[1]) - origin
    end_r = vector_at(end, u[2]) - origin
    end_gap = gap_along(unit, end_a, end_b, end_c, end_p, end_q, end_r)
    needed = margin + real(1.0e-5) * (away + wp.length(end_a) + wp.length(end_p) + wp.length(c))
    if leeway < real(1.0):
        end_axis = end_p + end_q + end_r - end_a - end_b - end_c
        needed += leeway / real(3.0) * wp.length(end_axis - axis)
    return wp.min(gap, end_gap) > needed
