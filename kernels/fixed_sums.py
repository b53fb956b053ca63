"""Sums over pairs in contact, of vectors and numbers, for each particle.

They are taken in fixed point: integers add up to the same whatever the order of the pairs, so the result depends
neither on the tree's shape, nor on the other worlds, nor on the device's threads.
"""

import warp as wp

from .counting import add_whole, add_whole_at

MOVE_UNIT = wp.constant(wp.float64(2.0**50))  # per metre: up to 8 km by 1e-15 m
KICK_UNIT = wp.constant(wp.float64(2.0**40))  # per m/s: up to 8e6 m/s by 1e-12 m/s
SHARE_UNIT = wp.constant(wp.float64(2.0**40))


@wp.func
def add_fixed(sums_out: wp.array2d(dtype=wp.int64), i: int, x: wp.vec3d, unit: wp.float64, alone: bool):
    """Adds x to row i."""
    for m in range(3):
        add_whole_at(sums_out, i, m, wp.int64(wp.round(unit * x[m])), alone)


@wp.func
def from_fixed(sums: wp.array2d(dtype=wp.int64), i: int, unit: wp.float64):
    """Row i as a vector."""
    return wp.vec3d(wp.float64(sums[i, 0]), wp.float64(sums[i, 1]), wp.float64(sums[i, 2])) / unit


@wp.func
def add_share(share_out: wp.array(dtype=wp.int64), i: wp.vec4i, w: wp.vec4d, alone: bool):
    """Adds the weights' magnitudes to the sums of the four particles."""
    for m in range(4):
        add_whole(share_out, i[m], wp.int64(wp.round(SHARE_UNIT * wp.abs(w[m]))), alone)
