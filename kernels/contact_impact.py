"""Impacts: pairs that would pass through each other on the straight way of an interval bounce apart at its end.

Bridson, Fedkiw, Anderson (2002), section 7: where pairs meet is found by continuous collision detection; their end is
moved, and their velocity changed, by the least that keeps them on the sides on which they met. Momentum is conserved.
"""

import sys

import warp as wp

from .closest import combine, pair_weights, time_of_impact
from .contact_pairs import Contacts, Pairs, four_of, put_contact, relative_motion, weights_of, wide
from .contact_response import effective_mobility, pair_friction, part_of, rubbed
from .counting import count_up
from .fixed_sums import KICK_UNIT, MOVE_UNIT, add_fixed, add_share
from .precision import FORWARD_ONLY, real, vec3
from .shapes import MESH, Placement, Shapes, distance, to_local, to_world

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.kernel
def find_impacts(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    pairs: Pairs,
    separation: wp.float64,
    clearance: wp.float64,
    patience: wp.float64,
    stride: int,
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    rounds: wp.array(dtype=wp.int32),
    # Out
    contacts_out: Contacts,
    share_out: wp.array(dtype=wp.int64),
    met_out: wp.array(dtype=wp.int32),
    impacts_out: wp.array(dtype=wp.int32),
    counts_out: wp.array(dtype=wp.int32),
):
    """Pairs that meet: weights and normal there, and how far their ends must part [m] to end ``clearance`` of the
    contact distance apart; and Σ |weight| per particle. Marks their particles, counts them. Pairs of which neither side
    is free to stop, such as pins that are led into an obstacle, are counted once, as pinched.

    Where many meet at once, as a fast obstacle does with little cloth, what one pair takes from another only fades from
    round to round; so over ``patience`` rounds the clearance grows to all of the contact distance.
    """
    grown = wp.min(wp.float64(rounds[0]) / patience, wp.float64(1.0))
    share = clearance + grown * (wp.float64(1.0) - clearance)
    for k in range(thread_offset + wp.tid(), wp.min(pairs.count[0], pairs.kind.shape[0]), stride):
        i = pairs.particles[k]
        x = four_of(particle_from, i)
        u = four_of(particle_to, i) - x
        contacts_out.depth[k] = real(0.0)
        t = time_of_impact(pairs.kind[k], x, u, separation)
        if not t < wp.float64(1.0):
            continue
        x += t * u
        w = pair_weights(pairs.kind[k], x)
        if effective_mobility(particle_inv_mass, i, w) <= wp.float64(0.0):
            if rounds[0] == 0:
                count_up(counts_out, 1, 1)
            continue
        d = combine(w, x)
        n = wp.normalize(d)
        reach = share * wp.float64(pairs.distance[k])
        gap = wp.dot(d + (wp.float64(1.0) - t) * combine(w, u), n)
        count_up(impacts_out, 0, 1)
        for m in range(4):
            met_out[i[m]] = 1
        if gap < reach:
            contacts_out.depth[k] = real(reach - gap)
            put_contact(contacts_out, k, w, n)
            add_share(share_out, i, w, stride == 1)


@wp.func
def relative_speed(
    start: wp.array(dtype=vec3), end: wp.array(dtype=vec3), particle_qd: wp.array(dtype=vec3), cloth_particles: int,
    span: wp.float64, i: wp.vec4i, w: wp.vec4d,
):  # fmt: skip
    """Σ wₖ vₖ [m/s]. Obstacles have no velocities of their own: theirs is their way over the ``span`` [s]."""
    speed = wp.vec3d()
    for m in range(4):
        if i[m] < cloth_particles:
            speed += w[m] * wide(particle_qd[i[m]])
        else:
            speed += (w[m] / span) * (wide(end[i[m]]) - wide(start[i[m]]))
    return speed


