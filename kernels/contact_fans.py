"""Fans: the triangles around a vertex. While a fan is nearly flat, no two of its triangles can touch.

If all normals of a fan have a positive component along one direction, and its triangles go around the vertex once at
most, then seen along that direction it is a disc or a sector, and no feature of one of its triangles meets another. On
a straight way normals are quadratic in time: they have that component all along if their three Bézier points have it.
So pairs of triangles with a common vertex, by far the most of all that are near each other, are looked at in sharp
folds only. (Flat at both ends is not enough: edges may pass each other on the way, and end in some other triangle.)
"""

import sys

import warp as wp

from .contact_candidates import TrianglePairs
from .counting import count_up
from .precision import FORWARD_ONLY, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

STEEP = wp.constant(wp.float64(0.3))  # least cosine between a normal and the fan's


@wp.func
def arm(points: wp.array(dtype=vec3), centre: int, i: int):
    """From the fan's vertex to another one."""
    a = points[centre]
    b = points[i]
    return wp.vec3d(
        wp.float64(b[0]) - wp.float64(a[0]), wp.float64(b[1]) - wp.float64(a[1]), wp.float64(b[2]) - wp.float64(a[2])
    )


@wp.func
def leans(n: wp.vec3d, axis: wp.vec3d):
    """Whether a normal is too far from the axis."""
    return not wp.dot(n, axis) > STEEP * wp.length(n)


@wp.func
def passes(up: wp.vec3d, a: wp.vec3d, b: wp.vec3d):
    """1 if the way from spoke a to spoke b passes the direction that ``up`` is a quarter turn ahead of."""
    if wp.dot(a, up) < wp.float64(0.0) and wp.dot(b, up) >= wp.float64(0.0):
        return 1
    return 0


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
    # Out
    flat_out: wp.array(dtype=wp.int32),
):
    """1 where the fan is flat on all of its straight way, else 0; left as it is where no particle of it is active.

    ``fan_turns`` is how often a flat fan passes its first spoke again: 1 for one that is closed, 0 for one that is
    open, −1 for one that is not a fan (two that share a vertex). A closed one keeps its turns on the way; an open one
    might open further, so its spokes may turn by less than a right angle, and must not pass the first spoke from
    wherever either is at the start to wherever the other is at the end.
    """
    i = thread_offset + wp.tid()
    turns = fan_turns[i]
    first = fan_start[i]
    last = fan_start[i + 1]
    looked_at = active[i]
    for k in range(first, last):
        looked_at = looked_at | active[fan_spokes[k][0]] | active[fan_spokes[k][1]]
    if looked_at == 0:
        return
    flat_out[i] = 0
    if turns < 0 or first == last:
        return
    axis = wp.vec3d()
    for k in range(first, last):
        a = arm(particle_from, i, fan_spokes[k][0]) + arm(particle_to, i, fan_spokes[k][0])
        b = arm(particle_from, i, fan_spokes[k][1]) + arm(particle_to, i, fan_spokes[k][1])
        axis += wp.cross(a, b)
    axis = wp.normalize(axis)
    up = wp.cross(axis, arm(particle_from, i, fan_spokes[first][0]))
    up_later = wp.cross(axis, arm(particle_to, i, fan_spokes[first][0]))
    for k in range(first, last):
        a = arm(particle_from, i, fan_spokes[k][0])
        b = arm(particle_from, i, fan_spokes[k][1])
        c = arm(particle_to, i, fan_spokes[k][0])
        d = arm(particle_to, i, fan_spokes[k][1])
        if leans(wp.cross(a, b), axis) or leans(wp.cross(c, d), axis) or leans(wp.cross(a, d) + wp.cross(c, b), axis):
            return
        turns -= passes(up, a, b)
        if fan_turns[i] == 0:
            turns -= passes(up, c, d) + passes(up_later, a, b) + passes(up_later, c, d)
            if wp.dot(a, c) < wp.dot(a, axis) * wp.dot(c, axis) or wp.dot(b, d) < wp.dot(b, axis) * wp.dot(d, axis):
                return
    if turns == 0:
        flat_out[i] = 1


@wp.kernel
def add_fan_pairs(
    # Model
    thread_offset: int,
    shared: wp.array(dtype=wp.vec4i),
    # State in
    flat: wp.array(dtype=wp.int32),
    # Out
    pairs_out: TrianglePairs,
):
    """Adds the pairs of triangles with common vertices none of whose fans is flat.

    ``shared`` holds two triangles, and their one or two common vertices (one is given twice).
    """
    s = shared[thread_offset + wp.tid()]
    if flat[s[2]] == 0 and flat[s[3]] == 0:
        n = count_up(pairs_out.count, 0, 1)
        if n < pairs_out.pair.shape[0]:
            pairs_out.pair[n] = wp.vec2i(s[0], s[1])
