"""Fans: the triangles around a vertex. While a fan is nearly flat, no two of its triangles can touch.

If all normals of a fan have a positive component along one direction, and its triangles go around the vertex once at
most, then seen along that direction it is a disc or a sector, and no feature of one of its triangles meets another. On
a straight way normals are quadratic in time: they have that component all along if their three Bézier points have it.
So pairs of triangles with a common vertex, by far the most of all that are near each other, are looked at in sharp
folds only. (Flat at both ends is not enough: edges may pass each other on the way, and end in some other triangle.)
"""

import sys

import warp as wp

from .direct import int_at, pair_at, vector_at
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
def axis_of(
    i: int, first: int, last: int, fan_spokes: wp.array(dtype=wp.vec2i), particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3), moves: int,
):  # fmt: skip
    """Mean normal of fan i, of unit length; halfway, where it ``moves``."""
    x = vector_at(particle_from, i)
    y = vector_at(particle_to, i)
    axis = vec3()
    for k in range(first, last):
        spokes = pair_at(fan_spokes, k)
        a = vector_at(particle_from, spokes[0]) - x
        b = vector_at(particle_from, spokes[1]) - x
        if moves == 1:
            a += vector_at(particle_to, spokes[0]) - y
            b += vector_at(particle_to, spokes[1]) - y
        axis += wp.cross(a, b)
    return wp.normalize(axis)


@wp.kernel
def find_flat_fans(
    # Model
    thread_offset: int,
    fan_start: wp.array(dtype=wp.int32),
    fan_spokes: wp.array(dtype=wp.vec2i),
    fan_turns: wp.array(dtype=wp.int32),
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    active: wp.array(dtype=wp.int32),
    moves: int,
    # Out
    flat_out: wp.array(dtype=wp.int32),
):
    """1 where the fan is flat on all of its straight way, else 0; left as it is where no particle of it is active.

    ``fan_turns`` is how often a flat fan passes its first spoke again: 1 for one that is closed, 0 for one that is
    open, −1 for one that is not a fan (two that share a vertex). A closed one keeps its turns on the way; an open one
    might open further, so its spokes may turn by less than a right angle, and must not pass the first spoke from
    wherever either is at the start to wherever the other is at the end. Where nothing ``moves``, the end is the start.
    """
    i = thread_offset + wp.tid()
    turns = fan_turns[i]
    first = fan_start[i]
    last = fan_start[i + 1]
    looked_at = active[i]
    for k in range(first, last):
        spokes = pair_at(fan_spokes, k)
        looked_at = looked_at | int_at(active, spokes[0]) | int_at(active, spokes[1])
    if looked_at == 0:
        return
    flat_out[i] = 0
    if turns < 0 or first == last:
        return
    x = vector_at(particle_from, i)
    y = vector_at(particle_to, i)
    axis = axis_of(i, first, last, fan_spokes, particle_from, particle_to, moves)
    start = pair_at(fan_spokes, first)
    up = wp.cross(axis, vector_at(particle_from, start[0]) - x)
    up_later = wp.cross(axis, vector_at(particle_to, start[0]) - y)
    for k in range(first, last):
        spokes = pair_at(fan_spokes, k)
        a = vector_at(particle_from, spokes[0]) - x
        b = vector_at(particle_from, spokes[1]) - x
        if leans(wp.cross(a, b), axis):
            return
        if k > first or turns > 0:  # an open fan's first spoke is where it begins, not passed
            turns -= passes(up, a, b)
        if moves == 1:
            c = vector_at(particle_to, spokes[0]) - y
            d = vector_at(particle_to, spokes[1]) - y
            if leans(wp.cross(c, d), axis) or leans(wp.cross(a, d) + wp.cross(c, b), axis):
                return
            if fan_turns[i] == 0:
                if k > first:
                    turns -= passes(up, c, d) + passes(up_later, a, b) + passes(up_later, c, d)
                if (
                    wp.dot(a, c) < wp.dot(a, axis) * wp.dot(c, axis)
                    or wp.dot(b, d) < wp.dot(b, axis) * wp.dot(d, axis)
                ):  # fmt: skip
                    return
    if turns == 0:
        flat_out[i] = 1
