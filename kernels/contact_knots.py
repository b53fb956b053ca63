"""Knots: pairs of cloth that are still through each other when the passes of a step are over go on as one in it.

Where many pairs share few particles, as in the tip of a fold, what they ask for can cancel out, pass by pass, and the
step ends with features through each other. The guard then parts them at the end of the interval, one after the other
and each into the next one, and in the end holds them back, again and again: heaps of silk hung in the air, stretched to
twice their size. The start of the step was free of that. So, for a while after the guard had to hold back something of
a world, what is through each other after a step moves by the mean motion of its cluster (``contact_clusters.py``) and
gets its mean velocity: an impact without rebound, which conserves momentum. The next step begins where contact can
still tell the sides apart.
"""

import sys

import warp as wp

from .closest import combine, pair_weights
from .contact_clusters import UNIT, Clusters, common_way, unite
from .contact_pairs import Pairs, four_of, narrow, relative_motion, wide
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


# Intervals in which knots are joined once the guard has held back something. Joined always, they left fewer heaps to
# the guard, but where a fast box struck curtains they grew over all of these and tore them.
INTERVALS = wp.constant(30)
# [contact distances] A pair that moves further than that in a step has an impact, which is for the guard.
FAST = wp.constant(wp.float64(3.0))


@wp.struct
class Crossed:
    """Which worlds had pairs through each other in their last pass, and whether any had; and for how many more
    intervals knots are joined in each world."""

    world: wp.array(dtype=wp.int32)
    any: wp.array(dtype=wp.int32)
    wary: wp.array(dtype=wp.int32)


@wp.func
def note_crossed(crossed_out: Crossed, world: int):
    """A pair of the world is through each other."""
    if crossed_out.wary[world] > 0:
        crossed_out.world[world] = 1
        crossed_out.any[0] = 1


@wp.kernel
def begin_interval(
    # Out
    wary_out: wp.array(dtype=wp.int32),
):
    """One interval less."""
    w = wp.tid()
    wary_out[w] = wp.max(wary_out[w] - 1, 0)


@wp.kernel
def be_wary(
    # State in
    held_world: wp.array(dtype=wp.int32),
    # Out
    wary_out: wp.array(dtype=wp.int32),
):
    """In worlds in which the guard has held back something knots are joined for a while."""
    w = wp.tid()
    if held_world[w] == 1:
        wary_out[w] = INTERVALS


@wp.func
def through(w: wp.vec4d, d: wp.vec3d, side: wp.vec3d):
    """Whether features with the distance d, of weights w, have passed through each other since they were on ``side``.

    Only features whose closest points lie inside both can have; past a border d may turn.
    """
    zero = wp.float64(0.0)
    inside = w[0] != zero and w[1] != zero and w[2] != zero and w[3] != zero
    return inside and wp.dot(d, side) < zero


@wp.func
def all_free(i: wp.vec4i, particle_inv_mass: wp.array(dtype=real)):
    """Whether all four particles of a pair can move."""
    least = wp.min(particle_inv_mass[i[0]], particle_inv_mass[i[1]])
    return wp.min(least, wp.min(particle_inv_mass[i[2]], particle_inv_mass[i[3]])) > real(0.0)


@wp.kernel
def find_knots(
    # Model
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    pairs: Pairs,
    stride: int,
    # State in
    particle_start: wp.array(dtype=vec3),
    particle_q: wp.array(dtype=vec3),
    crossed: Crossed,
    clusters: Clusters,
    # Out
    parent_out: wp.array(dtype=wp.int32),
    united_out: wp.array(dtype=wp.int32),
):
    """Unites the particles of pairs that are through each other; says whether any belonged to different clusters.

    Only in worlds that had such pairs in their last pass, so that none feels another. Pairs with pins or obstacles,
    which go on as they must, are left to the guard.
    """
    for k in range(wp.tid(), wp.min(pairs.count[0], pairs.kind.shape[0]), stride):
        i = pairs.particles[k]
        if crossed.world[particle_world[i[0]]] == 0 or not all_free(i, particle_inv_mass):
            continue
        x = four_of(particle_q, i)
        w = pair_weights(pairs.kind[k], x)
        moved = relative_motion(particle_start, particle_q, i, w)
        if wp.length(moved) > FAST * wp.float64(pairs.distance[k]):
            continue
        if not through(w, combine(w, x), wide(pairs.side[k])):
            continue
        if unite(i, wp.vec4i(1), clusters, parent_out) > 0:
            united_out[0] = 1


@wp.kernel
def sum_momentum(
    # Model
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_qd: wp.array(dtype=vec3),
    clusters: Clusters,
    # Out
    momentum_out: wp.array2d(dtype=wp.int64),
):
    """Adds each particle that can move to the momentum of its cluster, in the fixed point of clusters [kg m/s]."""
    i = wp.tid()
    if particle_inv_mass[i] > real(0.0):
        p = wide(particle_qd[i]) / wp.float64(particle_inv_mass[i])
        for m in range(3):
            wp.atomic_add(momentum_out, clusters.root[i], m, wp.int64(wp.round(UNIT * p[m])))


@wp.kernel
def go_as_one(
    # Model
    thread_offset: int,
    # State in
    particle_start: wp.array(dtype=vec3),
    clusters: Clusters,
    momentum: wp.array2d(dtype=wp.int64),
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """Particles of clusters end where the mean motion takes them from their start, with the mean velocity."""
    i = thread_offset + wp.tid()
    r = clusters.root[i]
    if clusters.size[r] > 1:
        particle_q_out[i] = narrow(wide(particle_start[i]) + common_way(clusters, i))
        total = wp.vec3d(wp.float64(momentum[r, 0]), wp.float64(momentum[r, 1]), wp.float64(momentum[r, 2]))
        particle_qd_out[i] = narrow(total / wp.float64(clusters.mass[r]))
