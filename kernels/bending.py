"""Bending forces of all elements: scattered with atomic adds, or gathered per particle in a fixed order."""

import sys

import warp as wp

from .bending_law import damping_direction, friction_energy, friction_scale, slipped
from .precision import OPTIONS, real, vec2, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.struct
class BendingModel:
    """Elements by entry, see :class:`warpcloth.cloth.bending.BendingElements`; what does not change.

    ``law`` holds (stiffness [N m³], stiffness times damping time [N m³ s], rest curvature [1/m]), ``friction`` its
    stiffness [N m³] and the slip moment [N m²]. ``turning``: whether any element needs its tangents; their entries come
    first in an element and end at ``turning_end``.
    """

    start: wp.array(dtype=wp.int32)
    particle: wp.array(dtype=wp.int32)
    weight: wp.array(dtype=real)
    tangent: wp.array(dtype=vec2)
    law: wp.array(dtype=vec3)
    friction: wp.array(dtype=vec2)
    turning_end: wp.array(dtype=wp.int32)
    turning: wp.int32


@wp.func
def weighted_sum(elements: BendingModel, e: int, x: wp.array(dtype=vec3)):
    """Σ w_i x_i of an element; from differences, which keeps digits."""
    first = elements.start[e]
    origin = x[elements.particle[first]]
    d = vec3()
    for k in range(first + 1, elements.start[e + 1]):
        d += elements.weight[k] * (x[elements.particle[k]] - origin)
    return d


@wp.func
def tangent_sum(elements: BendingModel, e: int, x: wp.array(dtype=vec3), axis: int):
    """t₁ (axis 0) or t₂ (axis 1) of an element."""
    first = elements.start[e]
    origin = x[elements.particle[first]]
    t = vec3()
    for k in range(first + 1, elements.turning_end[e]):
        t += elements.tangent[k][axis] * (x[elements.particle[k]] - origin)
    return t


@wp.struct
class Sums:
    """d, t₁ and t₂ of an element; where it needs no tangents, these are zero."""

    d: vec3
    t1: vec3
    t2: vec3


@wp.func
def element_sums(elements: BendingModel, e: int, x: wp.array(dtype=vec3)):
    """All sums of an element in one look at its particles, which is what it costs."""
    first = elements.start[e]
    origin = x[elements.particle[first]]
    turning_end = first
    if elements.turning == 1:
        turning_end = elements.turning_end[e]
    d = vec3()
    t1 = vec3()
    t2 = vec3()
    for k in range(first + 1, turning_end):
        arm = x[elements.particle[k]] - origin
        d += elements.weight[k] * arm
        t1 += elements.tangent[k][0] * arm
        t2 += elements.tangent[k][1] * arm
    for k in range(wp.max(first + 1, turning_end), elements.start[e + 1]):
        d += elements.weight[k] * (x[elements.particle[k]] - origin)
    sums = Sums()
    sums.d = d
    sums.t1 = t1
    sums.t2 = t2
    return sums


@wp.struct
class Moments:
    """What an element pulls with: f_i = −w_i bend + α_i along + β_i across."""

    bend: vec3
    along: vec3
    across: vec3


@wp.func
def element_moments(
    elements: BendingModel,
    e: int,
    slip: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
):
    """Moments of an element at a state."""
    law = elements.law[e]
    sums = element_sums(elements, e, particle_q)
    d = sums.d
    result = Moments()
    if elements.turning == 1:
        c = wp.cross(sums.t1, sums.t2)
        friction = elements.friction[e]
        r = d - slip[e] * c
        m_f = friction_scale(r, friction[0], friction[1]) * r
        m_e = law[0] * (d - law[2] * c)
        n = law[2] * m_e + slip[e] * m_f
        result.bend = m_e + m_f
        result.along = wp.cross(sums.t2, n)
        result.across = wp.cross(n, sums.t1)
    else:
        result.bend = law[0] * d
    if law[1] > real(0.0):
        direction = damping_direction(d)
        rate = wp.dot(weighted_sum(elements, e, particle_qd), direction)
        result.bend += (law[1] * rate) * direction
    return result


