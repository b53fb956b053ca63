"""Ways of triangles: boxes that move from where a triangle starts to where it ends.

All move at the same time. Boxes that sweep through one and the same place one after the other do not meet, and cloth
that moves as a whole is as far from itself on its way as it was before.
"""

import sys

import warp as wp

from .direct import triple_at, vector_at
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

MOST_AHEAD = wp.constant(8.0)  # ways that a known box may reach ahead


@wp.struct
class Way:
    """The box of what moves at the start of its way and at the end [m]; in between it changes evenly."""

    low: wp.vec3
    high: wp.vec3
    end_low: wp.vec3
    end_high: wp.vec3


@wp.func
def whole_low(way: Way):
    """Lower corner of the box of all of a way."""
    return wp.min(way.low, way.end_low)


@wp.func
def whole_high(way: Way):
    """Upper corner of the box of all of a way."""
    return wp.max(way.high, way.end_high)


@wp.func
def low_corner(x: vec3):
    return wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))


@wp.func
def padding(margin: float, low: wp.vec3, high: wp.vec3):
    """``margin`` [m] and the rounding of float32."""
    return wp.vec3(margin) + 1.0e-6 * wp.max(wp.abs(low), wp.abs(high))


@wp.func
def grown(way: Way, by: wp.vec3):
    out = Way()
    out.low = way.low - by
    out.high = way.high + by
    out.end_low = way.end_low - by
    out.end_high = way.end_high + by
    return out


@wp.func
def outside(low: wp.vec3, high: wp.vec3, around_low: wp.vec3, around_high: wp.vec3):
    """Whether a box is not within another one; it is not where it is no number."""
    within = wp.min(low - around_low, around_high - high)
    return not (within[0] >= 0.0 and within[1] >= 0.0 and within[2] >= 0.0)


@wp.func
def motion_of(way: Way):
    """Of the middle of a way's box [m]."""
    return 0.5 * (way.end_low - way.low + way.end_high - way.high)


@wp.func
def lowest(way: Way, stray: float):
    """Lower corner of the box of all of a way, and the share ``stray`` of its motion around."""
    return whole_low(way) - wp.vec3(stray * wp.length(motion_of(way)))


@wp.func
def highest(way: Way, stray: float):
    """Upper corner of the same."""
    return whole_high(way) + wp.vec3(stray * wp.length(motion_of(way)))


@wp.func
def while_closed(gap: float, end_gap: float, span: wp.vec2):
    """The part of a span of time in which a gap that changes evenly from 0 to 1 is not open."""
    out = span
    if gap > 0.0:
        if end_gap > 0.0:
            out = wp.vec2(1.0, 0.0)
        else:
            out[0] = wp.max(span[0], gap / (gap - end_gap))
    elif end_gap > 0.0:
        out[1] = wp.min(span[1], gap / (gap - end_gap))
    return out


@wp.func
def may_meet(a: Way, b: Way, stray: float):
    """Whether two boxes overlap at any time of their ways, at the end of which they may be nearer by the share
    ``stray`` of their motion to each other."""
    nearer = wp.vec3(stray * wp.length(motion_of(a) - motion_of(b)))
    above = a.low - b.high
    below = b.low - a.high
    end_above = a.end_low - b.end_high - nearer
    end_below = b.end_low - a.end_high - nearer
    if wp.max(wp.max(wp.min(above, end_above), wp.min(below, end_below))) > 0.0:  # apart along one axis all the time
        return False
    span = wp.vec2(0.0, 1.0)
    for k in range(3):
        span = while_closed(above[k], end_above[k], span)
        span = while_closed(below[k], end_below[k], span)
        if span[0] > span[1]:
            return False
    return True


@wp.kernel
def sum_drift(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    share: wp.array(dtype=wp.float64),
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    # Out
    drift_out: wp.array(dtype=wp.vec3d),
):
    """Adds to each world's mean motion [m] that of its particles; ``share`` is one over their number."""
    i = wp.tid()
    d = particle_to[i] - particle_from[i]
    w = particle_world[i]
    wp.atomic_add(drift_out, w, share[w] * wp.vec3d(wp.float64(d[0]), wp.float64(d[1]), wp.float64(d[2])))


@wp.kernel
def remove_drift(
    # Model
    thread_offset: int,
    particle_world: wp.array(dtype=wp.int32),
    # State in
    particle_to: wp.array(dtype=vec3),
    drift: wp.array(dtype=wp.vec3d),
    # Out
    particle_out: wp.array(dtype=vec3),
):
    """Ends of ways as seen by who moves with the mean of the world: cloth that falls does not sweep."""
    i = thread_offset + wp.tid()
    d = drift[particle_world[i]]
    particle_out[i] = particle_to[i] - vec3(real(d[0]), real(d[1]), real(d[2]))


