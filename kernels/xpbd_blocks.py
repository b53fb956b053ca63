"""The springs of XPBD block by block, for the CPU: a thread solves all springs of some hundred particles in order.

So a block stays in the cache, and threads meet after each phase, not after each colour.
"""

import sys

import warp as wp

from .direct import pair_at, put, real_at, vector_at
from .precision import FORWARD_ONLY, real, vec3
from .xpbd import spring_impulse

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.kernel
def solve_blocks(
    # Model
    thread_offset: int,
    block_start: wp.array(dtype=wp.int32),
    spring_ends: wp.array(dtype=wp.vec2i),
    spring_law: wp.array(dtype=vec3),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    dt: real,
    kept: real,
    backwards: int,
    # Out
    displacement_out: wp.array(dtype=vec3),
    spring_force_out: wp.array(dtype=vec3),
):
    """Solves the springs ``block_start[b]`` to ``block_start[b + 1]`` of blocks that share no particle.

    If ``backwards`` is 1, the last spring is the first.
    """
    b = thread_offset + wp.tid()
    share = kept * dt * dt
    rate = real(1.0) / (dt * dt)
    first = block_start[b]
    count = block_start[b + 1] - first
    for k in range(count):
        s = first + k
        if backwards == 1:
            s = first + count - 1 - k
        ends = pair_at(spring_ends, s)
        p = ends[0]
        q = ends[1]
        w_p = real_at(particle_inv_mass, p)
        w_q = real_at(particle_inv_mass, q)
        moved_p = vector_at(displacement_out, p)
        moved_q = vector_at(displacement_out, q)
        old = vec3()
        if kept > real(0.0):
            old = share * vector_at(spring_force_out, s)
        moved = moved_q - moved_p + (w_p + w_q) * old
        d = vector_at(particle_q, q) - vector_at(particle_q, p) + moved
        impulse = spring_impulse(d, moved, vector_at(spring_law, s), w_p + w_q, dt)
        put(displacement_out, p, moved_p + w_p * (impulse - old))
        put(displacement_out, q, moved_q - w_q * (impulse - old))
        put(spring_force_out, s, rate * impulse)
