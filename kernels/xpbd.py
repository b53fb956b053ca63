"""Springs solved one after another: extended position-based dynamics, and its ancestor without compliance.

Implicit Euler asks of each spring the impulse J = h f along n, with the law's force at the end of the step. All other
springs held, the two ends give d = d̂ − h J W n, where d̂ is what d would be without this spring and W = 1/m_p + 1/m_q.
The force is along d, so d ∥ d̂, and as the law is linear in length the answer is exact:

    h J = [ K (|d̂| − r) + D n·(d̂ − d₀) ] / (1 + (K + D) W),      K = h² k_s/r,   D = h k_d/r,   n = d̂/|d̂|

In XPBD's terms (Macklin, Müller, Chentanez 2016): C = |d| − r, compliance α = r/k_s, Rayleigh-like damping β = k_d/r.
The form here needs no division by k_s. The force vector is kept per spring and taken back before the spring is solved
again, so that the iteration ends at the solution of the implicit step; the original keeps its magnitude only, and
leaves what was applied along former directions where it is. So a step may also begin with forces of the step before.

Springs of one launch share no particle, so no atomics are needed and the result does not depend on their order.
"""

import sys

import warp as wp

from .precision import OPTIONS, real, vec3
from .spring_law import direction

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.func
def spring_impulse(d: vec3, moved: vec3, law: vec3, w: real, dt: real):
    """h J [N s²] of a spring with the two ends' inverse masses w [1/kg] together.

    ``d`` is d̂, ``moved`` how much of it the step has brought so far, ``law`` (r [m], k_s/r [N/m], k_d/r [N s/m]).
    """
    length = wp.length(d)
    inverse = real(0.0)  # a spring of zero length has no direction
    if length > real(0.0):
        inverse = real(1.0) / length
    elastic = dt * dt * law[1]
    viscous = dt * law[2]
    pull = elastic * (length - law[0]) + viscous * wp.dot(d, moved) * inverse
    return (pull * inverse / (real(1.0) + (elastic + viscous) * w)) * d


@wp.kernel
def solve_springs(
    # Model
    thread_offset: int,
    spring_ends: wp.array(dtype=wp.vec2i),
    spring_law: wp.array(dtype=vec3),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    dt: real,
    kept: real,
    # Out
    displacement_out: wp.array(dtype=vec3),
    spring_force_out: wp.array(dtype=vec3),
):
    """Solves the springs of one colour; ``spring_law`` holds (r [m], k_s/r [N/m], k_d/r [N s/m]) of each.

    ``spring_force_out`` [N] is that of the sweep before, of which the displacements contain the share ``kept``.
    """
    s = thread_offset + wp.tid()
    p = spring_ends[s][0]
    q = spring_ends[s][1]
    w_p = particle_inv_mass[p]
    w_q = particle_inv_mass[q]
    old = vec3()
    if kept > real(0.0):  # of what there was before nothing is read where nothing counts: it may be of another run
        old = (kept * dt * dt) * spring_force_out[s]
    moved = displacement_out[q] - displacement_out[p] + (w_p + w_q) * old
    impulse = spring_impulse(particle_q[q] - particle_q[p] + moved, moved, spring_law[s], w_p + w_q, dt)
    displacement_out[p] = displacement_out[p] + w_p * (impulse - old)
    displacement_out[q] = displacement_out[q] - w_q * (impulse - old)
    spring_force_out[s] = (real(1.0) / (dt * dt)) * impulse


@wp.kernel
def project_springs(
    # Model
    spring_ends: wp.array(dtype=wp.vec2i),
    spring_law: wp.array(dtype=vec3),
    spring_factor: wp.array(dtype=real),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    displacement_out: wp.array(dtype=vec3),
):
    """Moves the ends of each spring by the share ``spring_factor`` [0, 1] of what restores its rest length, the first
    of its ``spring_law``.

    Position-based dynamics of Müller et al. (2007): a share, not a stiffness; masses only weight the two ends.
    """
    s = wp.tid()
    p = spring_ends[s][0]
    q = spring_ends[s][1]
    w_p = particle_inv_mass[p]
    w_q = particle_inv_mass[q]
    total = w_p + w_q
    if total > real(0.0):
        d = particle_q[q] - particle_q[p] + displacement_out[q] - displacement_out[p]
        correction = (spring_factor[s] * (wp.length(d) - spring_law[s][0]) / total) * direction(d)
        displacement_out[p] = displacement_out[p] + w_p * correction
        displacement_out[q] = displacement_out[q] - w_q * correction
