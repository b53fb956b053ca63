"""Woven triangles solved one after another: extended position-based dynamics of the yarns inside them.

Each yarn is solved as the spring in ``xpbd.py``, of which this is the general form: from end to end it is
d = Σ w_k x_k with the slopes w_k of the corners, so that an impulse h J along it moves corner k by −w_k h J/m_k, and
W = Σ w_k²/m_k. Beyond a strain limit the law is linear again, with another slope, and solved as exactly.

The four yarns of a triangle are solved in turn by one thread; triangles of one launch share no particle.
"""

import sys

import warp as wp

from .precision import OPTIONS, real, vec3
from .woven import WovenModel, corner_slopes, direction_of, limit_of, stiffness_of

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.func
def yarn_impulse(d: vec3, moved: vec3, k: real, law: vec3, limit: real, compliance: real, dt: real):
    """h J of a yarn; d is what F e would be without it, ``moved`` the part of d of this step, ``compliance`` W."""
    length = wp.length(d)
    inverse = real(0.0)  # a yarn of zero length has no direction
    if length > real(0.0):
        inverse = real(1.0) / length
    elastic = dt * dt * k
    viscous = dt * law[0] * k
    damped = viscous * wp.dot(d, moved) * inverse
    impulse = (elastic * (length - real(1.0)) + damped) / (real(1.0) + (elastic + viscous) * compliance)
    if limit > real(0.0) and length - compliance * impulse > real(1.0) + law[1]:
        pull = elastic * (length - real(1.0)) + damped + limit * elastic * (length - real(1.0) - law[1])
        impulse = pull / (real(1.0) + (elastic + viscous + limit * elastic) * compliance)
    return (impulse * inverse) * d


@wp.kernel
def solve_triangles(
    # Model
    thread_offset: int,
    triangles: wp.array(dtype=wp.int32),
    woven: WovenModel,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    dt: real,
    kept: real,
    # Out
    displacement_out: wp.array(dtype=vec3),
    yarn_force_out: wp.array(dtype=vec3),
):
    """Solves the ``triangles`` of one colour.

    ``yarn_force_out`` [J], four for each triangle, is that of the sweep before, of which the displacements contain the
    share ``kept``.
    """
    i = thread_offset + wp.tid()
    t = triangles[i]
    c = woven.corners[t]
    moved_0 = displacement_out[c[0]]
    moved_1 = displacement_out[c[1]]
    moved_2 = displacement_out[c[2]]
    m = vec3(particle_inv_mass[c[0]], particle_inv_mass[c[1]], particle_inv_mass[c[2]])
    g_0 = corner_slopes(woven, t, 0)
    g_1 = corner_slopes(woven, t, 1)
    g_2 = corner_slopes(woven, t, 2)
    first = particle_q[c[1]] - particle_q[c[0]]
    second = particle_q[c[2]] - particle_q[c[0]]
    for yarn in range(4):
        e = direction_of(yarn)
        w_0 = wp.dot(e, g_0)
        w_1 = wp.dot(e, g_1)
        w_2 = wp.dot(e, g_2)
        compliance = w_0 * w_0 * m[0] + w_1 * w_1 * m[1] + w_2 * w_2 * m[2]
        old = vec3()
        if kept > real(0.0):
            old = (kept * dt * dt) * yarn_force_out[4 * i + yarn]
        moved = w_1 * (moved_1 - moved_0) + w_2 * (moved_2 - moved_0) + compliance * old
        d = w_1 * first + w_2 * second + moved
        k = stiffness_of(woven.stiffness[t], yarn)
        impulse = yarn_impulse(d, moved, k, woven.law[t], limit_of(woven.law[t], yarn), compliance, dt)
        change = impulse - old
        moved_0 -= (w_0 * m[0]) * change
        moved_1 -= (w_1 * m[1]) * change
        moved_2 -= (w_2 * m[2]) * change
        yarn_force_out[4 * i + yarn] = (real(1.0) / (dt * dt)) * impulse
    displacement_out[c[0]] = moved_0
    displacement_out[c[1]] = moved_1
    displacement_out[c[2]] = moved_2
