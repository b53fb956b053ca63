"""The guard: no straight motion of an interval may take a pair through each other; what would is held back.

Held back means: at home, and from there only a fraction of the way to where it would go. Home of one particle that met
an obstacle is where it was at the start of the interval; of those that met each other, where the mean motion of all of
them takes them (``contact_clusters.py``); in the way of an obstacle or of pins, where those carry it. Nothing of this
takes anything through anything: all that has the same carrier, or is of one cluster, moves as one.
"""

import sys

import warp as wp

from .closest import time_of_impact
from .contact_clusters import Clusters, common_way, unite
from .contact_pairs import Pairs, four_of, narrow, wide
from .counting import count_up
from .direct import int_at, real_at, vector_at
from .motion import Tracks, pose_at, rotation_matrix
from .precision import FORWARD_ONLY, real, vec3
from .shapes import MESH, Placement, Shapes, distance, to_local, to_real3, to_world

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


REST = wp.constant(0)  # the carrier of what stays where it is, or moves in ways of its own
DEEP = wp.constant(1.0e-4)  # [m] in an obstacle that is still none


@wp.kernel
def give_up(
    # State in
    torn: wp.array(dtype=wp.int32),
    # Out
    impacts_out: wp.array(dtype=wp.int32),
):
    """Nothing is looked at in a frame that has diverged: everything may meet everything there, and it is an error."""
    if torn[wp.tid()] > 0:
        impacts_out[0] = 0


@wp.kernel
def open_worlds(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    # State in
    met: wp.array(dtype=wp.int32),
    # Out
    open_out: wp.array(dtype=wp.int32),
):
    """Marks the worlds in which particles still meet; the others must not feel that."""
    i = wp.tid()
    if met[i] == 1:
        open_out[particle_world[i]] = 1


@wp.kernel
def let_go(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    own_carrier: wp.array(dtype=wp.int32),
    # State in
    open_world: wp.array(dtype=wp.int32),
    # Out
    active_out: wp.array(dtype=wp.int32),
    fraction_out: wp.array(dtype=wp.float64),
    carrier_out: wp.array(dtype=wp.int32),
):
    """Before anything is held back: all go all their way; what moves as prescribed is carried by itself."""
    i = wp.tid()
    active_out[i] = open_world[particle_world[i]]
    fraction_out[i] = wp.float64(1.0)
    carrier_out[i] = own_carrier[i]


@wp.kernel
def place_pins(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    pin_particle: wp.array(dtype=wp.int32),
    pin_track: wp.array(dtype=wp.int32),
    pin_pivot: wp.array(dtype=wp.vec3d),
    tracks: Tracks,
    group_pin: wp.array(dtype=wp.int32),
    first: int,
    # State in
    world_time: wp.array(dtype=wp.float64),
    # Out
    place_out: wp.array(dtype=Placement),
):
    """Where each group of pins that move together is at the worlds' time, after the ``first`` placements."""
    g = wp.tid()
    k = group_pin[g]
    pose = pose_at(tracks, pin_track[k], world_time[particle_world[pin_particle[k]]])
    turn = rotation_matrix(pose.rotation)
    place = Placement()
    place.position = to_real3(pin_pivot[k] + pose.position - turn * pin_pivot[k])
    for i in range(3):
        for j in range(3):
            place.rotation[i, j] = real(turn[i, j])
    place_out[first + g] = place


@wp.func
def carried_way(
    i: int,
    x: vec3,
    s: int,
    clusters: Clusters,
    place_from: wp.array(dtype=Placement),
    place_to: wp.array(dtype=Placement),
):
    """Way home [m] of a particle that was at x: with its carrier s or, if it has none, with its cluster."""
    if s >= 0:
        return wide(to_world(place_to[s], to_local(place_from[s], x))) - wide(x)
    return common_way(clusters, i)


