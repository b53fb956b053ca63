"""The update that all explicit schemes share, and the error estimate of embedded pairs."""

import sys

import warp as wp

from .direct import put, real_at, vector_at
from .precision import OPTIONS, real, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])

weights = wp.types.vector(8, real)


@wp.func
def weighted_sum(first: vec3, stage_f: wp.array2d(dtype=vec3), i: int, count: int, w: weights):
    """w₀ first + Σ w_j stage_f[j − 1, i] over the ``count`` further stages.

    Where w₀ is 0 nobody has worked out ``first``, which may be what a step that diverged left there.
    """
    total = vec3()
    if w[0] != real(0.0):
        total = w[0] * first
    for j in range(count):
        total += w[j + 1] * stage_f[j, i]
    return total


@wp.kernel
def advance(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    particle_f: wp.array(dtype=vec3),
    stage_f: wp.array2d(dtype=vec3),
    stage_count: int,
    drift: real,
    position_weights: weights,
    velocity_weights: weights,
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """x ← x + drift v + (1/m) Σ p_j f_j and v ← v + (1/m) Σ w_j f_j, with p in s², w in s.

    As x′ = v is linear, stage velocities need not be kept: forces alone carry all stages. Pinned particles (1/m = 0)
    stay; their driver moves them. May work in place.
    """
    i = thread_offset + wp.tid()
    inv_mass = real_at(particle_inv_mass, i)
    x = vector_at(particle_q, i)
    v = vector_at(particle_qd, i)
    if inv_mass > real(0.0):
        f = vector_at(particle_f, i)
        x += drift * v + inv_mass * weighted_sum(f, stage_f, i, stage_count, position_weights)
        v += inv_mass * weighted_sum(f, stage_f, i, stage_count, velocity_weights)
    put(particle_q_out, i, x)
    put(particle_qd_out, i, v)


@wp.kernel
def step_error(
    # Model
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_f: wp.array(dtype=vec3),
    stage_f: wp.array2d(dtype=vec3),
    stage_count: int,
    position_weights: weights,
    velocity_weights: weights,
    later_q: wp.array(dtype=vec3),
    later_qd: wp.array(dtype=vec3),
    relative: real,
    position_tolerance: real,
    velocity_tolerance: real,
    # Out
    error_out: wp.array(dtype=real),
):
    """Largest error of a step over all particles in units of its tolerance, into ``error_out[0]``, which starts at 0.

    Positions are measured against the way the particle went in the step, not against its coordinates, so that the error
    does not depend on where the origin is. Non-finite errors count as very large ones.
    """
    i = wp.tid()
    inv_mass = particle_inv_mass[i]
    if inv_mass == real(0.0):
        return
    f = particle_f[i]
    x = later_q[i]
    v = later_qd[i]
    dx = wp.length(inv_mass * weighted_sum(f, stage_f, i, stage_count, position_weights))
    dv = wp.length(inv_mass * weighted_sum(f, stage_f, i, stage_count, velocity_weights))
    e_x = dx / (position_tolerance + relative * wp.length(x - particle_q[i]))
    e_v = dv / (velocity_tolerance + relative * wp.length(v))
    e = wp.max(e_x, e_v)
    if not (e < real(1.0e30) and wp.length(x) < real(1.0e30) and wp.length(v) < real(1.0e30)):
        e = real(1.0e30)
    wp.atomic_max(error_out, 0, e)
