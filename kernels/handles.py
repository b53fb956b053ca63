"""Particles that are led at given velocities."""

import sys

import warp as wp

from .precision import OPTIONS, real, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.kernel
def take_hold(
    # Model
    particle: wp.array(dtype=wp.int32),
    world: wp.array(dtype=wp.int32),
    handle: wp.array(dtype=wp.int32),
    # State in
    handle_velocity: wp.array2d(dtype=vec3),
    particle_q: wp.array(dtype=vec3),
    # Out
    place_out: wp.array(dtype=wp.vec3d),
    velocity_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """Velocities of held particles [m/s], from ``handle_velocity[world, handle]``; their places [m] are those of the
    particles where somebody has moved these, or nobody has led them before."""
    k = wp.tid()
    i = particle[k]
    x = particle_q[i]
    place = place_out[k]
    if not (vec3(real(place[0]), real(place[1]), real(place[2])) == x):  # noqa: SIM201 - C++ has no != for vectors here
        place_out[k] = wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2]))
    v = handle_velocity[world[k], handle[k]]
    velocity_out[k] = v
    particle_qd_out[i] = v


@wp.kernel
def go_on(
    # State in
    velocity: wp.array(dtype=vec3),
    dt: wp.float64,
    # Out
    place_out: wp.array(dtype=wp.vec3d),
):
    """Places dt [s] later."""
    k = wp.tid()
    v = velocity[k]
    place_out[k] = place_out[k] + dt * wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))