@wp.kernel
def find_ends(
    # Model
    thread_offset: int,
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    fraction: wp.array(dtype=wp.float64),
    carrier: wp.array(dtype=wp.int32),
    clusters: Clusters,
    place_from: wp.array(dtype=Placement),
    place_to: wp.array(dtype=Placement),
    # Out
    particle_end_out: wp.array(dtype=vec3),
):
    """Where particles end that leave home by a fraction of their way only: none of those that go as they must."""
    i = thread_offset + wp.tid()
    particle_end_out[i] = particle_to[i]
    f = fraction[i]
    if f < wp.float64(1.0):
        x = particle_from[i]
        home = wide(x) + carried_way(i, x, carrier[i], clusters, place_from, place_to)
        particle_end_out[i] = narrow(home + f * (wide(particle_to[i]) - home))


@wp.func
def rigid(i: wp.vec4i, carrier: wp.array(dtype=wp.int32)):
    """Whether all four move as one: they then come nearer by the sagitta of a turn at most, and never meet.

    What gets a carrier is at home by then. ``REST`` says nothing: points of deforming meshes and pins that are led from
    outside have it, too, and do not rest.
    """
    s = carrier[i[0]]
    return s > REST and carrier[i[1]] == s and carrier[i[2]] == s and carrier[i[3]] == s


@wp.func
def without_carrier(i: wp.vec4i, particle_inv_mass: wp.array(dtype=real), carrier: wp.array(dtype=wp.int32)):
    """Which of a pair's particles can move and have no carrier: 1, else 0."""
    free = wp.vec4i()
    for m in range(4):
        if particle_inv_mass[i[m]] > real(0.0) and carrier[i[m]] < 0:
            free[m] = 1
    return free


@wp.func
def hold_back(
    i: wp.vec4i, t: wp.float64, particle_inv_mass: wp.array(dtype=real), fraction: wp.array(dtype=wp.float64),
    fraction_out: wp.array(dtype=wp.float64),
):  # fmt: skip
    """Particles of a pair that meets after the part t of its way go less far; returns how many were not at home."""
    changed = int(0)
    for m in range(4):
        f = fraction[i[m]]
        if particle_inv_mass[i[m]] > real(0.0) and f > wp.float64(0.0):
            g = wp.float64(0.9) * t * f
            if g < wp.float64(0.02):
                g = wp.float64(0.0)
            wp.atomic_min(fraction_out, i[m], g)
            changed += 1
    return changed


@wp.func
def bring_to_rest(
    i: wp.vec4i, particle_inv_mass: wp.array(dtype=real), carrier: wp.array(dtype=wp.int32),
    carrier_out: wp.array(dtype=wp.int32),
):  # fmt: skip
    """What is free comes to rest, what rests goes with what carries another of the pair; returns how many change."""
    free = without_carrier(i, particle_inv_mass, carrier)
    with_whom = int(REST)
    for m in range(4):
        with_whom = wp.max(with_whom, carrier[i[m]])
    changed = int(0)
    for m in range(4):
        rests = particle_inv_mass[i[m]] > real(0.0) and carrier[i[m]] == REST and with_whom > REST
        if free[m] == 1 or rests:
            wp.atomic_max(carrier_out, i[m], wp.where(rests, with_whom, REST))
            changed += 1
    return changed


@wp.kernel
def limit_motion(
    # Model
    particle_inv_mass: wp.array(dtype=real),
    pairs: Pairs,
    separation: wp.float64,
    stride: int,
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_end: wp.array(dtype=vec3),
    fraction: wp.array(dtype=wp.float64),
    carrier: wp.array(dtype=wp.int32),
    clusters: Clusters,
    # Out
    fraction_out: wp.array(dtype=wp.float64),
    carrier_out: wp.array(dtype=wp.int32),
    parent_out: wp.array(dtype=wp.int32),
    held_back_out: wp.array(dtype=wp.int32),
    counts_out: wp.array(dtype=wp.int32),
):
    """For each pair that would meet on its way: its particles may go only as far as the meeting.

    Cloth that meets cloth becomes one cluster. If all are at home already, what is free comes to rest; and what rests
    goes with what carries another of the pair. Counts what changed, and pairs that are pinched: they meet though
    nothing can be done, as what moves is prescribed.
    """
    for k in range(wp.tid(), wp.min(pairs.count[0], pairs.kind.shape[0]), stride):
        i = pairs.particles[k]
        if rigid(i, carrier):
            continue
        x = four_of(particle_from, i)
        u = four_of(particle_end, i) - x
        t = time_of_impact(pairs.kind[k], x, u, separation)
        if not t < wp.float64(1.0):
            continue
        changed = unite(i, without_carrier(i, particle_inv_mass, carrier), clusters, parent_out)
        changed += hold_back(i, t, particle_inv_mass, fraction, fraction_out)
        if changed == 0:
            changed = bring_to_rest(i, particle_inv_mass, carrier, carrier_out)
        if changed > 0:
            count_up(held_back_out, 0, changed)
        else:
            count_up(counts_out, 1, 1)


