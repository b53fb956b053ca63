"""Springs in a row solved as one, at the end of a step of XPBD.

A sweep over springs (``kernels/xpbd.py``) leaves strain along threads, mostly of every other spring, and that is what
limits how few steps will do. But the threads of a grid are rows of springs, each of which begins where the one before
ends, and all springs of a row can be solved together: line relaxation, as multigrid methods call it; of rods Deul et
al. did so (Direct Position-Based Solver for Stiff Rods, 2018).

As for one spring, implicit Euler asks of each spring j of a row, between the particles j and j + 1, the impulse J
(times h) along n = d/|d| with

    n·J = E (|d'| − r) + V n·u',      E = h² k_s/r,   V = h k_d/r,

d = x_{j+1} − x_j as it is now and u what of it the step has brought, d' and u' the same once impulses have grown by
K n. That changes d by −(w_j + w_{j+1}) K n + w_j K_{j−1} n_{j−1} + w_{j+1} K_{j+1} n_{j+1}, w = 1/m. Lengths taken as
linear in d, this is a system of equations with three diagonals,

    (1 + G (w_j + w_{j+1})) K − G w_j a_j K_{j−1} − G w_{j+1} a_{j+1} K_{j+1} = E (|d| − r) + V n·u − n·J,

G = E + V and a_j = n_{j−1}·n_j, that elimination solves from one end to the other and back; the diagonal dominates,
whatever the row looks like. Where sweeps have found the solution of the step the right-hand side is 0, and nothing
changes. Rows of one launch share no particle.

Rows come last, after spans (``kernels/spans.py``) and sweeps over all springs. Instead of these they lead astray where
springs turn far within a step: of a fine cloth that swings, at the hinge. A sheet of 64² vertices that hung by an edge
then had 12 % of mean strain at worst with 4 steps in 1/60 s and a sweep in each, not 0.7.
"""

import sys

import warp as wp

from .direct import int_at, put, real_at, vector_at
from .precision import FORWARD_ONLY, real, vec3
from .spans import force_at
from .spring_law import direction

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.struct
class RowMemory:
    """What solving rows needs, for each of their springs: direction, upper diagonal of the spring before, impulse."""

    direction: wp.array(dtype=vec3)
    upper: wp.array(dtype=real)
    impulse: wp.array(dtype=real)


@wp.kernel
def solve_rows(
    # Model
    thread_offset: int,
    first: int,
    row_start: wp.array(dtype=wp.int32),
    row_particle: wp.array(dtype=wp.int32),
    row_slot: wp.array(dtype=wp.int32),
    stride: int,
    row_law: wp.array(dtype=vec3),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    dt: real,
    keeps: int,
    # Out
    memory_out: RowMemory,
    displacement_out: wp.array(dtype=vec3),
    spring_force_out: wp.array(dtype=real),
):
    """Solves the rows from ``first`` on. Springs of row r are ``row_start[r]`` to ``row_start[r + 1]``, its particles r
    places further on in ``row_particle``, as it has one more.

    ``row_law`` holds (r [m], k_s/r [N/m], k_d/r [N s/m]) of each spring; its force [N] begins at ``row_slot``, its
    components ``stride`` apart, and is brought up to date if ``keeps`` is 1.
    """
    r = first + thread_offset + wp.tid()
    begin = int_at(row_start, r)
    end = int_at(row_start, r + 1)
    p = int_at(row_particle, begin + r)
    x, moved, w = vector_at(particle_q, p), vector_at(displacement_out, p), real_at(particle_inv_mass, p)
    former, coupling, more = vec3(), real(0.0), real(0.0)
    for j in range(begin, end):
        q = int_at(row_particle, j + r + 1)
        x_q, moved_q, w_q = vector_at(particle_q, q), vector_at(displacement_out, q), real_at(particle_inv_mass, q)
        law = vector_at(row_law, j)
        elastic = dt * dt * law[1]
        viscous = dt * law[2]
        d = x_q - x + moved_q - moved
        n = direction(d)
        drawn = (dt * dt) * force_at(spring_force_out, int_at(row_slot, j), stride)
        lacks = elastic * (wp.length(d) - law[0]) + wp.dot(n, viscous * (moved_q - moved) - drawn)
        turn = wp.dot(former, n)
        upper = -coupling * turn
        lower = -(elastic + viscous) * w * turn
        inverse = real(1.0) / (real(1.0) + (elastic + viscous) * (w + w_q) - lower * upper)
        more = (lacks - lower * more) * inverse
        put(memory_out.direction, j, n)
        memory_out.upper[j] = upper
        memory_out.impulse[j] = more
        coupling = (elastic + viscous) * w_q * inverse
        x, moved, w, former = x_q, moved_q, w_q, n
    change = vec3()
    for k in range(begin, end):
        j = begin + end - 1 - k
        if k > begin:
            more = real_at(memory_out.impulse, j) - real_at(memory_out.upper, j + 1) * more
        own = more * vector_at(memory_out.direction, j)
        q = int_at(row_particle, j + r + 1)
        put(displacement_out, q, vector_at(displacement_out, q) + real_at(particle_inv_mass, q) * (change - own))
        if keeps == 1:
            slot = int_at(row_slot, j)
            for axis in range(3):
                spring_force_out[slot + axis * stride] += own[axis] / (dt * dt)
        change = own
    p = int_at(row_particle, begin + r)
    put(displacement_out, p, vector_at(displacement_out, p) + real_at(particle_inv_mass, p) * change)
