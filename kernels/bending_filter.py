"""A filter for the bending forces of an explicit step, with which these do not limit how long the step may be.

Let Z = M⁻¹(h² K + 2 h C) for a step h, with K and C no less than what bending elements resist and damp with in any
configuration: the sums of c w wᵀ over elements of weights w, alike in x, y and z. A symplectic step is stable while the
eigenvalues z of Z are below 4. In place of accelerations a by bending it takes u = q(Z) a, with
q(z) = (1 − P(1 − 2 z/(s² + s)))/z and P the Legendre polynomial of degree s. By q(0) = 1 smooth motion and the sum of
all momenta stay what they are; and z q(z) ≤ 2 up to z = s² + s, so that rough motion, which would be too fast for the
step, is slowed down to what it can follow. The s − 1 products with Z grow with the square root of z only.

At rest bending gives way by (1/q(Z) − 1) Z⁻¹ (h² + 2 h τ) f/m more than it should, τ being its damping time and f the
forces that it balances: by a quarter of (h² + 2 h τ) f/m where these are smooth. Were all forces smoothed, as they were
at first, that would be nothing, but springs, which are not, would hold q(Z) f: a strip pulled at one row of its
vertices was stretched up to three and a half times as far.

These are the stages of the stabilised Runge–Kutta–Legendre method (Meyer, Balsara, Aslam, J. Comput. Phys. 257, 2014),
whose recurrence for u is

    j u_j = (2 j − 1) (u_{j−1} + 2/(s² + s) (a − Z u_{j−1})) − (j − 1) u_{j−2},    u_0 = 0.

s is odd: P(−1) = 1 for even s would leave the roughest motion without force. Each world has its own s, so that what it
does is not up to the worlds beside it.
"""

import sys

import warp as wp

from .bending import BendingModel, Moments, chosen, weighted_sum
from .bending_lanes import Groups
from .lanes import LANES, for_cpu
from .precision import FORWARD_ONLY, real, vec2, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

LONGEST = 63  # stages; steps that would need more are as unstable as they would be without


@wp.func
def resistance(elements: BendingModel, e: int, dt: real):
    """What an element adds to h² K + 2 h C, c [N m s²], in c w wᵀ."""
    law = elements.law[e]
    return dt * (dt * (law[0] + elements.friction[e][0]) + real(2.0) * law[1])


@wp.kernel
def count_stages(
    # Model
    world_rates: wp.array(dtype=vec2),
    # State in
    dt: real,
    # Out
    stages_out: wp.array(dtype=wp.int32),
):
    """The smallest odd s, to a limit, for which s² + s is no less than z; by rates (ω² [1/s²], γ [1/s]) of worlds."""
    world = wp.tid()
    rates = world_rates[world]
    z = dt * (dt * rates[0] + real(2.0) * rates[1])
    stages = int(wp.ceil(real(0.5) * (wp.sqrt(real(1.0) + real(4.0) * z) - real(1.0))))
    stages_out[world] = wp.clamp(stages, 1, LONGEST) | 1


@wp.kernel
def begin(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    stages: wp.array(dtype=wp.int32),
    # State in
    force: wp.array(dtype=vec3),
    # Out
    before_out: wp.array(dtype=vec3),
    now_out: wp.array(dtype=vec3),
    product_out: wp.array(dtype=vec3),
):
    """u_0 and u_1 [m/s²] of a force [N]."""
    i = thread_offset + wp.tid()
    s = stages[particle_world[i]]
    before_out[i] = vec3()
    now_out[i] = (real(2.0) / real(s * (s + 1)) * particle_inv_mass[i]) * force[i]
    product_out[i] = vec3()


@wp.kernel
def improve(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    stages: wp.array(dtype=wp.int32),
    # State in
    force: wp.array(dtype=vec3),
    now: wp.array(dtype=vec3),
    stage: int,
    # Out
    before_out: wp.array(dtype=vec3),
    product_out: wp.array(dtype=vec3),
):
    """u of a stage in place of that two stages before; ``product_out`` held −M Z u of the former; it is cleared."""
    i = thread_offset + wp.tid()
    s = stages[particle_world[i]]
    u = now[i]
    if stage <= s:
        weight = real(2.0) / real(s * (s + 1)) * particle_inv_mass[i]
        u += weight * (force[i] + product_out[i])
        u = (real(2 * stage - 1) * u - real(stage - 1) * before_out[i]) / real(stage)
    before_out[i] = u
    product_out[i] = vec3()


