"""Forces of eight springs at once, and products with their matrices, for the CPU and networks numbered like grids.

On a grid, springs of one kind lead from particles i, i + 1, i + 2 … to i + o, i + 1 + o, i + 2 + o …: what they read
and write lies side by side. A *tile* is eight particles in a row; an *entry* of it, the springs that lead from them o
numbers further (a lane without a spring has the rest length 0); a *block*, particles whose forces one thread sums in
memory of its own. Springs from before a block are evaluated for it once more, so blocks need not wait for each other.

Each particle adds up what comes from those before it in the order of their numbers, and then its own springs, from the
furthest on; so what it gets does not depend on where blocks and tiles begin, or on what else is simulated.
"""

import sys

import warp as wp

from .lanes import LANES, LAW, for_cpu
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

ROWS = 12  # of a thread's memory: three vectors of what is read, and one of what is written


@wp.struct
class Tiles:
    """Blocks: first and last tile (the latter not included), first and last particle of what they read, and of what
    is their own; tiles: their first particle and first entry; entries: how much further springs lead."""

    block: wp.array2d(dtype=wp.int32)
    particle: wp.array(dtype=wp.int32)
    start: wp.array(dtype=wp.int32)
    offset: wp.array(dtype=wp.int32)


def _sum_over_springs(vectors: tuple[str, ...], out: str, law: str, begin: str = "", end: str = "") -> str:
    """C++ that adds to the array ``out``, for the particles of block b, what each spring does to its ends.

    ``law`` works out g0, g1, g2, what a spring does to the particle that it leads from, and the opposite of what it
    does to the other; from the differences d0, d1, … of the components of all ``vectors`` between the two, and the
    spring's ``rest``, ``k_s``, ``k_d``. ``begin`` is an if: where it writes what sums begin with, instead of adding to
    what is in ``out``. ``end`` is done with the sums.
    """
    rows = range(3 * len(vectors))
    unpacked = "".join(
        f"unpack((const R*)({name}.data + lo), n, r{3 * k}, r{3 * k + 1}, r{3 * k + 2});\n"
        for k, name in enumerate(vectors)
    )
    return for_cpu(f"""
    const int* block = tiles.block.data + 6 * b;
    const int lo = block[2], n = block[3] - lo, room = n + {LANES} + (-n & {LANES - 1});
    {"".join(f"R* r{k} = memory_out.data + {k} * room;" for k in rows)}
    R *fx = memory_out.data + {len(rows)} * room, *fy = fx + room, *fz = fy + room;
    {unpacked}
    for (R* f = fx; f < fx + 3 * room; f += {LANES}) store(f, 0);
    const int own = block[4] - lo, count = block[5] - block[4];
    {begin} unpack((const R*)({out}.data + block[4]), count, fx + own, fy + own, fz + own);
    for (int t = block[0]; t < block[1]; ++t) {{
        const int i = tiles.particle.data[t] - lo;
        {"".join(f"const V p{k} = load(r{k} + i);" for k in rows)}
        V sx = 0, sy = 0, sz = 0;
        for (int e = tiles.start.data[t]; e < tiles.start.data[t + 1]; ++e) {{
            const int j = i + tiles.offset.data[e];
            {LAW}
            {"".join(f"const V d{k} = load(r{k} + j) - p{k};" for k in rows)}
            const V length = root(d0 * d0 + d1 * d1 + d2 * d2), inverse = 1 / length;
            const Mask acts = (length != 0) & (rest > 0);  // what is not a number stays visible
            {law}
            const V gx = only(g0, acts), gy = only(g1, acts), gz = only(g2, acts);
            sx += gx; sy += gy; sz += gz;
            store(fx + j, load(fx + j) - gx);
            store(fy + j, load(fy + j) - gy);
            store(fz + j, load(fz + j) - gz);
        }}
        store(fx + i, load(fx + i) + sx);
        store(fy + i, load(fy + i) + sy);
        store(fz + i, load(fz + i) + sz);
    }}
    pack((R*)({out}.data + block[4]), count, fx + own, fy + own, fz + own);
    {end}
    """)


# set_gravity_force of kernels/particles.py for a block, which is of one world; no world's gravity given: none.
_GRAVITY = """
    if (world_gravity.shape[0] > 0) {
        const auto& g = world_gravity.data[particle_world.data[block[4]]];
        for (int k = 0; k < count; ++k) {
            const R m = particle_mass.data[block[4] + k];
            fx[own + k] = m * g[0];
            fy[own + k] = m * g[1];
            fz[own + k] = m * g[2];
        }
    } else"""

# spring_pull of kernels/spring_law.py, written for vectors.
_PULL = """
            const V rate = (d0 * d3 + d1 * d4 + d2 * d5) * inverse;
            const V pull = (k_s * (length - rest) + k_d * rate) * inverse;
            const V g0 = pull * d0, g1 = pull * d1, g2 = pull * d2;
"""

# advance of kernels/explicit_step.py with the sums as the only forces. What is read of other blocks stays as it was.
_ADVANCE = f"""
    R *const x_rows[3] = {{r0 + own, r1 + own, r2 + own}}, *const v_rows[3] = {{r3 + own, r4 + own, r5 + own}};
    const R *const f_rows[3] = {{fx + own, fy + own, fz + own}};
    for (int k = 0; k < count; k += {LANES}) {{
        const V inv_mass = some(particle_inv_mass.data + block[4] + k, count - k);
        for (int axis = 0; axis < 3; ++axis) {{
            const V x = load(x_rows[axis] + k), v = load(v_rows[axis] + k), f = load(f_rows[axis] + k);
            store(x_rows[axis] + k, inv_mass > 0 ? x + (drift * v + inv_mass * (position_weight * f)) : x);
            store(v_rows[axis] + k, inv_mass > 0 ? v + inv_mass * (velocity_weight * f) : v);
        }}
    }}
    pack((R*)(particle_q_out.data + block[4]), count, x_rows[0], x_rows[1], x_rows[2]);
    pack((R*)(particle_qd_out.data + block[4]), count, v_rows[0], v_rows[1], v_rows[2]);
"""

