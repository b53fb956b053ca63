"""Rows of springs eight at once, for the CPU: what :mod:`rows` does row by row.

A *group* is up to eight rows that have as many springs and lead as much further; of each it has the first spring, then
the second, and so on, as lanes. Lanes without a row repeat the first one, and what comes of it is dropped.
"""

import sys

import warp as wp

from .lanes import LANES, LAW, for_cpu
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

# Of a thread's memory, for each particle of a row: its inverse mass; of the spring that ends there: direction, upper
# diagonal of the spring before, impulse.
ROWS = 6

# solve_rows of kernels/rows.py, written for vectors. Rows that lie side by side are read and written eight triples at
# once.
_SOLVE = for_cpu(f"""
    const int first = group_start.data[g], length = group_start.data[g + 1] - first, count = group_rows.data[g];
    const int* node = group_particle.data + {LANES} * (first + g);
    const int wide = {LANES} * (length + 1);
    R *mass = memory_out.data, *along = mass + wide, *above = along + 3 * wide, *impulse = above + wide;
    struct Triple {{ V x, y, z; }};
    auto plus = [](Triple a, Triple b) {{ return Triple{{a.x + b.x, a.y + b.y, a.z + b.z}}; }};
    auto minus = [](Triple a, Triple b) {{ return Triple{{a.x - b.x, a.y - b.y, a.z - b.z}}; }};
    auto times = [](V s, Triple a) {{ return Triple{{s * a.x, s * a.y, s * a.z}}; }};
    auto dot = [](Triple a, Triple b) {{ return a.x * b.x + a.y * b.y + a.z * b.z; }};
    auto beside = [&](const int* at) {{ return at[{LANES - 1}] - at[0] == {LANES - 1}; }};  // rising in a group
    auto read = [&](const auto* from, const int* at) {{
        R row[3][{LANES}];
        if (beside(at)) unpack((const R*)(from + at[0]), {LANES}, row[0], row[1], row[2]);
        else for (int k = 0; k < {LANES}; ++k) {{
            const R* triple = (const R*)(from + at[k]);
            row[0][k] = triple[0]; row[1][k] = triple[1]; row[2][k] = triple[2];
        }}
        return Triple{{load(row[0]), load(row[1]), load(row[2])}};
    }};
    auto move = [&](const int* at, Triple way) {{
        R row[3][{LANES}];
        store(row[0], way.x); store(row[1], way.y); store(row[2], way.z);
        auto* to = displacement_out.data;
        if (beside(at)) {{
            const Triple sum = plus(read(to, at), way);
            store(row[0], sum.x); store(row[1], sum.y); store(row[2], sum.z);
            pack((R*)(to + at[0]), {LANES}, row[0], row[1], row[2]);
        }} else for (int k = 0; k < count; ++k) {{
            R* triple = (R*)(to + at[k]);
            triple[0] += row[0][k]; triple[1] += row[1][k]; triple[2] += row[2][k];
        }}
    }};
    for (int i = 0; i < wide; ++i) mass[i] = particle_inv_mass.data[node[i]];
    const R h2 = dt * dt, rate = R(1) / h2;
    Triple x = read(particle_q.data, node), moved = read(displacement_out.data, node), former = {{0, 0, 0}};
    V w = load(mass), coupling = 0, more = 0;
    for (int j = 0; j < length; ++j) {{
        const int e = first + j, *at = node + {LANES} * (j + 1), *slot = group_slot.data + {LANES} * e;
        {LAW}
        R force[3][{LANES}];
        for (int k = 0; k < {LANES}; ++k)
            for (int axis = 0; axis < 3; ++axis) force[axis][k] = spring_force_out.data[slot[k] + axis * stride];
        const V w_q = load(mass + {LANES} * (j + 1));
        const Triple x_q = read(particle_q.data, at), moved_q = read(displacement_out.data, at);
        const Triple by = minus(moved_q, moved), d = plus(minus(x_q, x), by);
        const Triple drawn = times(h2, {{load(force[0]), load(force[1]), load(force[2])}});
        const V elastic = h2 * k_s, viscous = dt * k_d, both = elastic + viscous;
        const V size = root(dot(d, d));
        const Triple n = times(only(1 / size, size != 0), d);  // what is not a number stays visible
        const V lacks = elastic * (size - rest) + dot(n, minus(times(viscous, by), drawn));
        const V turn = dot(former, n), upper = -coupling * turn, lower = -both * w * turn;
        const V inverse = 1 / (1 + both * (w + w_q) - lower * upper);
        more = (lacks - lower * more) * inverse;
        R* own = along + {LANES} * j;
        store(own, n.x); store(own + wide, n.y); store(own + 2 * wide, n.z);
        store(above + {LANES} * j, upper);
        store(impulse + {LANES} * j, more);
        coupling = both * w_q * inverse;
        x = x_q; moved = moved_q; w = w_q; former = n;
    }}
    Triple change = {{0, 0, 0}};
    for (int j = length - 1; j >= 0; --j) {{
        if (j < length - 1) more = load(impulse + {LANES} * j) - load(above + {LANES} * (j + 1)) * more;
        const R* n = along + {LANES} * j;
        const Triple own = times(more, {{load(n), load(n + wide), load(n + 2 * wide)}});
        move(node + {LANES} * (j + 1), times(load(mass + {LANES} * (j + 1)), minus(change, own)));
        const int* slot = group_slot.data + {LANES} * (first + j);
        if (keeps) for (int k = 0; k < count; ++k) {{
            R* force = spring_force_out.data + slot[k];
            force[0] += rate * own.x[k]; force[stride] += rate * own.y[k]; force[2 * stride] += rate * own.z[k];
        }}
        change = own;
    }}
    move(node, times(load(mass), change));
""")


