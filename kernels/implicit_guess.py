"""Where Newton's method begins: it is taken that velocities change as they did in the step before.

For smooth motion that is one order better than the velocities themselves. What contact takes from cloth after each
step, the next solution brings back as long as layers are pressed together: single particles of a cloth on the ears of a
bunny went 3 m/s forth in each solution and back in contact. A guess that knows of it saves a third of the iterations
there, and more than half with BDF2 where two cloths lie on each other.
"""

import sys

import warp as wp

from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.kernel
def lead(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    # State in
    takes_part: wp.array(dtype=wp.int32),
    # Out
    change_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """From the velocities at the start of a step to the guess; ``change_out`` keeps what :func:`learn` needs."""
    i = thread_offset + wp.tid()
    if takes_part[particle_world[i]] == 1 and particle_inv_mass[i] > real(0.0):
        v = particle_qd_out[i]
        particle_qd_out[i] = v + change_out[i]
        change_out[i] = -v


@wp.kernel
def learn(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    # State in
    takes_part: wp.array(dtype=wp.int32),
    particle_qd: wp.array(dtype=vec3),
    # Out
    change_out: wp.array(dtype=vec3),
):
    """By how much velocities have changed from the start of the step to the solution [m/s]."""
    i = thread_offset + wp.tid()
    if takes_part[particle_world[i]] == 1 and particle_inv_mass[i] > real(0.0):
        change_out[i] = change_out[i] + particle_qd[i]