@wp.func
def way_of(corners: wp.vec3i, particle_from: wp.array(dtype=vec3), particle_to: wp.array(dtype=vec3)):
    """The way of a triangle."""
    way = Way()
    a = low_corner(vector_at(particle_from, corners[0]))
    b = low_corner(vector_at(particle_from, corners[1]))
    c = low_corner(vector_at(particle_from, corners[2]))
    way.low = wp.min(wp.min(a, b), c)
    way.high = wp.max(wp.max(a, b), c)
    a = low_corner(vector_at(particle_to, corners[0]))
    b = low_corner(vector_at(particle_to, corners[1]))
    c = low_corner(vector_at(particle_to, corners[2]))
    way.end_low = wp.min(wp.min(a, b), c)
    way.end_high = wp.max(wp.max(a, b), c)
    return way


@wp.func
def stands(known: Way):
    """Whether a known way is a box that stays where it is."""
    return known.low == known.end_low and known.high == known.end_high


@wp.func
def grown_at_end(way: Way, by: float):
    out = way
    out.end_low -= wp.vec3(by)
    out.end_high += wp.vec3(by)
    return out


@wp.func
def holds(known: Way, way: Way, stray: float, room: float):
    """Whether pairs whose known ways cannot meet are none that may meet on their ways (:func:`may_meet`).

    In a box that stands there is room for what a triangle strays by itself; one that moves must move as is known,
    but for ``room`` [m].
    """
    motion = motion_of(way)
    inner = way
    if stands(known):
        inner = grown_at_end(way, stray * wp.length(motion))
    elif stray > 0.0 and not (wp.length(motion - motion_of(known)) <= room):
        return False
    return not (
        outside(inner.low, inner.high, known.low, known.high)
        or outside(inner.end_low, inner.end_high, known.end_low, known.end_high)
    )


@wp.func
def known_way(way: Way, drift: wp.vec3, stray: float, room: float, ahead: float):
    """What is to be known of a triangle on this way: more than it by ``room`` [m], so that it holds later ones, too.

    A box that stands and holds those that follow if all goes on like this, as far as ``ahead`` [m] allows; the way
    itself if one more would be further, or what moves with the mean of the world comes further.
    """
    step = motion_of(way) + drift  # as it is
    far = wp.length(step)
    if far > ahead or wp.length(drift) > ahead:
        return grown_at_end(grown(way, wp.vec3(room)), stray * room)
    inner = grown_at_end(way, stray * wp.length(motion_of(way)))
    onward = wp.min(MOST_AHEAD, ahead / wp.max(far, 1.0e-9)) * step
    low = whole_low(inner)
    high = whole_high(inner)
    out = Way()
    out.low = wp.min(low, low + onward) - wp.vec3(room)
    out.high = wp.max(high, high + onward) + wp.vec3(room)
    out.end_low = out.low
    out.end_high = out.high
    return out


@wp.kernel
def swept_bounds(
    # Model
    thread_offset: int,
    tri_indices: wp.array2d(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    particle_radius: wp.array(dtype=real),
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    drift: wp.array(dtype=wp.vec3d),
    active: wp.array(dtype=wp.int32),
    margin: float,
    radii: float,
    foreseen: float,
    stray: float,
    room: float,
    ahead: float,
    # Out
    way_out: wp.array(dtype=Way),
    known_out: wp.array(dtype=Way),
    moved_out: wp.array(dtype=wp.int32),
    any_moved_out: wp.array(dtype=wp.int32),
    tri_active_out: wp.array(dtype=wp.int32),
):
    """The way of every triangle from one set of positions to another, grown by ``margin`` [m] and so many ``radii``.

    Where the known way does not hold it, with what it strays if the way is only ``foreseen`` (by the share ``stray`` of
    its motion; else ``foreseen`` is 0), that becomes a new one; ``moved`` is 1 there, else 0. A triangle is active if
    one of its corners is; of others the way is the same as it was.
    """
    t = thread_offset + wp.tid()
    corners = triple_at(tri_indices, t)
    looked_at = active[corners[0]] | active[corners[1]] | active[corners[2]]
    tri_active_out[t] = looked_at
    moved_out[t] = 0
    if looked_at == 0:
        return
    bare = way_of(corners, particle_from, particle_to)
    low = whole_low(bare)
    high = whole_high(bare)
    pad = padding(margin + radii * float(particle_radius[corners[0]]), low, high)
    way = grown(bare, pad)
    way_out[t] = way
    if not holds(known_out[t], way, foreseen, room):
        d = drift[particle_world[corners[0]]]
        known_out[t] = known_way(way, wp.vec3(float(d[0]), float(d[1]), float(d[2])), stray, room, ahead)
        moved_out[t] = 1
        any_moved_out[0] = 1


@wp.kernel
def forget_ways(
    # Model
    thread_offset: int,
    # Out
    known_out: wp.array(dtype=Way),
):
    """Known ways that hold nothing."""
    t = thread_offset + wp.tid()
    known_out[t].low = wp.vec3(1.0e30)
    known_out[t].high = wp.vec3(-1.0e30)
