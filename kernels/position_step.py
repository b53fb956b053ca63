"""Start and end of a step that is solved for displacements: the part shared by the position-based schemes.

With x₀, v₀ at the start of a step of h seconds, the unknown is the displacement δ = x − x₀ of each particle. Springs
aside, it would be δ̂ = h v₀ + h² f/m: the inertial displacement. Solving for δ rather than for x keeps velocities δ/h
and damping free of the cancellation that subtracting two positions brings, which matters in single precision.

What a scheme does not ask for, δ̂ itself or what springs did, are arrays of no length: a step of few sweeps waits for
memory as much as it computes.
"""

import sys

import warp as wp

from .direct import put, real_at, vector_at
from .precision import OPTIONS, real, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.kernel
def ask_to_forget(
    # State in
    share: wp.float64,
    dt: wp.float64,
    # Out
    past_dt_out: wp.array(dtype=wp.float64),
    wanted_out: wp.array(dtype=wp.int32),
):
    """1 if springs would be expected to move anything further than in the step before, which was shorter; keeps dt.

    Of worlds that have not stepped yet, with ``past_dt`` 0, there is nothing to forget.
    """
    w = wp.tid()
    past = past_dt_out[w]
    if past > wp.float64(0.0) and share * dt * dt > past * past:
        wanted_out[0] = 1
    past_dt_out[w] = dt


@wp.kernel
def predict(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    particle_f: wp.array(dtype=vec3),
    spring_acceleration: wp.array(dtype=vec3),
    warm_start: real,
    dt: real,
    # Out
    inertial_out: wp.array(dtype=vec3),
    displacement_out: wp.array(dtype=vec3),
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """Inertial displacement δ̂, and δ = δ̂ + h² a to begin with: a share of the springs' acceleration one step earlier.

    Pinned particles stay; their driver moves them.
    """
    i = thread_offset + wp.tid()
    w = real_at(particle_inv_mass, i)
    inertial = vec3()
    if w > real(0.0):
        inertial = dt * (vector_at(particle_qd, i) + (dt * w) * vector_at(particle_f, i))
    else:
        put(particle_q_out, i, vector_at(particle_q, i))
        put(particle_qd_out, i, vec3())
    if inertial_out.shape[0] > 0:
        put(inertial_out, i, inertial)
    if spring_acceleration.shape[0] > 0:
        inertial += (warm_start * dt * dt) * vector_at(spring_acceleration, i)
    put(displacement_out, i, inertial)


@wp.kernel
def displace_pins(
    # Model
    particle_inv_mass: wp.array(dtype=real),
    pin_particle: wp.array(dtype=wp.int32),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_q_end: wp.array(dtype=vec3),
    # Out
    displacement_out: wp.array(dtype=vec3),
):
    """Displacement of driven pins over the step."""
    i = pin_particle[wp.tid()]
    if particle_inv_mass[i] == real(0.0):
        displacement_out[i] = particle_q_end[i] - particle_q[i]


@wp.kernel
def finish(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    inertial: wp.array(dtype=vec3),
    displacement: wp.array(dtype=vec3),
    dt: real,
    # Out
    spring_acceleration_out: wp.array(dtype=vec3),
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """x = x₀ + δ and v = δ/h of free particles; keeps the acceleration by springs (δ − δ̂)/h² for the next step."""
    i = thread_offset + wp.tid()
    if real_at(particle_inv_mass, i) > real(0.0):
        moved = vector_at(displacement, i)
        put(particle_q_out, i, vector_at(particle_q, i) + moved)
        put(particle_qd_out, i, moved / dt)
        if spring_acceleration_out.shape[0] > 0:
            put(spring_acceleration_out, i, (moved - vector_at(inertial, i)) / (dt * dt))
