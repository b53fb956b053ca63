"""Bending of eight elements at once, for the CPU and cloth that is numbered like a grid.

On a grid, elements of one kind lead to particles i, i + 1, i + 2 … with one and the same weights. A *group* is up to
eight such elements; a *block*, particles whose forces one thread sums in memory of its own. Groups that reach into a
block from outside are evaluated for it once more, so blocks need not wait for each other.
"""

import sys

import warp as wp

from .bending import BendingModel
from .bending_law import FLAT_CURVATURE
from .lanes import LANES, for_cpu
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

ROWS = 9  # of a thread's memory: positions, velocities, forces


@wp.struct
class Groups:
    """Blocks: first and last group (the latter not included), first and last particle of what they read, and of what
    is their own. Groups: first element, and how many."""

    block: wp.array2d(dtype=wp.int32)
    group: wp.array2d(dtype=wp.int32)


# The entries of elements e, e + 1 … are those of e, whose particles are moved on by 1 for each.
_ENTRIES = """
    const int first = elements.start.data[e], last = elements.start.data[e + 1];
    const int turning_end = elements.turning ? elements.turning_end.data[e] : first;
    const int* particle = elements.particle.data;
    const R* weight = elements.weight.data;
    const R* tangent = (const R*)elements.tangent.data;
    R f0[LANES], f1[LANES];
    for (int k = 0; k < LANES; ++k) {
        const R* of_friction = (const R*)(elements.friction.data + e + (k < count ? k : 0));
        f0[k] = of_friction[0];
        f1[k] = of_friction[1];
    }
    const V friction = load(f0), slip_moment = load(f1), p = some(slip.data + e, count);
    V dx = 0, dy = 0, dz = 0, ax = 0, ay = 0, az = 0, bx = 0, by = 0, bz = 0;
    auto add = [&](int k, V x, V y, V z) {
        const R w = weight[k];
        dx += w * x; dy += w * y; dz += w * z;
        if (k < turning_end) {
            const R a = tangent[2 * k], b = tangent[2 * k + 1];
            ax += a * x; ay += a * y; az += a * z;
            bx += b * x; by += b * y; bz += b * z;
        }
    };
""".replace("LANES", str(LANES))

_NORMAL = "const V cx = ay * bz - az * by, cy = az * bx - ax * bz, cz = ax * by - ay * bx;"

# element_moments and entry_force of kernels/bending.py, written for vectors.
_PULL = for_cpu(f"""
    const int* block = groups.block.data + 6 * b;
    const int lo = block[2], n = block[3] - lo, room = n + {LANES} + (-n & {LANES - 1});
    R *x = memory_out.data, *y = x + room, *z = y + room, *u = z + room, *v = u + room, *w = v + room;
    R *fx = w + room, *fy = fx + room, *fz = fy + room;
    for (R* row = memory_out.data; row < fz + room; row += {LANES}) store(row, 0);
    unpack((const R*)(particle_q.data + lo), n, x, y, z);
    unpack((const R*)(particle_qd.data + lo), n, u, v, w);
    const int own = block[4] - lo, owned = block[5] - block[4];
    unpack((const R*)(particle_f_out.data + block[4]), owned, fx + own, fy + own, fz + own);
    for (int g = block[0]; g < block[1]; ++g) {{
        const int e = groups.group.data[2 * g], count = groups.group.data[2 * g + 1];
        {_ENTRIES}
        const int i = particle[first] - lo;
        const V ox = load(x + i), oy = load(y + i), oz = load(z + i);
        for (int k = first + 1; k < last; ++k) {{
            const int j = particle[k] - lo;
            add(k, load(x + j) - ox, load(y + j) - oy, load(z + j) - oz);
        }}
        R l0[{LANES}], l1[{LANES}], l2[{LANES}];
        unpack((const R*)(elements.law.data + e), count, l0, l1, l2);
        const V stiffness = load(l0), damping = load(l1), curvature = load(l2);
        V mx = stiffness * dx, my = stiffness * dy, mz = stiffness * dz;
        V sx = 0, sy = 0, sz = 0, tx = 0, ty = 0, tz = 0;
        if (turning_end > first) {{
            {_NORMAL}
            const V rx = dx - p * cx, ry = dy - p * cy, rz = dz - p * cz;
            const V length = root(rx * rx + ry * ry + rz * rz);
            const V scale = friction * length > slip_moment ? slip_moment / length : friction;
            const V ex = mx - stiffness * curvature * cx, ey = my - stiffness * curvature * cy;
            const V ez = mz - stiffness * curvature * cz, slid = p * scale;
            const V nx = curvature * ex + slid * rx, ny = curvature * ey + slid * ry, nz = curvature * ez + slid * rz;
            mx = ex + scale * rx; my = ey + scale * ry; mz = ez + scale * rz;
            sx = by * nz - bz * ny; sy = bz * nx - bx * nz; sz = bx * ny - by * nx;
            tx = ny * az - nz * ay; ty = nz * ax - nx * az; tz = nx * ay - ny * ax;
        }}
        bool damped = false;
        for (int k = 0; k < count; ++k) damped |= l1[k] > 0;
        if (damped) {{
            const V ou = load(u + i), ov = load(v + i), ow = load(w + i);
            V du = 0, dv = 0, dw = 0;
            for (int k = first + 1; k < last; ++k) {{
                const int j = particle[k] - lo;
                du += weight[k] * (load(u + j) - ou);
                dv += weight[k] * (load(v + j) - ov);
                dw += weight[k] * (load(w + j) - ow);
            }}
            const R flat = {float(FLAT_CURVATURE)!r};
            const V rate = damping * (du * dx + dv * dy + dw * dz) / (dx * dx + dy * dy + dz * dz + flat * flat);
            mx += rate * dx; my += rate * dy; mz += rate * dz;
        }}
        const Mask there = among((1 << count) - 1);
        mx = only(mx, there); my = only(my, there); mz = only(mz, there);
        sx = only(sx, there); sy = only(sy, there); sz = only(sz, there);
        tx = only(tx, there); ty = only(ty, there); tz = only(tz, there);
        for (int k = first; k < last; ++k) {{
            const int j = particle[k] - lo;
            const R c = weight[k];
            V px = load(fx + j) - c * mx, py = load(fy + j) - c * my, pz = load(fz + j) - c * mz;
            if (k < turning_end) {{
                const R a = tangent[2 * k], b = tangent[2 * k + 1];
                px += a * sx + b * tx; py += a * sy + b * ty; pz += a * sz + b * tz;
            }}
            store(fx + j, px); store(fy + j, py); store(fz + j, pz);
        }}
    }}
    pack((R*)(particle_f_out.data + block[4]), owned, fx + own, fy + own, fz + own);
""")

