"""Spring forces row by row, for the CPU: each particle with its springs to particles of higher number.

What a particle gets from its own row is summed in registers, and what a spring needs lies side by side. Ranges of rows
may run at the same time: a spring that leaves its range gives its other end nothing, but is a second time among what
that particle receives from before its range. Every particle adds up its springs in the order of their other ends,
however many ranges there are.
"""

import sys

import warp as wp

from .precision import FORWARD_ONLY, real, vec3
from .spring_law import spring_force

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.kernel
def arrange_law(
    # Model
    thread_offset: int,
    entry_spring: wp.array(dtype=wp.int32),
    spring_rest_length: wp.array(dtype=real),
    spring_stiffness: wp.array(dtype=real),
    spring_damping: wp.array(dtype=real),
    # Out
    law_out: wp.array(dtype=vec3),
):
    """(r [m], k_s [N], k_d [N s]) of the spring of each entry."""
    e = thread_offset + wp.tid()
    s = entry_spring[e]
    law_out[e] = vec3(spring_rest_length[s], spring_stiffness[s], spring_damping[s])


@wp.kernel
def receive(
    # Model
    thread_offset: int,
    receiver: wp.array(dtype=wp.int32),
    receiver_start: wp.array(dtype=wp.int32),
    entry_other: wp.array(dtype=wp.int32),
    law: wp.array(dtype=vec3),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    particle_f_out: wp.array(dtype=vec3),
):
    """Forces from springs that begin in ranges before."""
    k = thread_offset + wp.tid()
    i = receiver[k]
    x = particle_q[i]
    v = particle_qd[i]
    total = particle_f_out[i]
    for e in range(receiver_start[k], receiver_start[k + 1]):
        j = entry_other[e]
        total = total - spring_force(x - particle_q[j], v - particle_qd[j], law[e][0], law[e][1], law[e][2])
    particle_f_out[i] = total


@wp.kernel
def pull_rows(
    # Model
    thread_offset: int,
    row_start: wp.array(dtype=wp.int32),
    entry_other: wp.array(dtype=wp.int32),
    law: wp.array(dtype=vec3),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    particle_f_out: wp.array(dtype=vec3),
):
    """Forces of each particle's own row on both ends; −1 − j for an end j that lies beyond the range."""
    i = thread_offset + wp.tid()
    x = particle_q[i]
    v = particle_qd[i]
    total = vec3()
    for e in range(row_start[i], row_start[i + 1]):
        j = entry_other[e]
        beyond = j < 0
        if beyond:
            j = -1 - j
        f = spring_force(particle_q[j] - x, particle_qd[j] - v, law[e][0], law[e][1], law[e][2])
        total += f
        if not beyond:
            particle_f_out[j] = particle_f_out[j] - f
    particle_f_out[i] = particle_f_out[i] + total
