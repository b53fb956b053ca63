"""The springs of XPBD eight at once, for the CPU: sweeps over blocks of grids, whose particles are numbered in rows.

As in ``kernels/spring_tiles.py`` an *entry* is up to eight springs that lead from particles in a row to others as much
further; lanes without a spring have the rest length 0. No two springs of an entry share a particle, so solving them at
once is solving them one after the other. A *block* is what one thread solves, entry by entry, in memory of its own;
blocks that run at the same time reach no common particle.
"""

import sys

import warp as wp

from .lanes import LANES, LAW, for_cpu
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

ROWS = 7  # of a thread's memory: positions, displacements, inverse masses

# spring_impulse of kernels/xpbd.py, written for vectors.
_SOLVE = for_cpu(f"""
    const int* of_block = block.data + 4 * b;
    const int lo = of_block[2], n = of_block[3] - lo, room = n + {LANES} + (-n & {LANES - 1});
    R *x = memory_out.data, *y = x + room, *z = y + room, *mx = z + room, *my = mx + room, *mz = my + room;
    R* w = mz + room;
    unpack((const R*)(particle_q.data + lo), n, x, y, z);
    unpack((const R*)(displacement_out.data + lo), n, mx, my, mz);
    for (int k = 0; k < n; ++k) w[k] = particle_inv_mass.data[lo + k];
    const R elasticity = dt * dt, viscosity = dt, share = kept * dt * dt, rate = R(1) / (dt * dt);
    for (int k = of_block[0]; k < of_block[1]; ++k) {{
        const int e = backwards ? of_block[0] + of_block[1] - 1 - k : k;
        const int i = entry.data[e][0] - lo, j = i + entry.data[e][1];
        {LAW}
        R* force = spring_force_out.data + {3 * LANES} * (long long)e;
        const V elastic = elasticity * k_s, viscous = viscosity * k_d;
        const V w_p = load(w + i), w_q = load(w + j), both = w_p + w_q;
        auto before = [&](int row) {{ return kept > 0 ? share * load(force + {LANES} * row) : (V)0; }};
        const V ox = before(0), oy = before(1), oz = before(2);
        const V px = load(mx + i), py = load(my + i), pz = load(mz + i);
        const V sx = load(mx + j) - px + both * ox, sy = load(my + j) - py + both * oy;
        const V sz = load(mz + j) - pz + both * oz;
        const V dx = load(x + j) - load(x + i) + sx, dy = load(y + j) - load(y + i) + sy;
        const V dz = load(z + j) - load(z + i) + sz;
        const V length = root(dx * dx + dy * dy + dz * dz);
        const Mask there = rest > 0, pulls = there & (length != 0);  // what is not a number stays visible
        const V inverse = 1 / length;
        const V moved = (dx * sx + dy * sy + dz * sz) * inverse;
        const V pull = (elastic * (length - rest) + viscous * moved) * inverse / (1 + (elastic + viscous) * both);
        const V gx = only(pull * dx, pulls), gy = only(pull * dy, pulls), gz = only(pull * dz, pulls);
        const V cx = only(gx - ox, there), cy = only(gy - oy, there), cz = only(gz - oz, there);
        store(mx + i, px + only(w_p * cx, there));
        store(my + i, py + only(w_p * cy, there));
        store(mz + i, pz + only(w_p * cz, there));
        store(mx + j, load(mx + j) - only(w_q * cx, there));
        store(my + j, load(my + j) - only(w_q * cy, there));
        store(mz + j, load(mz + j) - only(w_q * cz, there));
        store(force, rate * gx);
        store(force + {LANES}, rate * gy);
        store(force + {2 * LANES}, rate * gz);
    }}
    pack((R*)(displacement_out.data + lo), n, mx, my, mz);
""")


@wp.func_native(_SOLVE)
def _solve(
    b: int,
    block: wp.array2d(dtype=wp.int32),
    entry: wp.array(dtype=wp.vec2i),
    law: wp.array(dtype=real),
    shared_law: wp.array(dtype=vec3),
    shared_by: wp.array(dtype=wp.int32),
    particle_inv_mass: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    dt: real,
    kept: real,
    backwards: int,
    memory_out: wp.array(dtype=real),
    displacement_out: wp.array(dtype=vec3),
    spring_force_out: wp.array(dtype=real),
): ...


@wp.kernel
def solve_tiles(
    # Model
    thread_offset: int,
    slot_start: wp.array(dtype=wp.int32),
    block: wp.array2d(dtype=wp.int32),
    entry: wp.array(dtype=wp.vec2i),
    law: wp.array(dtype=real),
    shared_law: wp.array(dtype=vec3),
    shared_by: wp.array(dtype=wp.int32),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    dt: real,
    kept: real,
    backwards: int,
    # Out
    memory_out: wp.array2d(dtype=real),
    displacement_out: wp.array(dtype=vec3),
    spring_force_out: wp.array(dtype=real),
):
    """Solves the springs of blocks ``slot_start[s]`` to ``slot_start[s + 1]``, with the memory s.

    A block has its first and last entry (the latter not included), and the first and last particle that it reaches; an
    entry its first particle and how much further its springs lead. Laws are as ``arrange_lanes`` has them; of forces
    [N] there are eight of each component in turn. If ``backwards`` is 1, the last entry is the first.
    """
    slot = thread_offset + wp.tid()
    for b in range(slot_start[slot], slot_start[slot + 1]):
        _solve(
            b, block, entry, law, shared_law, shared_by, particle_inv_mass, particle_q, dt, kept, backwards,
            memory_out[slot], displacement_out, spring_force_out,
        )  # fmt: skip
