"""Response of particles to obstacles at the end of a step: non-penetration, restitution, Coulomb friction.

For each particle the step gave a path from x₀ to x₁ and a velocity v₁. A contact is a point of the shape's surface
moved out by the contact distance, with its normal n and the displacement of the obstacle's material there. Then

* the normal velocity relative to the obstacle becomes −e times the approach speed from *before* the step (so that a
  resting particle, which gravity accelerates within each step, does not bounce);
* friction takes at most μ times the normal impulse from the tangential relative velocity (Coulomb's cone, sticking
  included), and the same fraction from the tangential relative displacement, so that positions and velocities agree for
  any integrator and any number of substeps;
* the position is put back on the offset surface. What sticks keeps its place on the obstacle to the last bit: no creep.

Where a path meets an obstacle is found in ``obstacle_hit.py``.
"""

import sys

import warp as wp

from .direct import int_at, put, real_at, vector_at
from .obstacle_hit import Hit, analytic_hit, find_hit, mean_friction
from .precision import OPTIONS, real, vec3, vec4
from .shapes import Placement, Shapes, to_local, to_world

wp.set_module_options(OPTIONS, module=sys.modules[__name__])

MAX_PASSES = wp.constant(4)


@wp.struct
class Motion:
    """End position [m] and velocity [m/s] of a particle."""

    x: vec3
    v: vec3


@wp.func
def resolve(
    x0: vec3, v0: vec3, end: Motion, n: vec3, carried: vec3, dt: real, gap: real, start_gap: real, slop: real,
    friction: real, restitution: real, given: vec3,
):  # fmt: skip
    """Motion after one contact with plane normal n; ``carried`` is the obstacle's displacement there [m].

    ``given`` is what the obstacle has already done to the velocity within the step [m/s]: its normal part counts for
    friction, and friction is put right to what Coulomb's law says, be it more or less.
    """
    out = Motion()
    surface_velocity = carried / dt
    v = end.v - surface_velocity
    approach = wp.min(wp.dot(v0 - surface_velocity, n), real(0.0))
    vn = wp.dot(v, n)
    held = wp.max(wp.dot(given, n), real(0.0))
    rubbed = given - wp.dot(given, n) * n
    impulse = -restitution * approach - vn
    tangential = v - vn * n
    change = -rubbed
    stuck = int(0)
    if impulse > real(0.0) or held > real(0.0):
        wanted = rubbed - tangential
        most = friction * (wp.max(impulse, real(0.0)) + held)
        size = wp.length(wanted)
        if size <= most:
            stuck = int(1)
            change = -tangential
        else:
            change = (most / size) * wanted - rubbed
        out.v = tangential + change + (vn + wp.max(impulse, real(0.0))) * n + surface_velocity
    else:
        out.v = v + change + surface_velocity
    resting = wp.abs(start_gap) <= slop
    if stuck == 1 and resting:
        out.x = x0 + carried
        return out
    moved = end.x - x0 - carried
    normal_part = wp.dot(moved, n)
    in_contact = real(1.0)
    if start_gap > slop and normal_part < real(0.0):
        in_contact = wp.clamp(gap / normal_part, real(0.0), real(1.0))
    slip = wp.length(tangential)
    slide = in_contact * (moved - normal_part * n)
    if wp.dot(given, given) > real(0.0):
        slide = -dt * change
    elif stuck == 0:
        slide = (wp.length(change) / wp.max(slip, real(1.0e-30))) * slide
    out.x = end.x - slide + wp.max(-gap, real(0.0)) * n
    return out


@wp.struct
class Pass:
    """What one look at one obstacle made of a particle's motion, whether another look may change it again, and, if the
    obstacle held the particle up, its normal and its velocity along that [m/s], else zero."""

    motion: Motion
    again: wp.int32
    support: vec4


@wp.func
def answer(
    hit: Hit, start: Placement, end: Placement, a: vec3, x0: vec3, v0: vec3, now: Motion, dt: real, slop: real,
    friction: real, restitution: real, given: vec3,
):  # fmt: skip
    """One pass: the motion ``now`` of a particle that began the step at x0 (a in the obstacle's frame), v0."""
    result = Pass()
    result.motion = now
    if hit.found == 1:
        n = end.rotation * hit.normal
        carried = to_world(end, a) - to_world(start, a) + end.rotation * hit.surface
        result.motion = resolve(
            x0, v0, now, n, carried, dt, hit.gap, hit.start_gap, slop, friction, restitution, given
        )  # fmt: skip
        if wp.dot(result.motion.v - now.v + given, n) > real(0.0):
            result.support = vec4(n[0], n[1], n[2], wp.dot(carried, n) / dt)
        if hit.gap <= -slop:
            result.again = 1
    return result