@wp.func
def entry_tangent(tangent: wp.array(dtype=vec2), turning: int, k: int):
    """(α, β) of entry k."""
    result = vec2()
    if turning == 1:
        result = tangent[k]
    return result


@wp.func
def entry_force(weight: real, tangent: vec2, moments: Moments):
    """Force [N] of an element on the particle of an entry."""
    return tangent[0] * moments.along + tangent[1] * moments.across - weight * moments.bend


@wp.func
def chosen(which: wp.array(dtype=wp.int32), k: int):
    """Element number k of those named; none are named: of all."""
    e = int(k)
    if which.shape[0] > 0:
        e = which[k]
    return e


@wp.kernel
def scatter_forces(
    # Model
    elements: BendingModel,
    which: wp.array(dtype=wp.int32),
    # State in
    slip: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    particle_f_out: wp.array(dtype=vec3),
):
    """One thread per chosen element adds its forces to its particles."""
    e = chosen(which, wp.tid())
    moments = element_moments(elements, e, slip, particle_q, particle_qd)
    for k in range(elements.start[e], elements.start[e + 1]):
        tangent = entry_tangent(elements.tangent, elements.turning, k)
        wp.atomic_add(particle_f_out, elements.particle[k], entry_force(elements.weight[k], tangent, moments))


@wp.kernel
def moments(
    # Model
    thread_offset: int,
    elements: BendingModel,
    which: wp.array(dtype=wp.int32),
    # State in
    slip: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    moments_out: wp.array(dtype=Moments),
):
    """Moments of the chosen elements, for :func:`gather_forces`."""
    e = chosen(which, thread_offset + wp.tid())
    moments_out[e] = element_moments(elements, e, slip, particle_q, particle_qd)


@wp.kernel
def gather_forces(
    # Model
    thread_offset: int,
    elements: BendingModel,
    row_start: wp.array(dtype=wp.int32),
    row_entry: wp.array(dtype=wp.int32),
    row_element: wp.array(dtype=wp.int32),
    # State in
    moments: wp.array(dtype=Moments),
    # Out
    particle_f_out: wp.array(dtype=vec3),
):
    """One thread per particle sums its entries in a fixed order, that of :func:`scatter_forces` on one thread."""
    i = thread_offset + wp.tid()
    total = particle_f_out[i]
    for row in range(row_start[i], row_start[i + 1]):
        k = row_entry[row]
        tangent = entry_tangent(elements.tangent, elements.turning, k)
        total += entry_force(elements.weight[k], tangent, moments[row_element[row]])
    particle_f_out[i] = total


@wp.kernel
def energy(
    # Model
    elements: BendingModel,
    particle_world: wp.array(dtype=wp.int32),
    # State in
    slip: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    # Out
    energy_out: wp.array(dtype=wp.float64),
):
    """Adds each element's energy [J] to that of its world; of friction, what the spring before the slip holds."""
    e = wp.tid()
    law = elements.law[e]
    d = weighted_sum(elements, e, particle_q)
    total = real(0.0)
    if elements.turning == 1:
        c = wp.cross(tangent_sum(elements, e, particle_q, 0), tangent_sum(elements, e, particle_q, 1))
        friction = elements.friction[e]
        if friction[1] > real(0.0):
            total += friction_energy(d - slip[e] * c, friction[0], friction[1])
        d = d - law[2] * c
    total += real(0.5) * law[0] * wp.dot(d, d)
    wp.atomic_add(energy_out, particle_world[elements.particle[elements.start[e]]], wp.float64(total))


@wp.kernel
def advance_slip(
    # Model
    thread_offset: int,
    elements: BendingModel,
    which: wp.array(dtype=wp.int32),
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    slip_out: wp.array(dtype=real),
):
    """At the end of a step: what slipped in it, of the chosen elements."""
    e = chosen(which, thread_offset + wp.tid())
    friction = elements.friction[e]
    if friction[1] > real(0.0):
        sums = element_sums(elements, e, particle_q)
        slip_out[e] = slipped(sums.d, wp.cross(sums.t1, sums.t2), slip_out[e], friction[0], friction[1])