# advance_slip of kernels/bending.py, written for vectors.
_SLIP = for_cpu(f"""
    const auto& slip = slip_out;
    const int e = groups.group.data[2 * g], count = groups.group.data[2 * g + 1];
    {_ENTRIES}
    bool slips = false;
    for (int k = 0; k < {LANES}; ++k) slips |= f1[k] > 0;
    if (!slips) return;
    R x[{LANES}], y[{LANES}], z[{LANES}];
    auto read = [&](int k) {{ unpack((const R*)(particle_q.data + particle[k]), count, x, y, z); }};
    read(first);
    const V ox = load(x), oy = load(y), oz = load(z);
    for (int k = first + 1; k < last; ++k) {{
        read(k);
        add(k, load(x) - ox, load(y) - oy, load(z) - oz);
    }}
    {_NORMAL}
    const V length = root(cx * cx + cy * cy + cz * cz), reach = slip_moment / friction;
    const V curvature = (dx * cx + dy * cy + dz * cz) / (length * length);
    const V low = curvature - reach, high = curvature + reach;
    const V kept = p < low ? low : p > high ? high : p;
    const V result = ((slip_moment > 0) & (length > 0)) ? kept : p;
    for (int k = 0; k < count; ++k) slip_out.data[e + k] = result[k];
""")


@wp.func_native(_PULL)
def _pull(
    groups: Groups,
    b: int,
    elements: BendingModel,
    slip: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    memory_out: wp.array(dtype=real),
    particle_f_out: wp.array(dtype=vec3),
): ...


@wp.kernel
def pull_blocks(
    # Model
    thread_offset: int,
    groups: Groups,
    slot_start: wp.array(dtype=wp.int32),
    elements: BendingModel,
    # State in
    slip: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    memory_out: wp.array2d(dtype=real),
    particle_f_out: wp.array(dtype=vec3),
):
    """Adds bending forces to the particles of blocks ``slot_start[s]`` to ``slot_start[s + 1]``, with the memory s."""
    slot = thread_offset + wp.tid()
    for b in range(slot_start[slot], slot_start[slot + 1]):
        _pull(groups, b, elements, slip, particle_q, particle_qd, memory_out[slot], particle_f_out)


@wp.func_native(_SLIP)
def _slip(
    groups: Groups,
    g: int,
    elements: BendingModel,
    particle_q: wp.array(dtype=vec3),
    slip_out: wp.array(dtype=real),
): ...


@wp.kernel
def advance_slips(
    # Model
    thread_offset: int,
    groups: Groups,
    elements: BendingModel,
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    slip_out: wp.array(dtype=real),
):
    """At the end of a step: what slipped in it, group by group; each element must be in one only."""
    _slip(groups, thread_offset + wp.tid(), elements, particle_q, slip_out)
