"""Particles that are led at given velocities."""

import sys

import warp as wp

from .precision import OPTIONS, real, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.kernel
def lead(
    # Model
    particle: wp.array(dtype=wp.int32),
    world: wp.array(dtype=wp.int32),
    handle: wp.array(dtype=wp.int32),
    # State in
    velocity: wp.array2d(dtype=vec3),
    dt: real,
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """Moves the held particles to where their handles are dt [s] later; ``velocity[world, handle]`` in [m/s]."""
    k = wp.tid()
    i = particle[k]
    v = velocity[world[k], handle[k]]
    particle_q_out[i] = particle_q_out[i] + dt * v
    particle_qd_out[i] = v
