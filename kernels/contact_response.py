"""Response of pairs in contact, after each step: positions leave the contact, approach ends, friction acts."""

import sys

import warp as wp

from .closest import combine, pair_weights
from .contact_knots import Crossed, note_crossed, through
from .contact_load import PADDING, FurtherPasses, Load, add_lack, earn_pass, load_between, takes_part
from .contact_pairs import Contacts, Pairs, four_of, narrow, put_contact, relative_motion, weights_of, wide
from .fixed_sums import KICK_UNIT, MOVE_UNIT, SHARE_UNIT, add_fixed, add_share, from_fixed
from .precision import FORWARD_ONLY, real, vec3, vec4

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


# [s] in which contacts give back depth that no velocity has brought them. All of it at once puts energy into cloth
# that is hit: with steps of 18 µs sheets gained a third of what they had, with this they lose as much as they should.
RECOVERY = wp.constant(wp.float64(5.0e-4))
# Right beside a pin cloth turns about that, so what is in its way there asks its vertices to go round in no time. A pin
# that came near a box threw them kilometres away.
LEVERAGE = wp.constant(wp.float64(4.0))


@wp.func
def effective_mobility(particle_inv_mass: wp.array(dtype=real), i: wp.vec4i, w: wp.vec4d):
    """Σ wₖ²/mₖ [1/kg]: the pair's diagonal in the contact matrix J M⁻¹ Jᵀ; 0 if none of the four can move."""
    total = wp.float64(0.0)
    for m in range(4):
        total += w[m] * w[m] * wp.float64(particle_inv_mass[i[m]])
    return total


@wp.func
def part_of(
    particle_inv_mass: wp.array(dtype=real), share: wp.array(dtype=wp.int64), i: wp.vec4i, w: wp.vec4d,
    effective: wp.float64, depth: wp.float64, reach: wp.float64,
):  # fmt: skip
    """By which part a pair that lacks ``depth`` [m] acts while all act at once: its diagonal ``effective`` in the
    contact matrix over a bound on the sum of its row [1/kg], by all that its particles are part of.

    Where one of them would move much further than the pair, it is less: no particle moves by more than ``LEVERAGE``
    times the depth or ``reach``, or is kicked by more than that many times the approach.
    """
    row = wp.float64(0.0)
    most = wp.float64(0.0)
    for m in range(4):
        pull = wp.abs(w[m]) * wp.float64(particle_inv_mass[i[m]])
        most = wp.max(most, pull)
        row += pull * wp.float64(share[i[m]]) / SHARE_UNIT
    if most > LEVERAGE * effective:
        row = wp.max(row, most / LEVERAGE * wp.max(depth / reach, wp.float64(1.0)))
    return effective / row


@wp.kernel
def find_contacts(
    # Model
    thread_offset: int,
    pairs: Pairs,
    stride: int,
    # State in
    particle_q: wp.array(dtype=vec3),
    load: Load,
    # Out
    contacts_out: Contacts,
    share_out: wp.array(dtype=wp.int64),
    further_out: FurtherPasses,
    crossed_out: Crossed,
):
    """Which pairs are closer than they aim to be: weights, normal, depth [m]; and Σ |weight| per particle.

    They aim at their contact distance and some padding for what they carry, which may also earn them another pass.
    Worlds with pairs that are through each other are noted.
    """
    for k in range(thread_offset + wp.tid(), wp.min(pairs.count[0], pairs.kind.shape[0]), stride):
        i = pairs.particles[k]
        if not takes_part(further_out, load.world[i[0]], contacts_out.depth[k], pairs.distance[k]):
            contacts_out.depth[k] = wp.min(contacts_out.depth[k], real(0.0))
            continue
        x = four_of(particle_q, i)
        zero = wp.float64(0.0)
        w = pair_weights(pairs.kind[k], x)
        d = combine(w, x)
        length = wp.length(d)
        n = wide(pairs.side[k])
        distance = wp.float64(pairs.distance[k])
        if length > wp.float64(1.0e-3) * distance:
            if through(w, d, n):
                n = -d / length
                note_crossed(crossed_out, load.world[i[0]])
            else:
                n = d / length
        carried = load_between(load, i, w)
        depth = distance + wp.min(carried, PADDING * distance) - wp.dot(d, n)
        contacts_out.depth[k] = real(depth)
        if depth > zero:
            earn_pass(further_out, load, i, carried)
            put_contact(contacts_out, k, w, n)
            add_share(share_out, i, w, stride == 1)


@wp.func
def pair_friction(particle_friction: wp.array(dtype=real), i: wp.vec4i):
    """Coulomb's coefficient of a pair: the geometric mean of its two sides."""
    return wp.sqrt(wp.float64(particle_friction[i[0]]) * wp.float64(particle_friction[i[3]]))


@wp.func
def rubbed(moved: wp.vec3d, n: wp.vec3d, most: wp.float64, part: wp.float64):
    """What friction takes from the tangential part of a relative motion: no more than ``most``."""
    tangential = moved - wp.dot(moved, n) * n
    slip = part * wp.length(tangential)
    share = wp.float64(0.0)
    if slip > wp.float64(0.0):
        share = part * wp.min(most / slip, wp.float64(1.0))
    return share * tangential