@wp.kernel
def end(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    stages: wp.array(dtype=wp.int32),
    # State in
    force: wp.array(dtype=vec3),
    now: wp.array(dtype=vec3),
    # Out
    particle_f_out: wp.array(dtype=vec3),
):
    """Adds forces [N] that accelerate particles by u; where one stage is enough, those that there were."""
    i = thread_offset + wp.tid()
    f = force[i]
    if stages[particle_world[i]] > 1 and particle_inv_mass[i] > real(0.0):
        f = now[i] / particle_inv_mass[i]
    particle_f_out[i] = particle_f_out[i] + f


@wp.kernel
def scatter_products(
    # Model
    elements: BendingModel,
    which: wp.array(dtype=wp.int32),
    # State in
    x: wp.array(dtype=vec3),
    dt: real,
    # Out
    product_out: wp.array(dtype=vec3),
):
    """Adds −(h² K + 2 h C) x, one thread per chosen element."""
    e = chosen(which, wp.tid())
    moment = resistance(elements, e, dt) * weighted_sum(elements, e, x)
    for k in range(elements.start[e], elements.start[e + 1]):
        wp.atomic_sub(product_out, elements.particle[k], elements.weight[k] * moment)


@wp.kernel
def product_moments(
    # Model
    thread_offset: int,
    elements: BendingModel,
    which: wp.array(dtype=wp.int32),
    # State in
    x: wp.array(dtype=vec3),
    dt: real,
    # Out
    moments_out: wp.array(dtype=Moments),
):
    """The same as moments of the chosen elements, for ``gather_forces`` of ``bending.py``."""
    e = chosen(which, thread_offset + wp.tid())
    moments = Moments()
    moments.bend = resistance(elements, e, dt) * weighted_sum(elements, e, x)
    moments_out[e] = moments


# The entries of elements e, e + 1 … are those of e, whose particles are moved on by 1 for each.
_RESIST = for_cpu(f"""
    const int* block = groups.block.data + 6 * b;
    const int lo = block[2], n = block[3] - lo, room = n + {LANES} + (-n & {LANES - 1});
    R *x = memory_out.data, *y = x + room, *z = y + room, *fx = z + room, *fy = fx + room, *fz = fy + room;
    for (R* row = memory_out.data; row < fz + room; row += {LANES}) store(row, 0);
    unpack((const R*)(particle_x.data + lo), n, x, y, z);
    const int own = block[4] - lo, owned = block[5] - block[4];
    unpack((const R*)(product_out.data + block[4]), owned, fx + own, fy + own, fz + own);
    const int* particle = elements.particle.data;
    const R* weight = elements.weight.data;
    for (int g = block[0]; g < block[1]; ++g) {{
        const int e = groups.group.data[2 * g], count = groups.group.data[2 * g + 1];
        const int first = elements.start.data[e], last = elements.start.data[e + 1], i = particle[first] - lo;
        const V ox = load(x + i), oy = load(y + i), oz = load(z + i);
        V dx = 0, dy = 0, dz = 0, c = 0;
        for (int k = first + 1; k < last; ++k) {{
            const int j = particle[k] - lo;
            dx += weight[k] * (load(x + j) - ox);
            dy += weight[k] * (load(y + j) - oy);
            dz += weight[k] * (load(z + j) - oz);
        }}
        for (int k = 0; k < count; ++k) {{
            const R* law = (const R*)(elements.law.data + e + k);
            const R friction = ((const R*)(elements.friction.data + e + k))[0];
            c[k] = dt * (dt * (law[0] + friction) + 2 * law[1]);
        }}
        dx *= c; dy *= c; dz *= c;
        for (int k = first; k < last; ++k) {{
            const int j = particle[k] - lo;
            store(fx + j, load(fx + j) - weight[k] * dx);
            store(fy + j, load(fy + j) - weight[k] * dy);
            store(fz + j, load(fz + j) - weight[k] * dz);
        }}
    }}
    pack((R*)(product_out.data + block[4]), owned, fx + own, fy + own, fz + own);
""")


@wp.func_native(_RESIST)
def _resist(
    groups: Groups,
    b: int,
    elements: BendingModel,
    particle_x: wp.array(dtype=vec3),
    dt: real,
    memory_out: wp.array(dtype=real),
    product_out: wp.array(dtype=vec3),
): ...


@wp.kernel
def resist_blocks(
    # Model
    thread_offset: int,
    groups: Groups,
    slot_start: wp.array(dtype=wp.int32),
    elements: BendingModel,
    # State in
    x: wp.array(dtype=vec3),
    dt: real,
    # Out
    memory_out: wp.array2d(dtype=real),
    product_out: wp.array(dtype=vec3),
):
    """:func:`scatter_products` for blocks ``slot_start[s]`` to ``slot_start[s + 1]``, with the memory s."""
    slot = thread_offset + wp.tid()
    for b in range(slot_start[slot], slot_start[slot + 1]):
        _resist(groups, b, elements, x, dt, memory_out[slot], product_out)