@wp.kernel
def bounce(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_friction: wp.array(dtype=real),
    pairs: Pairs,
    stride: int,
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    cloth_particles: int,
    span: wp.float64,
    contacts: Contacts,
    share: wp.array(dtype=wp.int64),
    impacts: wp.array(dtype=wp.int32),
    rounds: wp.array(dtype=wp.int32),
    # Out
    move_out: wp.array2d(dtype=wp.int64),
    kick_out: wp.array2d(dtype=wp.int64),
):
    """Ends part by ``depth``, approach stops, friction takes up to μ times as much from what is tangential.

    All pairs act at once, each by its part; see :func:`contact_response.push_contacts`. Levers reach less far from
    round to round: where they lead nowhere, a hundred rounds must not throw the cloth away.
    """
    for k in range(thread_offset + wp.tid(), wp.min(pairs.count[0], pairs.kind.shape[0]), stride):
        depth = wp.float64(contacts.depth[k])
        if depth <= wp.float64(0.0) or impacts[0] == 0:
            continue
        i = pairs.particles[k]
        w = weights_of(contacts, k)
        n = wide(contacts.normal[k])
        one = wp.float64(1.0)
        effective = effective_mobility(particle_inv_mass, i, w)
        if effective <= wp.float64(0.0):
            continue
        reach = wp.float64(pairs.distance[k]) / wp.float64(1 + rounds[0])
        part = part_of(particle_inv_mass, share, i, w, effective, depth, reach)
        moved = relative_motion(particle_from, particle_to, i, w)
        speed = relative_speed(particle_from, particle_to, particle_qd, cloth_particles, span, i, w)
        friction = pair_friction(particle_friction, i)
        move = depth * n - rubbed(moved, n, friction * depth, one)
        approach = wp.max(-wp.dot(speed, n), wp.float64(0.0))
        kick = approach * n - rubbed(speed, n, friction * approach, one)
        for m in range(4):
            c = part * w[m] * wp.float64(particle_inv_mass[i[m]]) / effective
            add_fixed(move_out, i[m], c * move, MOVE_UNIT, stride == 1)
            add_fixed(kick_out, i[m], c * kick, KICK_UNIT, stride == 1)


@wp.kernel
def keep_out(
    # Model
    thread_offset: int,
    particle_world: wp.array(dtype=wp.int32),
    particle_radius: wp.array(dtype=real),
    shapes: Shapes,
    # State in
    particle_before: wp.array(dtype=vec3),
    place: wp.array(dtype=Placement),
    # Out
    particle_q_out: wp.array(dtype=vec3),
):
    """Puts particles that this round has pushed into spheres, capsules, boxes and planes back on their surfaces.

    Others stay, so that a world does not feel the impacts of another. Meshes are not looked at: their triangles take
    part in the impacts.
    """
    i = thread_offset + wp.tid()
    if particle_q_out[i] == particle_before[i]:
        return
    w = particle_world[i]
    for s in range(shapes.world_start[w], shapes.world_start[w + 1]):
        if shapes.kind[s] != MESH:
            offset = particle_radius[i] + shapes.thickness[s]
            x = to_local(place[s], particle_q_out[i])
            here = distance(shapes.kind[s], shapes.size[s], x)
            if here[3] < real(0.99) * offset:
                out = x + (offset - here[3]) * vec3(here[0], here[1], here[2])
                particle_q_out[i] = to_world(place[s], out)


@wp.kernel
def count_round(
    # Model
    most: int,
    # Out
    impacts_out: wp.array(dtype=wp.int32),
    remaining_out: wp.array(dtype=wp.int32),
    rounds_out: wp.array(dtype=wp.int32),
    counts_out: wp.array(dtype=wp.int32),
):
    """Ends the rounds after ``most`` of them; counts impacts and rounds for the metrics."""
    remaining_out[0] = impacts_out[0]
    if impacts_out[0] == 0:
        return
    rounds_out[0] += 1
    counts_out[2] += impacts_out[0]
    counts_out[3] = wp.max(counts_out[3], rounds_out[0])
    if rounds_out[0] > most:
        impacts_out[0] = 0