@wp.func_native(_SOLVE)
def _solve(
    g: int,
    group_start: wp.array(dtype=wp.int32),
    group_rows: wp.array(dtype=wp.int32),
    group_particle: wp.array(dtype=wp.int32),
    group_slot: wp.array(dtype=wp.int32),
    stride: int,
    law: wp.array(dtype=real),
    shared_law: wp.array(dtype=vec3),
    shared_by: wp.array(dtype=wp.int32),
    particle_inv_mass: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    dt: real,
    keeps: int,
    memory_out: wp.array(dtype=real),
    displacement_out: wp.array(dtype=vec3),
    spring_force_out: wp.array(dtype=real),
): ...


@wp.kernel
def solve_row_groups(
    # Model
    thread_offset: int,
    slot_start: wp.array(dtype=wp.int32),
    group_start: wp.array(dtype=wp.int32),
    group_rows: wp.array(dtype=wp.int32),
    group_particle: wp.array(dtype=wp.int32),
    group_slot: wp.array(dtype=wp.int32),
    stride: int,
    law: wp.array(dtype=real),
    shared_law: wp.array(dtype=vec3),
    shared_by: wp.array(dtype=wp.int32),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    dt: real,
    keeps: int,
    # Out
    memory_out: wp.array2d(dtype=real),
    displacement_out: wp.array(dtype=vec3),
    spring_force_out: wp.array(dtype=real),
):
    """Solves the rows of groups ``slot_start[s]`` to ``slot_start[s + 1]``, with the memory s.

    Springs of group g are the entries ``group_start[g]`` to ``group_start[g + 1]``, its particles g entries further on,
    as a row has one more of them. Laws are as ``arrange_lanes`` has them; the force [N] of each spring begins at its
    slot, its components ``stride`` apart, and is brought up to date if ``keeps`` is 1.
    """
    slot = thread_offset + wp.tid()
    for g in range(slot_start[slot], slot_start[slot + 1]):
        _solve(
            g, group_start, group_rows, group_particle, group_slot, stride, law, shared_law, shared_by,
            particle_inv_mass, particle_q, dt, keeps, memory_out[slot], displacement_out, spring_force_out,
        )  # fmt: skip
