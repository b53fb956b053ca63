"""Fans: the triangles around a vertex. Where a fan is nearly flat, no two of its triangles can touch.

If all normals of a fan have a positive component along one direction, and its triangles go around the vertex once at
most, then seen along that direction it is a disc or a sector, and no feature of one of its triangles meets another.
Flat at the start and flat at the end of an interval is enough for there to be no crossing at the end. So pairs of
triangles with a common vertex, by far the most of all that are near each other, are looked at in sharp folds only.
"""

import sys

import warp as wp

from .contact_candidates import TrianglePairs
from .precision import OPTIONS, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])

STEEP = wp.constant(wp.float64(0.3))  # least cosine between a normal and the fan's


@wp.func
def arm(points: wp.array(dtype=vec3), centre: int, i: int):
    """From the fan's vertex to another one."""
    a = points[centre]
    b = points[i]
    return wp.vec3d(
        wp.float64(b[0]) - wp.float64(a[0]), wp.float64(b[1]) - wp.float64(a[1]), wp.float64(b[2]) - wp.float64(a[2])
    )


@wp.kernel
def find_flat_fans(
    # Model
    fan_start: wp.array(dtype=wp.int32),
    fan_spokes: wp.array(dtype=wp.vec2i),
    fan_turns: wp.array(dtype=wp.int32),
    # State in
    particle_q: wp.array(dtype=vec3),
    also: wp.array(dtype=wp.int32),
    # Out
    flat_out: wp.array(dtype=wp.int32),
):
    """1 where the fan is flat, and was ``also``; else 0.

    ``fan_turns`` is how often a flat fan passes its first spoke again: 1 for one that is closed, 0 for one that is
    open, −1 for one that is not a fan (two that share a vertex).
    """
    i = wp.tid()
    flat_out[i] = 0
    turns = fan_turns[i]
    if turns < 0 or also[i] == 0:
        return
    zero = wp.float64(0.0)
    axis = wp.vec3d()
    for k in range(fan_start[i], fan_start[i + 1]):
        axis += wp.cross(arm(particle_q, i, fan_spokes[k][0]), arm(particle_q, i, fan_spokes[k][1]))
    axis = wp.normalize(axis)
    up = wp.cross(axis, arm(particle_q, i, fan_spokes[fan_start[i]][0]))
    for k in range(fan_start[i], fan_start[i + 1]):
        a = arm(particle_q, i, fan_spokes[k][0])
        b = arm(particle_q, i, fan_spokes[k][1])
        n = wp.cross(a, b)
        if not wp.dot(n, axis) > STEEP * wp.length(n):
            return
        if wp.dot(a, up) < zero and wp.dot(b, up) >= zero:
            turns -= 1
    if turns == 0:
        flat_out[i] = 1


@wp.kernel
def add_fan_pairs(
    # Model
    shared: wp.array(dtype=wp.vec4i),
    # State in
    flat: wp.array(dtype=wp.int32),
    # Out
    pairs_out: TrianglePairs,
):
    """Adds the pairs of triangles with common vertices none of whose fans is flat.

    ``shared`` holds two triangles, and their one or two common vertices (one is given twice).
    """
    s = shared[wp.tid()]
    if flat[s[2]] == 0 and flat[s[3]] == 0:
        n = wp.atomic_add(pairs_out.count, 0, 1)
        if n < pairs_out.pair.shape[0]:
            pairs_out.pair[n] = wp.vec2i(s[0], s[1])
