"""Springs in a row under one tension: how a sweep of XPBD carries load across a cloth.

A sweep over springs (``kernels/xpbd.py``) passes a load on by a spring or two, so steps would have to become shorter as
the mesh becomes finer. So before the first of a step, springs in a row get tension together. A *unit* is a few springs
from particle p to particle q: if their forces change by the same vector, nothing changes between them, and only p and q
move. A *span* is a row of units whose forces change by one tension Δλ along each of them, n = D/|D| with D = x_q − x_p
where the ends would be by now, so that it moves their ends only, by Δλ h²/m times the difference of two n. Forces F
being as they are, the law of all springs together is

    Σ n·(r/k_s F) + Σ r/k_s Δλ = Σ (|D| − Σ r + τ n·Ḋ),      τ = k_d/k_s,

which as for one spring gives

    h² Δλ = Σ (|D| − Σ r + τ/h n·M − n·Σ r/k_s F) / ((1 + τ/h) Σ |Δn|²/m + Σ r/k_s /h²),

M being how much of D the step has brought and Δn the difference at each end of a unit. |D| is no longer than the unit's
springs: where these are bent, a span may be slack although they are not. Then it does nothing, and they do it. Springs
are solved afterwards in any case: spans change what a sweep begins with, not what sweeps converge to.

Long spans come first, then those half as long, and so on to single units: levels of a multigrid method, whose finest
are the springs. Spans of one launch share no particle. What a level changes its finer ones have to know, so forces are
added up for each unit, and reach the springs in the end.
"""

import sys

import warp as wp

from .direct import int_at, pair_at, put, real_at, vector_at
from .precision import FORWARD_ONLY, real, vec3
from .spring_law import direction

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.func
def force_at(spring_force: wp.array(dtype=real), slot: int, stride: int):
    """A force, whose components are ``stride`` apart."""
    return vec3(
        real_at(spring_force, slot), real_at(spring_force, slot + stride), real_at(spring_force, slot + 2 * stride)
    )  # fmt: skip


@wp.kernel
def arrange_units(
    # Model
    thread_offset: int,
    unit_start: wp.array(dtype=wp.int32),
    row_spring: wp.array(dtype=wp.int32),
    spring_rest_length: wp.array(dtype=real),
    spring_stiffness: wp.array(dtype=real),
    spring_damping: wp.array(dtype=real),
    # Out
    unit_law_out: wp.array(dtype=vec3),
    row_compliance_out: wp.array(dtype=real),
):
    """(Σ r [m], Σ r/k_s [m/N], mean τ [s]) of each unit, and r/k_s of each of its springs.

    The springs of unit u are ``unit_start[u]`` to ``unit_start[u + 1]`` of ``row_spring``.
    """
    u = thread_offset + wp.tid()
    law = vec3()
    for m in range(unit_start[u], unit_start[u + 1]):
        s = row_spring[m]
        r = spring_rest_length[s]
        law += vec3(r, r / spring_stiffness[s], r * spring_damping[s] / spring_stiffness[s])
        row_compliance_out[m] = r / spring_stiffness[s]
    unit_law_out[u] = vec3(law[0], law[1], law[2] / law[0])


@wp.kernel
def begin_units(
    # Model
    thread_offset: int,
    unit_start: wp.array(dtype=wp.int32),
    row_slot: wp.array(dtype=wp.int32),
    row_compliance: wp.array(dtype=real),
    stride: int,
    spring_force: wp.array(dtype=real),
    kept: real,
    # Out
    unit_stretch_out: wp.array(dtype=vec3),
    unit_force_out: wp.array(dtype=vec3),
):
    """Σ r/k_s F [m] of each unit, with nothing added yet; of ``spring_force`` F [N] the share ``kept`` counts."""
    u = thread_offset + wp.tid()
    stretch = vec3()
    for m in range(int_at(unit_start, u), int_at(unit_start, u + 1)):
        stretch += (kept * real_at(row_compliance, m)) * force_at(spring_force, int_at(row_slot, m), stride)
    put(unit_stretch_out, u, stretch)
    put(unit_force_out, u, vec3())


@wp.kernel
def solve_spans(
    # Model
    thread_offset: int,
    span_units: wp.array(dtype=wp.vec2i),
    unit_ends: wp.array(dtype=wp.vec2i),
    unit_law: wp.array(dtype=vec3),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    unit_stretch: wp.array(dtype=vec3),
    dt: real,
    # Out
    unit_direction_out: wp.array(dtype=vec3),
    displacement_out: wp.array(dtype=vec3),
    unit_force_out: wp.array(dtype=vec3),
):
    """Adds the tension of each span s to its units, ``span_units[s][0]`` to ``span_units[s][1]``, and moves their
    ends."""
    s = thread_offset + wp.tid()
    units = pair_at(span_units, s)
    excess = real(0.0)
    mobility = real(0.0)
    total = vec3()  # rest length, compliance, damping
    former = vec3()
    last = int(0)
    for u in range(units[0], units[1]):
        ends = pair_at(unit_ends, u)
        law = vector_at(unit_law, u)
        moved = vector_at(displacement_out, ends[1]) - vector_at(displacement_out, ends[0])
        d = vector_at(particle_q, ends[1]) - vector_at(particle_q, ends[0]) + moved
        n = direction(d)
        put(unit_direction_out, u, n)
        stretch = vector_at(unit_stretch, u) + law[1] * vector_at(unit_force_out, u)
        excess += wp.length(d) - law[0] + wp.dot(n, (law[2] / dt) * moved - stretch)
        mobility += real_at(particle_inv_mass, ends[0]) * wp.length_sq(n - former)
        total += vec3(law[0], law[1], law[0] * law[2])
        former = n
        last = ends[1]
    mobility += real_at(particle_inv_mass, last) * wp.length_sq(former)
    if excess > real(0.0) and mobility > real(0.0):
        rate = total[2] / (total[0] * dt)
        impulse = excess / ((real(1.0) + rate) * mobility + total[1] / (dt * dt))
        former = vec3()
        for u in range(units[0], units[1]):
            p = pair_at(unit_ends, u)[0]
            n = vector_at(unit_direction_out, u)
            put(
                displacement_out,
                p,
                vector_at(displacement_out, p) + (impulse * real_at(particle_inv_mass, p)) * (n - former),
            )
            put(unit_force_out, u, vector_at(unit_force_out, u) + (impulse / (dt * dt)) * n)
            former = n
        shift = (impulse * real_at(particle_inv_mass, last)) * former
        put(displacement_out, last, vector_at(displacement_out, last) - shift)


@wp.kernel
def spread_units(
    # Model
    thread_offset: int,
    slot_unit: wp.array(dtype=wp.int32),
    stride: int,
    # State in
    unit_force: wp.array(dtype=vec3),
    kept: real,
    # Out
    spring_force_out: wp.array(dtype=real),
):
    """Adds the forces of units to the share ``kept`` [-] of their springs'; ``slot_unit`` is −1 where there is none."""
    slot = thread_offset + wp.tid()
    unit = int_at(slot_unit, slot)
    force = vec3()
    if unit >= 0:
        force = vector_at(unit_force, unit)
    first = 3 * stride * (slot / stride) + slot % stride
    for k in range(3):
        at = first + k * stride
        if kept > real(0.0):
            force[k] += kept * spring_force_out[at]
        spring_force_out[at] = force[k]
