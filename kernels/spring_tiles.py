"""Spring forces of eight springs at once, for the CPU, where many springs lead to particles numbered alike.

On a grid, springs of one kind lead from particles i, i + 1, i + 2 … to i + o, i + 1 + o, i + 2 + o …: what they read
and write lies side by side. A *tile* is eight particles in a row; an *entry* of it, the springs that lead from them o
numbers further (a lane without a spring has the rest length 0); a *block*, particles whose forces one thread sums in
memory of its own. Springs from before a block are evaluated for it once more, so blocks need not wait for each other.

Each particle adds up what comes from those before it in the order of their numbers, and then its own springs, from the
furthest on; so its force does not depend on where blocks and tiles begin, or on what else is simulated.
"""

import sys

import warp as wp

from .lanes import LANES, for_cpu
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

ROWS = 9  # of a thread's memory: positions, velocities, forces


@wp.struct
class Tiles:
    """Blocks: first and last tile (the latter not included), first and last particle of what they read, and of what
    is their own; tiles: their first particle and first entry; entries: how much further springs lead."""

    block: wp.array2d(dtype=wp.int32)
    particle: wp.array(dtype=wp.int32)
    start: wp.array(dtype=wp.int32)
    offset: wp.array(dtype=wp.int32)


# The law of kernels/spring_law.py (spring_pull), written for vectors.
_PULL = for_cpu(f"""
    const int* block = tiles.block.data + 6 * b;
    const int lo = block[2], n = block[3] - lo, room = n + {LANES} + (-n & {LANES - 1});
    R* row[{ROWS}];
    for (int k = 0; k < {ROWS}; ++k) row[k] = memory_out.data + k * room;
    R *x = row[0], *y = row[1], *z = row[2], *vx = row[3], *vy = row[4], *vz = row[5];
    R *fx = row[6], *fy = row[7], *fz = row[8];
    unpack((const R*)(particle_q.data + lo), n, x, y, z);
    unpack((const R*)(particle_qd.data + lo), n, vx, vy, vz);
    for (R* f = fx; f < fx + 3 * room; f += {LANES}) store(f, 0);
    const int own = block[4] - lo, count = block[5] - block[4];
    unpack((const R*)(particle_f_out.data + block[4]), count, fx + own, fy + own, fz + own);
    for (int t = block[0]; t < block[1]; ++t) {{
        const int i = tiles.particle.data[t] - lo;
        const V px = load(x + i), py = load(y + i), pz = load(z + i);
        const V pvx = load(vx + i), pvy = load(vy + i), pvz = load(vz + i);
        V sx = 0, sy = 0, sz = 0;
        for (int e = tiles.start.data[t]; e < tiles.start.data[t + 1]; ++e) {{
            const int j = i + tiles.offset.data[e];
            const R* of_law = law.data + {3 * LANES} * (long long)e;
            const V rest = load(of_law), k_s = load(of_law + {LANES}), k_d = load(of_law + {2 * LANES});
            const V dx = load(x + j) - px, dy = load(y + j) - py, dz = load(z + j) - pz;
            const V ux = load(vx + j) - pvx, uy = load(vy + j) - pvy, uz = load(vz + j) - pvz;
            const V length = root(dx * dx + dy * dy + dz * dz);
            const Mask pulls = (length != 0) & (rest > 0);  // what is not a number stays visible
            const V inverse = 1 / length;
            const V rate = (ux * dx + uy * dy + uz * dz) * inverse;
            const V pull = only((k_s * (length - rest) + k_d * rate) * inverse, pulls);
            const V gx = only(pull * dx, pulls), gy = only(pull * dy, pulls), gz = only(pull * dz, pulls);
            sx += gx; sy += gy; sz += gz;
            store(fx + j, load(fx + j) - gx);
            store(fy + j, load(fy + j) - gy);
            store(fz + j, load(fz + j) - gz);
        }}
        store(fx + i, load(fx + i) + sx);
        store(fy + i, load(fy + i) + sy);
        store(fz + i, load(fz + i) + sz);
    }}
    pack((R*)(particle_f_out.data + block[4]), count, fx + own, fy + own, fz + own);
""")


@wp.func_native(_PULL)
def _pull(
    tiles: Tiles,
    b: int,
    law: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    memory_out: wp.array(dtype=real),
    particle_f_out: wp.array(dtype=vec3),
): ...


@wp.kernel
def pull_blocks(
    # Model
    thread_offset: int,
    tiles: Tiles,
    slot_start: wp.array(dtype=wp.int32),
    law: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    memory_out: wp.array2d(dtype=real),
    particle_f_out: wp.array(dtype=vec3),
):
    """Adds spring forces to the particles of blocks ``slot_start[s]`` to ``slot_start[s + 1]``, with the memory s."""
    slot = thread_offset + wp.tid()
    for b in range(slot_start[slot], slot_start[slot + 1]):
        _pull(tiles, b, law, particle_q, particle_qd, memory_out[slot], particle_f_out)