@wp.func
def hold(support_out: wp.array(dtype=vec4), i: int, support: vec4):
    """Notes what held a particle up, where anybody wants to know."""
    if support_out.shape[0] > 0:
        support_out[i] = support


@wp.kernel(enable_backward=False)
def respond(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    particle_radius: wp.array(dtype=real),
    particle_friction: wp.array(dtype=real),
    shapes: Shapes,
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    start: wp.array(dtype=Placement),
    end: wp.array(dtype=Placement),
    dt: real,
    impulse: wp.array(dtype=vec3),
    impulse_shape: wp.array(dtype=wp.int32),
    clear_of: wp.array(dtype=vec3),
    clearance: wp.array(dtype=real),
    # Out
    support_out: wp.array(dtype=vec4),
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """Corrects the end of a step (``_out``) that began at (``particle_q``, ``particle_qd``) against every obstacle.

    ``impulse`` [m/s] of obstacle ``impulse_shape``, unless that is −1, is already in the velocities. Particles that
    have been within ``clearance`` of ``clear_of`` all the while have met nothing; see ``obstacle_clearance.py``.
    ``support``, unless it is empty, gets normal and speed of an obstacle that held the particle up, or zero.
    """
    i = thread_offset + wp.tid()
    free = real_at(clearance, i)
    here = vector_at(clear_of, i)
    x = vector_at(particle_q, i)
    now = Motion()
    now.x = vector_at(particle_q_out, i)
    clear = wp.length(x - here) < free and wp.length(now.x - here) < free
    if real_at(particle_inv_mass, i) == real(0.0) or (clear and int_at(impulse_shape, i) < 0):
        hold(support_out, i, vec4())
        return
    support = vec4()
    w = particle_world[i]
    v = vector_at(particle_qd, i)
    now.v = vector_at(particle_qd_out, i)
    for s in range(shapes.world_start[w], shapes.world_start[w + 1]):
        offset = particle_radius[i] + shapes.thickness[s]
        slop = real(1.0e-3) * offset
        friction = mean_friction(particle_friction[i], shapes.friction[s])
        a = to_local(start[s], x)
        given = vec3()
        if impulse_shape[i] == s:
            given = impulse[i]
        for _pass in range(MAX_PASSES):
            hit = find_hit(shapes, s, dt, a, to_local(end[s], now.x), offset, slop)
            answered = answer(
                hit, start[s], end[s], a, x, v, now, dt, slop, friction,
                shapes.restitution[s], given,
            )  # fmt: skip
            now = answered.motion
            given = vec3()
            if wp.dot(answered.support, answered.support) > real(0.0):
                support = answered.support
            if answered.again == 0:
                break
    hold(support_out, i, support)
    put(particle_q_out, i, now.x)
    put(particle_qd_out, i, now.v)


@wp.kernel
def respond_once(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    particle_radius: wp.array(dtype=real),
    particle_friction: wp.array(dtype=real),
    shapes: Shapes,
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    start: wp.array(dtype=Placement),
    end: wp.array(dtype=Placement),
    dt: real,
    impulse: wp.array(dtype=vec3),
    impulse_shape: wp.array(dtype=wp.int32),
    shape: int,
    first: int,
    # Out
    again_out: wp.array(dtype=wp.int32),
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """One pass of :func:`respond` against the obstacle number ``shape`` of each world, no mesh, as gradients need it.

    Its loops are launches instead, as adjoints of loops do not know earlier values. The ``first`` pass is for all
    particles, each further one for those of which the last one said so in ``again_out``.
    """
    i = thread_offset + wp.tid()
    s = shapes.world_start[particle_world[i]] + shape
    wanted = first == 1 or again_out[i] == 1
    again_out[i] = 0
    if particle_inv_mass[i] > real(0.0) and s < shapes.world_start[particle_world[i] + 1] and wanted:
        now = Motion()
        now.x = particle_q_out[i]
        now.v = particle_qd_out[i]
        given = vec3()
        if first == 1 and impulse_shape[i] == s:
            given = impulse[i]
        offset = particle_radius[i] + shapes.thickness[s]
        slop = real(1.0e-3) * offset
        friction = mean_friction(particle_friction[i], shapes.friction[s])
        a = to_local(start[s], particle_q[i])
        hit = analytic_hit(shapes.kind[s], shapes.size[s], a, to_local(end[s], now.x), offset, slop)
        answered = answer(
            hit, start[s], end[s], a, particle_q[i], particle_qd[i], now, dt, slop, friction, shapes.restitution[s],
            given,
        )  # fmt: skip
        again_out[i] = answered.again
        particle_q_out[i] = answered.motion.x
        particle_qd_out[i] = answered.motion.v