@wp.kernel
def push_contacts(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_friction: wp.array(dtype=real),
    pairs: Pairs,
    stride: int,
    # State in
    particle_start: wp.array(dtype=vec3),
    particle_q: wp.array(dtype=vec3),
    particle_free: wp.array(dtype=vec3),
    dt: wp.float64,
    contacts: Contacts,
    share: wp.array(dtype=wp.int64),
    load: Load,
    # Out
    move_out: wp.array2d(dtype=wp.int64),
    kick_out: wp.array2d(dtype=wp.int64),
    lack_out: wp.array(dtype=wp.int64),
):
    """Positions leave the contact; velocities lose what brought them there; friction acts within Coulomb's cone.

    All pairs act at once (Jacobi), each by the part that keeps them together from overshooting: its diagonal over the
    sum of its row in the contact matrix J M⁻¹ Jᵀ. As it is one number for all four particles, momentum is conserved.
    A pair's part of the depth goes to the positions, at once as far as the pair approached in this step, and later
    what is left. Velocities lose the approach, over dt: contact stops what comes, but throws nothing back. For them
    ``particle_free`` counts: where particles would be had they been moved by velocities only. What other contacts of
    the same step did to positions is not an approach. (Counted as such it drove sheets thrown together apart, the more
    the shorter the steps: to 60 times their energy with steps of 14 µs.) Friction takes up to μ times the push from
    the tangential motion. (Measured on a pile of four sheets at rest, root mean square velocity that the positions do
    not have: 0.12 m/s with the part of the approach instead, 0.012 m/s so.)

    ``lack``, unless it is empty, gets the sum over a particle's pairs of what these lacked of their distance when the
    step began [m], where both sides are cloth.
    """
    for k in range(thread_offset + wp.tid(), wp.min(pairs.count[0], pairs.kind.shape[0]), stride):
        depth = wp.float64(contacts.depth[k])
        if depth <= wp.float64(0.0):
            continue
        i = pairs.particles[k]
        w = weights_of(contacts, k)
        n = wide(contacts.normal[k])
        zero = wp.float64(0.0)
        effective = effective_mobility(particle_inv_mass, i, w)
        if effective <= zero:
            continue
        distance = wp.float64(pairs.distance[k])
        part = part_of(particle_inv_mass, share, i, w, effective, depth, distance)
        moved = relative_motion(particle_start, particle_q, i, w)
        depth_share = part * depth
        push = wp.min(depth_share, wp.max(-wp.dot(moved, n), zero))
        friction = pair_friction(particle_friction, i)
        carried = relative_motion(particle_start, particle_free, i, w)
        stop = wp.min(depth_share, wp.max(-wp.dot(carried, n), zero))
        kick = (stop * n - rubbed(carried, n, friction * stop, part)) / (effective * dt)
        out = push + wp.min(dt / RECOVERY, wp.float64(1.0)) * (depth_share - push)
        move = (out * n - rubbed(moved, n, friction * push, part)) / effective
        add_lack(lack_out, load, particle_start, i, w, n, distance, stride == 1)
        for m in range(4):
            c = w[m] * wp.float64(particle_inv_mass[i[m]])
            add_fixed(move_out, i[m], c * move, MOVE_UNIT, stride == 1)
            add_fixed(kick_out, i[m], c * kick, KICK_UNIT, stride == 1)


@wp.kernel
def stand(
    # Model
    thread_offset: int,
    dt: real,
    # State in
    support: wp.array(dtype=vec4),
    load: Load,
    particle_start: wp.array(dtype=vec3),
    particle_end: wp.array(dtype=vec3),
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_free_out: wp.array(dtype=vec3),
):
    """The ends of particles as pairs are to see them: what an obstacle held up in the last step it holds in this one.

    ``support`` has its normal there, unit or zero, and its velocity along that [m/s]. Obstacles answer after contact
    among cloths; unless that knows of them, the whole of a pile sinks in each pass and only its lowest layer is put
    back, which two passes or eight then press together alike. Only of particles that carry cloth: others are pushed
    off the edges of obstacles by pairs, too, and had these left all to the obstacle, friction would hold on to what a
    tumbling box drags along.
    """
    i = thread_offset + wp.tid()
    x = particle_end[i]
    n = vec3(support[i][0], support[i][1], support[i][2])
    if load.length[i] > real(0.0) and wp.dot(n, n) > real(0.0):
        start = particle_start[i]
        free = particle_free_out[i]
        least = dt * support[i][3]
        x += wp.max(least - wp.dot(x - start, n), real(0.0)) * n
        particle_free_out[i] = free + wp.max(least - wp.dot(free - start, n), real(0.0)) * n
    particle_q_out[i] = x


@wp.kernel
def commit_push(
    # Model
    thread_offset: int,
    dt: wp.float64,
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
    move_out: wp.array2d(dtype=wp.int64),
    kick_out: wp.array2d(dtype=wp.int64),
    share_out: wp.array(dtype=wp.int64),
    particle_free_out: wp.array(dtype=vec3),
):
    """Adds what the contacts ask for, over dt [s], and clears the sums for the next round."""
    i = thread_offset + wp.tid()
    if share_out[i] > wp.int64(0):
        particle_q_out[i] = narrow(wide(particle_q_out[i]) + from_fixed(move_out, i, MOVE_UNIT))
        kick = from_fixed(kick_out, i, KICK_UNIT)
        particle_qd_out[i] = narrow(wide(particle_qd_out[i]) + kick)
        particle_free_out[i] = narrow(wide(particle_free_out[i]) + dt * kick)
        share_out[i] = wp.int64(0)
        for m in range(3):
            move_out[i, m] = wp.int64(0)
            kick_out[i, m] = wp.int64(0)
