"""Vertex block descent: each particle in turn takes a Newton step on its own three coordinates, its neighbours held.

A step h of implicit Euler is the equation m (δ − δ̂)/h² = f of every particle, f the spring forces at the end of the
step. Particles of one launch have no spring in common, so all of them move downhill at once (Chen et al. 2024).

Second derivatives alone lead too far: a spring at rest does not resist being turned, so a particle that contact has
moved out of its sheet would be thrown across it. Their transverse part is that of a spring turned by 45°, at least.
So it is with strong damping, which resists how a spring turns within the step (:func:`viscous_turning_matrix`).

The springs of a particle are stored in rows: the particle at the other end, and (r [m], k_s [N], k_d [N s]).
"""

import sys

import warp as wp

from .precision import FORWARD_ONLY, mat33, real, vec3
from .spring_law import direction, spring_damping_matrix, spring_force, spring_turning_matrix

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


TURN_SHARE = wp.constant(8.0)


@wp.func
def viscous_turning_matrix(d: vec3, u: vec3, rest_length: real, k_d: real):
    """What damping resists to a spring d that has come to turn, by the way u, within the step [N/m]; ``k_d`` in N.

    An end that moves across the spring by s = |d| tan θ lengthens it, so that (k_d/r) s tan² θ pulls it back, of which
    the derivative at s = 0 knows nothing. At s it is 3 (k_d/r) tan² θ. The tension (k_d/r) e/|d| of a spring that grows
    by e is a part of it; the rest, twice tan² θ, is taken four times, as many neighbours answer at once: with twice,
    free cloth of 17² particles with a damping time of 5 s came from 0.8 to 5.5 m/s in 5 s, so it comes to rest.
    """
    n = direction(d)
    length = wp.length(d)
    across = mat33()
    if length > real(0.0):
        growth = wp.dot(u, n)
        slope = (u - growth * n) / length
        resists = wp.max(growth, real(0.0)) / length + real(TURN_SHARE) * wp.dot(slope, slope)
        across = (k_d / rest_length) * resists * (wp.identity(n=3, dtype=real) - wp.outer(n, n))
    return across


@wp.kernel
def descend(
    # Model
    particles: wp.array(dtype=wp.int32),
    row_start: wp.array(dtype=wp.int32),
    row_other: wp.array(dtype=wp.int32),
    row_law: wp.array(dtype=vec3),
    particle_mass: wp.array(dtype=real),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    inertial: wp.array(dtype=vec3),
    dt: real,
    # Out
    displacement_out: wp.array(dtype=vec3),
):
    """One Newton step of every particle of a colour."""
    k = wp.tid()
    i = particles[k]
    if particle_inv_mass[i] > real(0.0):
        x = particle_q[i]
        moved = displacement_out[i]
        inertia = particle_mass[i] / (dt * dt)
        f = inertia * (inertial[i] - moved)
        hessian = inertia * wp.identity(n=3, dtype=real)
        for row in range(row_start[k], row_start[k + 1]):
            j = row_other[row]
            law = row_law[row]
            u = displacement_out[j] - moved
            d = particle_q[j] - x + u
            f += spring_force(d, u / dt, law[0], law[1], law[2])
            hessian += spring_turning_matrix(d, law[0], law[1])
            hessian += spring_damping_matrix(d, law[0], law[2] / dt) + viscous_turning_matrix(d, u, law[0], law[2] / dt)
        displacement_out[i] = moved + wp.inverse(hessian) * f


@wp.kernel
def extrapolate(
    # State in
    weight: real,
    # Out
    displacement_out: wp.array(dtype=vec3),
    previous_out: wp.array(dtype=vec3),
    before_out: wp.array(dtype=vec3),
):
    """Chebyshev acceleration: δ ← ω (δ − δ″) + δ″ with δ″ of two sweeps ago; then both histories move on."""
    i = wp.tid()
    accelerated = displacement_out[i]
    if weight > real(1.0):
        accelerated = weight * (accelerated - before_out[i]) + before_out[i]
    displacement_out[i] = accelerated
    before_out[i] = previous_out[i]
    previous_out[i] = accelerated
