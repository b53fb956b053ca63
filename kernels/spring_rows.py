"""Spring forces row by row, for the CPU: each particle with its springs to particles of higher number.

What a particle gets from its own row is summed in registers, and what a spring needs lies side by side. Ranges of rows
may run at the same time: a spring that leaves its range gives its other end nothing, but is a second time among what
that particle receives from before its range. Every particle adds up its springs in the order of their other ends,
however many ranges there are.
"""

import sys

import warp as wp

from .direct import int_at, put, vector_at
from .precision import FORWARD_ONLY, vec3
from .spring_law import spring_pull

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


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
    n = thread_offset + wp.tid()
    i = receiver[n]
    x = particle_q[i]
    v = particle_qd[i]
    total = particle_f_out[i]
    for e in range(receiver_start[n], receiver_start[n + 1]):
        j = int_at(entry_other, e)
        total = total - spring_pull(x - vector_at(particle_q, j), v - vector_at(particle_qd, j), vector_at(law, e))
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
        j = int_at(entry_other, e)
        beyond = j < 0
        if beyond:
            j = -1 - j
        f = spring_pull(vector_at(particle_q, j) - x, vector_at(particle_qd, j) - v, vector_at(law, e))
        total += f
        if not beyond:
            put(particle_f_out, j, vector_at(particle_f_out, j) - f)
    particle_f_out[i] = particle_f_out[i] + total