# spring_matrix of kernels/spring_hessian.py times a vector, whose difference is d6, d7, d8.
_PRODUCT = """
            const V n0 = d0 * inverse, n1 = d1 * inverse, n2 = d2 * inverse;
            const V rate = d3 * n0 + d4 * n1 + d5 * n2;
            V transverse = (k_s * (length - rest) + k_d * rate) * inverse;
            transverse = transverse < 0 ? (1 - project) * transverse : transverse;
            const V along = n0 * d6 + n1 * d7 + n2 * d8;
            const V straight = (a * (k_s - transverse) + b_ * k_d) * along, aside = a * transverse;
            const V g0 = -straight * n0 - aside * d6;
            const V g1 = -straight * n1 - aside * d7;
            const V g2 = -straight * n2 - aside * d8;
"""


@wp.func_native(_sum_over_springs(("particle_q", "particle_qd"), "particle_f_out", _PULL, _GRAVITY))
def _pull(
    tiles: Tiles,
    b: int,
    law: wp.array(dtype=real),
    shared_law: wp.array(dtype=vec3),
    shared_by: wp.array(dtype=wp.int32),
    particle_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    world_gravity: wp.array(dtype=vec3),
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
    shared_law: wp.array(dtype=vec3),
    shared_by: wp.array(dtype=wp.int32),
    particle_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    # State in
    world_gravity: wp.array(dtype=vec3),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    memory_out: wp.array2d(dtype=real),
    particle_f_out: wp.array(dtype=vec3),
):
    """Adds spring forces to the particles of blocks ``slot_start[s]`` to ``slot_start[s + 1]``, with the memory s.

    Where each world's gravity is given, they are added to m g: one pass over memory less.
    """
    slot = thread_offset + wp.tid()
    for b in range(slot_start[slot], slot_start[slot + 1]):
        _pull(
            tiles, b, law, shared_law, shared_by, particle_mass, particle_world, world_gravity, particle_q, particle_qd,
            memory_out[slot], particle_f_out,
        )  # fmt: skip


@wp.func_native(_sum_over_springs(("particle_q", "particle_qd"), "particle_f_out", _PULL, _GRAVITY, _ADVANCE))
def _pull_and_advance(
    tiles: Tiles,
    b: int,
    law: wp.array(dtype=real),
    shared_law: wp.array(dtype=vec3),
    shared_by: wp.array(dtype=wp.int32),
    particle_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    particle_inv_mass: wp.array(dtype=real),
    world_gravity: wp.array(dtype=vec3),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    drift: real,
    position_weight: real,
    velocity_weight: real,
    memory_out: wp.array(dtype=real),
    particle_f_out: wp.array(dtype=vec3),
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
): ...


@wp.kernel
def advance_blocks(
    # Model
    thread_offset: int,
    tiles: Tiles,
    slot_start: wp.array(dtype=wp.int32),
    law: wp.array(dtype=real),
    shared_law: wp.array(dtype=vec3),
    shared_by: wp.array(dtype=wp.int32),
    particle_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    world_gravity: wp.array(dtype=vec3),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    drift: real,
    position_weight: real,
    velocity_weight: real,
    # Out
    memory_out: wp.array2d(dtype=real),
    particle_f_out: wp.array(dtype=vec3),
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """:func:`pull_blocks` with gravity, then ``advance`` of ``kernels/explicit_step.py`` to *other* arrays.

    To the same bits, but each block's particles are read once, and not again when they have left the cache.
    """
    slot = thread_offset + wp.tid()
    for b in range(slot_start[slot], slot_start[slot + 1]):
        _pull_and_advance(
            tiles, b, law, shared_law, shared_by, particle_mass, particle_world, particle_inv_mass, world_gravity,
            particle_q, particle_qd, drift, position_weight, velocity_weight, memory_out[slot], particle_f_out,
            particle_q_out, particle_qd_out,
        )  # fmt: skip


@wp.func_native(_sum_over_springs(("particle_q", "particle_qd", "x"), "product_out", _PRODUCT))
def _multiply(
    tiles: Tiles,
    b: int,
    law: wp.array(dtype=real),
    shared_law: wp.array(dtype=vec3),
    shared_by: wp.array(dtype=wp.int32),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    x: wp.array(dtype=vec3),
    a: real,
    b_: real,
    project: real,
    memory_out: wp.array(dtype=real),
    product_out: wp.array(dtype=vec3),
): ...


@wp.kernel
def multiply_blocks(
    # Model
    thread_offset: int,
    tiles: Tiles,
    slot_start: wp.array(dtype=wp.int32),
    law: wp.array(dtype=real),
    shared_law: wp.array(dtype=vec3),
    shared_by: wp.array(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    # State in
    world_project: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    x: wp.array(dtype=vec3),
    a: real,
    b: real,
    # Out
    memory_out: wp.array2d(dtype=real),
    product_out: wp.array(dtype=vec3),
):
    """Adds (a K + b C) x, as ``scatter_products`` of ``kernels/spring_hessian.py`` does, block by block."""
    slot = thread_offset + wp.tid()
    for k in range(slot_start[slot], slot_start[slot + 1]):
        project = world_project[particle_world[tiles.block[k, 4]]]
        _multiply(
            tiles,
            k,
            law,
            shared_law,
            shared_by,
            particle_q,
            particle_qd,
            x,
            a,
            b,
            project,
            memory_out[slot],
            product_out,
        )