@wp.kernel
def limit_by_shapes(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    particle_radius: wp.array(dtype=real),
    shapes: Shapes,
    # State in
    particle_end: wp.array(dtype=vec3),
    fraction: wp.array(dtype=wp.float64),
    carrier: wp.array(dtype=wp.int32),
    place: wp.array(dtype=Placement),
    # Out
    fraction_out: wp.array(dtype=wp.float64),
    carrier_out: wp.array(dtype=wp.int32),
    held_back_out: wp.array(dtype=wp.int32),
):
    """The same for held-back particles and spheres, capsules, boxes and planes, which are more than their edges.

    Where they end is at least half of the contact distance away; ``place`` is that of the carriers, ``REST`` first.
    """
    i = wp.tid()
    f = fraction[i]
    if f == wp.float64(1.0):
        return
    w = particle_world[i]
    for s in range(shapes.world_start[w], shapes.world_start[w + 1]):
        if shapes.kind[s] != MESH:
            here = distance(shapes.kind[s], shapes.size[s], to_local(place[s + 1], particle_end[i]))
            if here[3] < real(0.5) * (particle_radius[i] + shapes.thickness[s]):
                who = wp.where(shapes.track[s] >= 0, s + 1, REST)
                if f > wp.float64(0.0):
                    fraction_out[i] = wp.float64(0.0)
                    count_up(held_back_out, 0, 1)
                elif carrier[i] < who:
                    wp.atomic_max(carrier_out, i, who)
                    count_up(held_back_out, 0, 1)


@wp.kernel
def count_pinched(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    shapes: Shapes,
    # State in
    particle_q: wp.array(dtype=vec3),
    place: wp.array(dtype=Placement),
    # Out
    counts_out: wp.array(dtype=wp.int32),
):
    """Counts free particles that end an interval in a sphere, capsule, box or plane: something else keeps them there.

    Whoever answers last to such a particle has it on its surface, and no pair tells of it.
    """
    i = thread_offset + wp.tid()
    if real_at(particle_inv_mass, i) == real(0.0):
        return
    w = int_at(particle_world, i)
    for s in range(shapes.world_start[w], shapes.world_start[w + 1]):
        if shapes.kind[s] != MESH:
            here = distance(shapes.kind[s], shapes.size[s], to_local(place[s], vector_at(particle_q, i)))
            if here[3] < -real(DEEP):
                count_up(counts_out, 1, 1)


@wp.kernel
def apply_limit(
    # State in
    thread_offset: int,
    particle_from: wp.array(dtype=vec3),
    particle_end: wp.array(dtype=vec3),
    fraction: wp.array(dtype=wp.float64),
    carrier: wp.array(dtype=wp.int32),
    clusters: Clusters,
    place_from: wp.array(dtype=Placement),
    place_to: wp.array(dtype=Placement),
    span: wp.float64,
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
    counts_out: wp.array(dtype=wp.int32),
):
    """Held-back particles stop where they may, and keep as much of their speed as of their way."""
    i = thread_offset + wp.tid()
    f = fraction[i]
    if f < wp.float64(1.0):
        carried = carried_way(i, particle_from[i], carrier[i], clusters, place_from, place_to)
        particle_q_out[i] = particle_end[i]
        particle_qd_out[i] = narrow(f * wide(particle_qd_out[i]) + ((wp.float64(1.0) - f) / span) * carried)
        count_up(counts_out, 0, 1)
