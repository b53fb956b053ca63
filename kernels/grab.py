"""Grabs: damped springs between a point of the cloth and a target that is led by the host.

A grab holds the point p = Σ wᵢ xᵢ of up to three particles, its weights summing to one, with the force

    f = k (p* − p) + d (v* − v)

shared out as wᵢ f. Its energy is ½ k |p* − p|². The target p* moves evenly, at v*, over the frame in hand.
"""

import sys

import warp as wp

from .precision import FORWARD_ONLY, mat33, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.struct
class Grabs:
    """Slots; a free one has stiffness and damping 0.

    k [N/m] and d [N s/m]; targets [m] at both ends of the frame in hand, which has ``begun`` [s] by the clock of the
    world of each, and is as long as ``span`` [s].
    """

    particles: wp.array(dtype=wp.vec3i)
    weights: wp.array(dtype=vec3)
    stiffness: wp.array(dtype=real)
    damping: wp.array(dtype=real)
    target_from: wp.array(dtype=wp.vec3d)
    target_to: wp.array(dtype=wp.vec3d)
    begun: wp.array(dtype=wp.float64)
    span: wp.array(dtype=wp.float64)


@wp.func
def held_point(grabs: Grabs, g: int, values: wp.array(dtype=vec3)):
    """Σ wᵢ of positions or velocities."""
    total = vec3()
    for c in range(3):
        total += grabs.weights[g][c] * values[grabs.particles[g][c]]
    return total


@wp.func
def target_at(grabs: Grabs, g: int, t: wp.float64):
    """p* at time t [s]; it waits at both ends of the frame."""
    share = wp.clamp((t - grabs.begun[g]) / grabs.span[0], wp.float64(0.0), wp.float64(1.0))
    x = grabs.target_from[g] + share * (grabs.target_to[g] - grabs.target_from[g])
    return vec3(real(x[0]), real(x[1]), real(x[2]))


@wp.func
def target_velocity(grabs: Grabs, g: int):
    """v* [m/s]."""
    v = (grabs.target_to[g] - grabs.target_from[g]) / grabs.span[0]
    return vec3(real(v[0]), real(v[1]), real(v[2]))


@wp.kernel
def forces(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    grabs: Grabs,
    # State in
    world_time: wp.array(dtype=wp.float64),
    time_offset: wp.float64,
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    particle_f_out: wp.array(dtype=vec3),
):
    """Adds wᵢ f [N], one thread per slot."""
    g = wp.tid()
    if grabs.stiffness[g] == real(0.0):
        return
    t = world_time[particle_world[grabs.particles[g][0]]] + time_offset
    away = target_at(grabs, g, t) - held_point(grabs, g, particle_q)
    slip = target_velocity(grabs, g) - held_point(grabs, g, particle_qd)
    f = grabs.stiffness[g] * away + grabs.damping[g] * slip
    for c in range(3):
        wp.atomic_add(particle_f_out, grabs.particles[g][c], grabs.weights[g][c] * f)


@wp.kernel
def products(
    # Model
    grabs: Grabs,
    # State in
    x: wp.array(dtype=vec3),
    a: real,
    b: real,
    # Out
    product_out: wp.array(dtype=vec3),
):
    """Adds (a K + b C) x, which is wᵢ (a k + b d) Σ wⱼ xⱼ."""
    g = wp.tid()
    total = (a * grabs.stiffness[g] + b * grabs.damping[g]) * held_point(grabs, g, x)
    for c in range(3):
        wp.atomic_add(product_out, grabs.particles[g][c], grabs.weights[g][c] * total)


@wp.kernel
def diagonal(
    # Model
    grabs: Grabs,
    # State in
    a: real,
    b: real,
    # Out
    blocks_out: wp.array(dtype=mat33),
):
    """Adds wᵢ² (a k + b d) to the blocks on the diagonal."""
    g = wp.tid()
    strength = a * grabs.stiffness[g] + b * grabs.damping[g]
    for c in range(3):
        w = grabs.weights[g][c]
        wp.atomic_add(blocks_out, grabs.particles[g][c], w * w * strength * wp.identity(n=3, dtype=real))


@wp.kernel
def energy(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    grabs: Grabs,
    # State in
    world_time: wp.array(dtype=wp.float64),
    particle_q: wp.array(dtype=vec3),
    # Out
    energy_out: wp.array(dtype=wp.float64),
):
    """Adds ½ k |p* − p|² [J] to ``energy_out[world]``."""
    g = wp.tid()
    w = particle_world[grabs.particles[g][0]]
    away = target_at(grabs, g, world_time[w]) - held_point(grabs, g, particle_q)
    wp.atomic_add(energy_out, w, wp.float64(real(0.5) * grabs.stiffness[g] * wp.dot(away, away)))
