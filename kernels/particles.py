"""Per-particle work: gravity, energies, the passing of time."""

import sys

import warp as wp

from .precision import OPTIONS, real, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.kernel
def set_gravity_force(
    # Model
    thread_offset: int,
    particle_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    world_gravity: wp.array(dtype=vec3),
    # Out
    particle_f_out: wp.array(dtype=vec3),
):
    """Starts a force evaluation: f = m g, overwriting what was there."""
    i = thread_offset + wp.tid()
    particle_f_out[i] = particle_mass[i] * world_gravity[particle_world[i]]


@wp.kernel
def invert_masses(
    # Model
    particle_mass: wp.array(dtype=real),
    # Out
    particle_inv_mass_out: wp.array(dtype=real),
):
    """1/m of free particles, after masses have changed; that of pinned ones stays 0."""
    i = wp.tid()
    if particle_inv_mass_out[i] > real(0.0):
        particle_inv_mass_out[i] = real(1.0) / particle_mass[i]


@wp.kernel
def add_force(
    # State in
    force: wp.array(dtype=vec3),
    # Out
    particle_f_out: wp.array(dtype=vec3),
):
    """Adds a given force [N] to every particle."""
    i = wp.tid()
    particle_f_out[i] = particle_f_out[i] + force[i]


@wp.kernel
def gravity_energy(
    # Model
    particle_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    world_gravity: wp.array(dtype=vec3),
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    energy_out: wp.array(dtype=wp.float64),
):
    """Adds −m g·x [J] to ``energy_out[world]``, summed in float64."""
    i = wp.tid()
    w = particle_world[i]
    e = -wp.float64(particle_mass[i]) * wp.float64(wp.dot(world_gravity[w], particle_q[i]))
    wp.atomic_add(energy_out, w, e)


@wp.kernel
def kinetic_energy(
    # Model
    particle_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    # State in
    particle_qd: wp.array(dtype=vec3),
    # Out
    energy_out: wp.array(dtype=wp.float64),
):
    """Adds ½ m v² [J] to ``energy_out[world]``, summed in float64."""
    i = wp.tid()
    v = particle_qd[i]
    e = wp.float64(0.5) * wp.float64(particle_mass[i]) * wp.float64(wp.dot(v, v))
    wp.atomic_add(energy_out, particle_world[i], e)


@wp.kernel
def advance_time(
    # State in
    dt: wp.float64,
    # Out
    world_time_out: wp.array(dtype=wp.float64),
):
    """The clock of every world moves on by dt [s]."""
    w = wp.tid()
    world_time_out[w] = world_time_out[w] + dt
