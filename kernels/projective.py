"""Projective dynamics: local targets for springs, one constant matrix for all particles.

A step h of implicit Euler is m (δ − δ̂)/h² = f of every particle. Liu et al. (2013) write a spring's force as κ (d − p),
p the point of the sphere |p| = r nearest to d (local step), and solve for δ with all p held (global step): the matrix
M/h² + Σ κ GᵀG is constant. Damping is made part of it: with κ = k_s/r + k_d/(r h) and, for d₀ at the start of the step,
p = n (k_s + k_d n·d₀/(r h))/κ, the force κ (d − p) is the full damped law at the end of the step, and so the iteration
ends at Newton's solution. A global step from the current δ changes it by Δ with

    (M/h² + Σ κ GᵀG) Δ = f − m (δ − δ̂)/h²,

f the law's own force: the targets never need to be formed. That is solved by conjugate gradients, or in a single Jacobi
iteration, whose repetition Chebyshev's weights speed up (Wang 2015). The spectral radius that these need is bounded by
the largest ratio of Σκ to m/h² + Σκ (Gershgorin), exact for a free sheet of equal particles.

Rows of springs are those of ``kernels/vbd.py``.
"""

import sys

import warp as wp

from .precision import FORWARD_ONLY, mat33, real, vec3
from .spring_law import spring_force

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.func
def weight_of(law: vec3, dt: real):
    """κ [N/m] of a spring (r, k_s, k_d)."""
    return (law[1] + law[2] / dt) / law[0]


@wp.func
def chebyshev_weight(radius: real, k: int):
    """ω₂ = 2/(2 − ρ²), ω₍ₖ₊₁₎ = 4/(4 − ρ² ωₖ): for k > 1 that is ωₖ = 2 cosh((k−1) η)/(ρ cosh(k η)), cosh η = 1/ρ."""
    if radius == real(0.0):
        return real(1.0)
    root = wp.sqrt(wp.max(real(1.0) - radius * radius, real(0.0)))
    q = radius / (real(1.0) + root)  # e^−η
    a = wp.pow(q, real(2 * k - 2))
    return real(2.0) / radius * q * (real(1.0) + a) / (real(1.0) + a * q * q)


@wp.kernel
def spectral_radius(
    # Model
    particle_mass: wp.array(dtype=real),
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    row_start: wp.array(dtype=wp.int32),
    row_law: wp.array(dtype=vec3),
    # State in
    dt: real,
    # Out
    world_radius_out: wp.array(dtype=real),
):
    """Largest ratio of Σκ to m/h² + Σκ in each world; ``world_radius_out`` must be 0 before."""
    i = wp.tid()
    if particle_inv_mass[i] > real(0.0):
        total = real(0.0)
        for row in range(row_start[i], row_start[i + 1]):
            total += weight_of(row_law[row], dt)
        wp.atomic_max(world_radius_out, particle_world[i], total / (particle_mass[i] / (dt * dt) + total))


@wp.kernel
def jacobi(
    # Model
    particle_mass: wp.array(dtype=real),
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    row_start: wp.array(dtype=wp.int32),
    row_other: wp.array(dtype=wp.int32),
    row_law: wp.array(dtype=vec3),
    # State in
    particle_q: wp.array(dtype=vec3),
    inertial: wp.array(dtype=vec3),
    displacement: wp.array(dtype=vec3),
    world_radius: wp.array(dtype=real),
    accelerated: int,
    largest_radius: real,
    dt: real,
    # Out
    next_out: wp.array(dtype=vec3),
):
    """Local step and one Jacobi iteration of the global one; the ``accelerated``-th of those that Chebyshev speeds up.

    ``next_out`` holds the iterate before ``displacement``, from which it extrapolates.
    """
    i = wp.tid()
    moved = displacement[i]
    if particle_inv_mass[i] == real(0.0):
        next_out[i] = moved
        return
    x = particle_q[i]
    inertia = particle_mass[i] / (dt * dt)
    f = inertia * (inertial[i] - moved)
    total = inertia
    for row in range(row_start[i], row_start[i + 1]):
        j = row_other[row]
        law = row_law[row]
        u = displacement[j] - moved
        f += spring_force(particle_q[j] - x + u, u / dt, law[0], law[1], law[2])
        total += weight_of(law, dt)
    plain = moved + f / total
    if accelerated > 1:
        weight = chebyshev_weight(wp.min(world_radius[particle_world[i]], largest_radius), accelerated)
        plain = weight * (plain - next_out[i]) + next_out[i]
    next_out[i] = plain


@wp.kernel
def residual(
    # Model
    particle_mass: wp.array(dtype=real),
    particle_inv_mass: wp.array(dtype=real),
    row_start: wp.array(dtype=wp.int32),
    row_other: wp.array(dtype=wp.int32),
    row_law: wp.array(dtype=vec3),
    # State in
    particle_q: wp.array(dtype=vec3),
    inertial: wp.array(dtype=vec3),
    displacement: wp.array(dtype=vec3),
    dt: real,
    # Out
    residual_out: wp.array(dtype=vec3),
):
    """m (δ − δ̂) − h² f of free particles [kg m], 0 for pinned ones."""
    i = wp.tid()
    total = vec3()
    if particle_inv_mass[i] > real(0.0):
        x = particle_q[i]
        moved = displacement[i]
        total = particle_mass[i] * (moved - inertial[i])
        for row in range(row_start[i], row_start[i + 1]):
            j = row_other[row]
            law = row_law[row]
            u = displacement[j] - moved
            total -= dt * dt * spring_force(particle_q[j] - x + u, u / dt, law[0], law[1], law[2])
    residual_out[i] = total


@wp.kernel
def matrix_product(
    # Model
    row_start: wp.array(dtype=wp.int32),
    row_other: wp.array(dtype=wp.int32),
    row_law: wp.array(dtype=vec3),
    # State in
    dt: real,
    x: wp.array(dtype=vec3),
    # Out
    product_out: wp.array(dtype=vec3),
):
    """Adds h² Σ κ GᵀG x."""
    i = wp.tid()
    total = vec3()
    for row in range(row_start[i], row_start[i + 1]):
        total += weight_of(row_law[row], dt) * (x[i] - x[row_other[row]])
    product_out[i] = product_out[i] + dt * dt * total


@wp.kernel
def matrix_diagonal(
    # Model
    row_start: wp.array(dtype=wp.int32),
    row_law: wp.array(dtype=vec3),
    # State in
    dt: real,
    # Out
    blocks_out: wp.array(dtype=mat33),
):
    """Adds h² Σ κ to the diagonal."""
    i = wp.tid()
    total = real(0.0)
    for row in range(row_start[i], row_start[i + 1]):
        total += weight_of(row_law[row], dt)
    blocks_out[i] = blocks_out[i] + (dt * dt * total) * wp.identity(n=3, dtype=real)


@wp.kernel
def correct(
    # State in
    correction: wp.array(dtype=vec3),
    # Out
    displacement_out: wp.array(dtype=vec3),
):
    """δ ← δ + Δ."""
    i = wp.tid()
    displacement_out[i] = displacement_out[i] + correction[i]
