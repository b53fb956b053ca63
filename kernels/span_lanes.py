"""Spans of springs eight at once, for the CPU: what :mod:`spans` does span by span.

A *group* is up to eight spans of one launch that have as many units: first span, how many, units of each, and where in
the memory of the launch their directions go.
"""

import sys

import warp as wp

from .lanes import LANES, for_cpu
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

# solve_spans of kernels/spans.py, written for vectors. The end of a unit is the beginning of the next.
_SOLVE = for_cpu(f"""
    const int* group = groups.data + 4 * g;
    const int count = group[1], length = group[2];
    R* directions = memory_out.data + group[3];
    int unit[{LANES}], at[{LANES}];
    for (int k = 0; k < {LANES}; ++k) {{
        unit[k] = span_units.data[group[0] + (k < count ? k : 0)][0];
        at[k] = unit_ends.data[unit[k]][0];
    }}
    auto one = [&](const R* from) {{
        R rows[{LANES}];
        for (int k = 0; k < {LANES}; ++k) rows[k] = from[at[k]];
        return load(rows);
    }};
    auto three = [&](const auto* from, const int* which, int shift, V& a, V& b, V& c) {{
        R rows[3][{LANES}];
        for (int k = 0; k < {LANES}; ++k) {{
            const R* triple = (const R*)(from + which[k] + shift);
            for (int i = 0; i < 3; ++i) rows[i][k] = triple[i];
        }}
        a = load(rows[0]); b = load(rows[1]); c = load(rows[2]);
    }};
    V x, y, z, mx, my, mz, w = one(particle_inv_mass.data);
    three(particle_q.data, at, 0, x, y, z);
    three(displacement_out.data, at, 0, mx, my, mz);
    V excess = 0, mobility = 0, rest = 0, compliance = 0, damping = 0, nx = 0, ny = 0, nz = 0;
    for (int j = 0; j < length; ++j) {{
        for (int k = 0; k < {LANES}; ++k) at[k] = unit_ends.data[unit[k] + j][1];
        V ax, ay, az, bx, by, bz, l0, l1, l2, sx, sy, sz, fx, fy, fz;
        three(particle_q.data, at, 0, ax, ay, az);
        three(displacement_out.data, at, 0, bx, by, bz);
        three(unit_law.data, unit, j, l0, l1, l2);
        three(unit_stretch.data, unit, j, sx, sy, sz);
        three(unit_force_out.data, unit, j, fx, fy, fz);
        const V ux = bx - mx, uy = by - my, uz = bz - mz;
        const V dx = ax - x + ux, dy = ay - y + uy, dz = az - z + uz;
        const V size = root(dx * dx + dy * dy + dz * dz), inverse = only(1 / size, size > 0);
        const V ex = dx * inverse, ey = dy * inverse, ez = dz * inverse, slowed = l2 / dt;
        excess += size - l0 + ex * (slowed * ux - sx - l1 * fx) + ey * (slowed * uy - sy - l1 * fy)
            + ez * (slowed * uz - sz - l1 * fz);
        const V gx = ex - nx, gy = ey - ny, gz = ez - nz;
        mobility += w * (gx * gx + gy * gy + gz * gz);
        rest += l0; compliance += l1; damping += l0 * l2;
        store(directions + {3 * LANES} * j, ex);
        store(directions + {3 * LANES} * j + {LANES}, ey);
        store(directions + {3 * LANES} * j + {2 * LANES}, ez);
        x = ax; y = ay; z = az; mx = bx; my = by; mz = bz; nx = ex; ny = ey; nz = ez;
        w = one(particle_inv_mass.data);
    }}
    mobility += w * (nx * nx + ny * ny + nz * nz);
    const Mask taut = (excess > 0) & (mobility > 0);
    if (!__builtin_reduce_or(taut)) return;
    const V impulse = only(excess / ((1 + damping / (rest * dt)) * mobility + compliance / (dt * dt)), taut);
    auto add = [&](auto* to, const int* which, int shift, V a, V b, V c) {{
        for (int k = 0; k < count; ++k) {{
            if (!taut[k]) continue;
            R* triple = (R*)(to + which[k] + shift);
            triple[0] += a[k]; triple[1] += b[k]; triple[2] += c[k];
        }}
    }};
    const V force = impulse / (dt * dt);
    for (int k = 0; k < {LANES}; ++k) at[k] = unit_ends.data[unit[k]][0];
    nx = ny = nz = 0;
    for (int j = 0; j < length; ++j) {{
        const V ex = load(directions + {3 * LANES} * j), ey = load(directions + {3 * LANES} * j + {LANES});
        const V ez = load(directions + {3 * LANES} * j + {2 * LANES}), way = impulse * one(particle_inv_mass.data);
        add(displacement_out.data, at, 0, way * (ex - nx), way * (ey - ny), way * (ez - nz));
        add(unit_force_out.data, unit, j, force * ex, force * ey, force * ez);
        for (int k = 0; k < {LANES}; ++k) at[k] = unit_ends.data[unit[k] + j][1];
        nx = ex; ny = ey; nz = ez;
    }}
    const V way = impulse * one(particle_inv_mass.data);
    add(displacement_out.data, at, 0, -way * nx, -way * ny, -way * nz);
""")

