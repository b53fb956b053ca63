"""Strain limiting: beyond a strain ε_L the yarns of a fabric are straight, and a second, stiffer spring comes in.

    f_p = k_L max(|d|/r − 1 − ε_L, 0) n        f_q = −f_p        E = ½ k_L r max(|d|/r − 1 − ε_L, 0)²

beside the spring law, which stays as it is: together the two are biphasic. k_L is in newtons and comes from a stiffness
of the sheet as k_s does, so that it does not depend on resolution. A force along the spring conserves both momenta.
"""

import sys

import warp as wp

from .precision import OPTIONS, mat33, real, vec3
from .spring_law import direction

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.func
def excess_strain(d: vec3, rest_length: real, limit: real):
    """max(|d|/r − 1 − ε_L, 0)."""
    return wp.max(wp.length(d) / rest_length - real(1.0) - limit, real(0.0))


@wp.func
def limit_matrix(d: vec3, rest_length: real, limit: real, k: real):
    """Second derivative of E with respect to d [N/m]: (k_L/r) n nᵀ + (T/|d|)(I − n nᵀ); never negative."""
    excess = excess_strain(d, rest_length, limit)
    if excess == real(0.0):
        return mat33()
    n = direction(d)
    nn = wp.outer(n, n)
    identity = wp.identity(n=3, dtype=real)
    return mat33((k / rest_length) * nn + (k * excess / wp.length(d)) * (identity - nn))


@wp.kernel
def gather_forces(
    # Model
    particle_spring_start: wp.array(dtype=wp.int32),
    particle_spring_ids: wp.array(dtype=wp.int32),
    spring_indices: wp.array(dtype=wp.vec2i),
    spring_rest_length: wp.array(dtype=real),
    spring_limit: wp.array(dtype=real),
    spring_limit_stiffness: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    particle_f_out: wp.array(dtype=vec3),
):
    """Adds the forces of each particle's springs, in the order of their numbers."""
    i = wp.tid()
    total = particle_f_out[i]
    for k in range(particle_spring_start[i], particle_spring_start[i + 1]):
        s = particle_spring_ids[k]
        if spring_limit_stiffness[s] > real(0.0):
            other = spring_indices[s][0] + spring_indices[s][1] - i
            d = particle_q[other] - particle_q[i]
            excess = excess_strain(d, spring_rest_length[s], spring_limit[s])
            total += (spring_limit_stiffness[s] * excess) * direction(d)
    particle_f_out[i] = total


@wp.kernel
def gather_products(
    # Model
    particle_spring_start: wp.array(dtype=wp.int32),
    particle_spring_ids: wp.array(dtype=wp.int32),
    spring_indices: wp.array(dtype=wp.vec2i),
    spring_rest_length: wp.array(dtype=real),
    spring_limit: wp.array(dtype=real),
    spring_limit_stiffness: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    x: wp.array(dtype=vec3),
    stiffness: real,
    # Out
    product_out: wp.array(dtype=vec3),
):
    """Adds ``stiffness`` K x."""
    i = wp.tid()
    total = product_out[i]
    for k in range(particle_spring_start[i], particle_spring_start[i + 1]):
        s = particle_spring_ids[k]
        if spring_limit_stiffness[s] > real(0.0):
            other = spring_indices[s][0] + spring_indices[s][1] - i
            d = particle_q[other] - particle_q[i]
            m = limit_matrix(d, spring_rest_length[s], spring_limit[s], spring_limit_stiffness[s])
            total += stiffness * (m * (x[i] - x[other]))
    product_out[i] = total


@wp.kernel
def diagonal(
    # Model
    particle_spring_start: wp.array(dtype=wp.int32),
    particle_spring_ids: wp.array(dtype=wp.int32),
    spring_indices: wp.array(dtype=wp.vec2i),
    spring_rest_length: wp.array(dtype=real),
    spring_limit: wp.array(dtype=real),
    spring_limit_stiffness: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    stiffness: real,
    # Out
    blocks_out: wp.array(dtype=mat33),
):
    """Adds the 3×3 blocks on the diagonal of ``stiffness`` K."""
    i = wp.tid()
    total = mat33()
    for k in range(particle_spring_start[i], particle_spring_start[i + 1]):
        s = particle_spring_ids[k]
        if spring_limit_stiffness[s] > real(0.0):
            d = particle_q[spring_indices[s][1]] - particle_q[spring_indices[s][0]]
            total += limit_matrix(d, spring_rest_length[s], spring_limit[s], spring_limit_stiffness[s])
    blocks_out[i] = blocks_out[i] + stiffness * total


@wp.kernel
def energy(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    spring_indices: wp.array(dtype=wp.vec2i),
    spring_rest_length: wp.array(dtype=real),
    spring_limit: wp.array(dtype=real),
    spring_limit_stiffness: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    energy_out: wp.array(dtype=wp.float64),
):
    """Adds E [J] to ``energy_out[world]``."""
    s = wp.tid()
    ends = spring_indices[s]
    r = spring_rest_length[s]
    excess = excess_strain(particle_q[ends[1]] - particle_q[ends[0]], r, spring_limit[s])
    if spring_limit_stiffness[s] > real(0.0) and excess > real(0.0):
        e = real(0.5) * spring_limit_stiffness[s] * r * excess * excess
        wp.atomic_add(energy_out, particle_world[ends[0]], wp.float64(e))


@wp.kernel
def limit_springs(
    # Model
    spring_ends: wp.array(dtype=wp.vec2i),
    limit_law: wp.array(dtype=vec3),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    dt: real,
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """Solves the springs of one colour for what the law adds in a step; ``limit_law`` has (r, ε_L, k_L).

    For schemes that take all forces but springs as they were at the start of a step, at which k_L would be unstable. A
    spring alone is solved exactly, as implicit Euler has it: h J = K (|d| − r (1 + ε_L))/(1 + K W) with K = h² k_L/r
    and W = 1/m_p + 1/m_q, stable at any step; positions and velocities change by h J/m and J/m along the spring.
    """
    s = wp.tid()
    p = spring_ends[s][0]
    q = spring_ends[s][1]
    w_p = particle_inv_mass[p]
    w_q = particle_inv_mass[q]
    d = particle_q_out[q] - particle_q_out[p]
    law = limit_law[s]
    beyond = wp.length(d) - law[0] * (real(1.0) + law[1])
    if beyond > real(0.0) and law[2] > real(0.0):
        elastic = dt * dt * law[2] / law[0]
        move = (elastic * beyond / (real(1.0) + elastic * (w_p + w_q))) * direction(d)
        particle_q_out[p] = particle_q_out[p] + w_p * move
        particle_q_out[q] = particle_q_out[q] - w_q * move
        particle_qd_out[p] = particle_qd_out[p] + (w_p / dt) * move
        particle_qd_out[q] = particle_qd_out[q] - (w_q / dt) * move
