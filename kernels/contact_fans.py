"""Fans: the triangles around a vertex. While a fan is nearly flat, no two of its triangles can touch.

If all normals of a fan have a positive component along one direction, and its triangles go around the vertex once at
most, then seen along that direction it is a disc or a sector, and no feature of one of its triangles meets another. On
a straight way normals are quadratic in time: they have that component all along if their three Bézier points have it.
So pairs of triangles with a common vertex, by far the most of all that are near each other, are looked at in sharp
folds only. (Flat at both ends is not enough: edges may pass each other on the way, and end in some other triangle.)
"""

import sys

import warp as wp

from .direct import int_at, vector_at
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

STEEP = wp.constant(0.3)  # least cosine between a normal and the fan's


@wp.func
def leans(n: vec3, axis: vec3):
    """Whether a normal is too far from the axis, which is of unit length."""
    along = wp.dot(n, axis)
    return not (along > real(0.0) and along * along > real(STEEP * STEEP) * wp.dot(n, n))


@wp.func
def passes(up: vec3, a: vec3, b: vec3):
    """1 if the way from spoke a to spoke b passes the direction that ``up`` is a quarter turn ahead of."""
    if wp.dot(a, up) < real(0.0) and wp.dot(b, up) >= real(0.0):
        return 1
    return 0


@wp.func
def spoke(particle: wp.array(dtype=vec3), ring: wp.array(dtype=wp.int32), k: int, centre: vec3):
    """From the centre of a fan to corner k of its ring."""
    return vector_at(particle, int_at(ring, k)) - centre


@wp.func
def axis_of(
    i: int, first: int, last: int, closed: int, ring: wp.array(dtype=wp.int32), particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3), moves: int,
):  # fmt: skip
    """Mean normal of fan i, of unit length; halfway, where it ``moves``."""
    x = vector_at(particle_from, i)
    y = vector_at(particle_to, i)
    axis = vec3()
    before = wp.where(closed == 1, last - 1, first)
    a = spoke(particle_from, ring, before, x)
    if moves == 1:
        a += spoke(particle_to, ring, before, y)
    for k in range(first + 1 - closed, last):
        b = spoke(particle_from, ring, k, x)
        if moves == 1:
            b += spoke(particle_to, ring, k, y)
        axis += wp.cross(a, b)
        a = b
    return wp.normalize(axis)


@wp.func
def is_active(i: int, first: int, last: int, ring: wp.array(dtype=wp.int32), active: wp.array(dtype=wp.int32)):
    """Whether a particle of fan i is."""
    found = active[i]
    for k in range(first, wp.where(found == 1, first, last)):
        found = found | int_at(active, int_at(ring, k))
    return found == 1


@wp.func
def stays_flat(
    i: int, first: int, last: int, closed: int, ring: wp.array(dtype=wp.int32), particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3), moves: int,
):  # fmt: skip
    """Whether fan i is flat on all of its straight way; see :func:`find_flat_fans`."""
    x = vector_at(particle_from, i)
    y = vector_at(particle_to, i)
    axis = axis_of(i, first, last, closed, ring, particle_from, particle_to, moves)
    up = wp.cross(axis, spoke(particle_from, ring, first, x))
    up_later = wp.cross(axis, spoke(particle_to, ring, first, y))
    before = wp.where(closed == 1, last - 1, first)
    a = spoke(particle_from, ring, before, x)
    c = spoke(particle_to, ring, before, y)
    turns = closed
    for k in range(first + 1 - closed, last):
        b = spoke(particle_from, ring, k, x)
        if leans(wp.cross(a, b), axis):
            return False
        begins = closed == 0 and k == first + 1  # an open fan's first spoke is where it begins, not passed
        if not begins:
            turns -= passes(up, a, b)
        if moves == 1:
            d = spoke(particle_to, ring, k, y)
            if leans(wp.cross(c, d), axis) or leans(wp.cross(a, d) + wp.cross(c, b), axis):
                return False
            if closed == 0:
                if not begins:
                    turns -= passes(up, c, d) + passes(up_later, a, b) + passes(up_later, c, d)
                if (
                    wp.dot(a, c) < wp.dot(a, axis) * wp.dot(c, axis)
                    or wp.dot(b, d) < wp.dot(b, axis) * wp.dot(d, axis)
                ):  # fmt: skip
                    return False
            c = d
        a = b
    return turns == 0


@wp.kernel
def find_flat_fans(
    # Model
    thread_offset: int,
    fan_start: wp.array(dtype=wp.int32),
    fan_ring: wp.array(dtype=wp.int32),
    fan_turns: wp.array(dtype=wp.int32),
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    active: wp.array(dtype=wp.int32),
    moves: int,
    # Out
    flat_out: wp.array(dtype=wp.int32),
):
    """1 where the fan is flat on all of its straight way, else 0; left as it is where no particle of it is active, and
    where there is no ring (of what is no fan, as two that share a vertex), which must be 0 before.

    ``fan_turns`` is how often a flat fan passes its first spoke again: 1 for one that is closed, 0 for one that is
    open. A closed one keeps its turns on the way; an open one might open further, so its spokes may turn by less than a
    right angle, and must not pass the first spoke from wherever either is at the start to wherever the other is at the
    end. Where nothing ``moves``, the end is the start.
    """
    i = thread_offset + wp.tid()
    first = fan_start[i]
    last = fan_start[i + 1]
    if first < last and is_active(i, first, last, fan_ring, active):
        flat_out[i] = int(stays_flat(i, first, last, fan_turns[i], fan_ring, particle_from, particle_to, moves))