# spread_units of kernels/spans.py, written for vectors.
_SPREAD = for_cpu(f"""
    const int* unit = slot_unit.data + {LANES} * entry;
    R* force = spring_force_out.data + {3 * LANES} * (long long)entry;
    R rows[3][{LANES}] = {{}};
    for (int k = 0; k < {LANES}; ++k) {{
        if (unit[k] < 0) continue;
        const R* triple = (const R*)(unit_force.data + unit[k]);
        for (int i = 0; i < 3; ++i) rows[i][k] = triple[i];
    }}
    for (int i = 0; i < 3; ++i)
        store(force + {LANES} * i, (kept > 0 ? kept * load(force + {LANES} * i) : (V)0) + load(rows[i]));
""")


@wp.func_native(_SOLVE)
def _solve(
    groups: wp.array(dtype=wp.int32),
    g: int,
    span_units: wp.array(dtype=wp.vec2i),
    unit_ends: wp.array(dtype=wp.vec2i),
    unit_law: wp.array(dtype=vec3),
    particle_inv_mass: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    unit_stretch: wp.array(dtype=vec3),
    dt: real,
    memory_out: wp.array(dtype=real),
    displacement_out: wp.array(dtype=vec3),
    unit_force_out: wp.array(dtype=vec3),
): ...


@wp.kernel
def solve_groups(
    # Model
    thread_offset: int,
    groups: wp.array(dtype=wp.int32),
    span_units: wp.array(dtype=wp.vec2i),
    unit_ends: wp.array(dtype=wp.vec2i),
    unit_law: wp.array(dtype=vec3),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    unit_stretch: wp.array(dtype=vec3),
    dt: real,
    # Out
    memory_out: wp.array(dtype=real),
    displacement_out: wp.array(dtype=vec3),
    unit_force_out: wp.array(dtype=vec3),
):
    """``solve_spans``, a group each."""
    _solve(
        groups, thread_offset + wp.tid(), span_units, unit_ends, unit_law, particle_inv_mass, particle_q, unit_stretch,
        dt, memory_out, displacement_out, unit_force_out,
    )  # fmt: skip


@wp.func_native(_SPREAD)
def _spread(
    slot_unit: wp.array(dtype=wp.int32),
    entry: int,
    unit_force: wp.array(dtype=vec3),
    kept: real,
    spring_force_out: wp.array(dtype=real),
): ...


@wp.kernel
def spread_entries(
    # Model
    thread_offset: int,
    slot_unit: wp.array(dtype=wp.int32),
    # State in
    unit_force: wp.array(dtype=vec3),
    kept: real,
    # Out
    spring_force_out: wp.array(dtype=real),
):
    """``spread_units`` for springs in lanes, an entry each."""
    _spread(slot_unit, thread_offset + wp.tid(), unit_force, kept, spring_force_out)
