"""Clusters: cloth particles that have met and then go on together, in a knot or while the guard holds them back.

Particles that are stopped each where it was tear at the cloth around them, which moves on, and a knot never comes
undone. So those that meet become one cluster, which goes by its mean motion: momentum is conserved, and nothing in it
meets. (Impact zones of Bridson, Fedkiw, Anderson 2002, section 7.5, but for their rotation.) Clusters are trees in an
array of parents, as in union–find.
"""

import sys

import warp as wp

from .contact_pairs import wide
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

# Sums are taken in fixed point, so that they do not depend on their order: up to 32 t m, as tents weigh tons, by
# 4e-15 kg m.
UNIT = wp.constant(wp.float64(2.0**48))


@wp.struct
class Clusters:
    """Of each particle its root; at the roots the number of particles, their mass and Σ m (to − from), in ``UNIT``."""

    root: wp.array(dtype=wp.int32)
    size: wp.array(dtype=wp.int32)
    mass: wp.array(dtype=wp.int64)
    way: wp.array2d(dtype=wp.int64)


@wp.kernel
def part_clusters(
    # Out
    parent_out: wp.array(dtype=wp.int32),
    root_out: wp.array(dtype=wp.int32),
):
    """Each particle is a cluster of its own."""
    i = wp.tid()
    parent_out[i] = i
    root_out[i] = i


@wp.kernel
def find_clusters(
    # Model
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    parent: wp.array(dtype=wp.int32),
    # Out
    clusters_out: Clusters,
):
    """Adds each particle that can move to the sums of its cluster, which start at 0."""
    i = wp.tid()
    r = int(i)
    while parent[r] != r:
        r = parent[r]
    clusters_out.root[i] = r
    if particle_inv_mass[i] > real(0.0):
        mass = wp.float64(1.0) / wp.float64(particle_inv_mass[i])
        way = mass * (wide(particle_to[i]) - wide(particle_from[i]))
        wp.atomic_add(clusters_out.size, r, 1)
        wp.atomic_add(clusters_out.mass, r, wp.int64(wp.round(UNIT * mass)))
        for m in range(3):
            wp.atomic_add(clusters_out.way, r, m, wp.int64(wp.round(UNIT * way[m])))


@wp.func
def common_way(clusters: Clusters, i: int):
    """Mean motion of the particle's cluster [m]; none if it is alone."""
    r = clusters.root[i]
    way = wp.vec3d()
    if clusters.size[r] > 1:
        for m in range(3):
            way[m] = wp.float64(clusters.way[r, m]) / wp.float64(clusters.mass[r])
    return way


@wp.func
def unite(i: wp.vec4i, free: wp.vec4i, clusters: Clusters, parent_out: wp.array(dtype=wp.int32)):
    """Makes one cluster of those of the particles that are ``free``; how many of them belonged to another."""
    top = int(-1)
    for m in range(4):
        if free[m] == 1:
            top = wp.max(top, clusters.root[i[m]])
    others = int(0)
    for m in range(4):
        if free[m] == 1 and clusters.root[i[m]] != top:
            wp.atomic_max(parent_out, clusters.root[i[m]], top)
            others += 1
    return others
