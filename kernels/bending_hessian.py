"""Stiffness and damping matrices of bending, never stored: their products and 3×3 diagonal blocks.

Both come from the law of ``bending_law.py``. K leaves out how moments turn with the tangents they are written in (Gauss
and Newton), and how damping changes as cloth moves: then it is positive semi-definite, exact for cloth that is flat at
rest, and for all at rest.
"""

import sys

import warp as wp

from .bending import BendingModel, Moments, entry_force, entry_tangent, tangent_sum, weighted_sum
from .bending_law import damping_direction, friction_scale, friction_tangent
from .precision import FORWARD_ONLY, mat33, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.func
def element_tangent(
    elements: BendingModel,
    e: int,
    slip: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    x: wp.array(dtype=vec3),
    a: real,
    b: real,
):
    """Moments of (a K + b C) x."""
    law = elements.law[e]
    d = weighted_sum(elements, e, particle_q)
    dx = weighted_sum(elements, e, x)
    result = Moments()
    if elements.turning == 1:
        t1 = tangent_sum(elements, e, particle_q, 0)
        t2 = tangent_sum(elements, e, particle_q, 1)
        dc = wp.cross(tangent_sum(elements, e, x, 0), t2) + wp.cross(t1, tangent_sum(elements, e, x, 1))
        friction = elements.friction[e]
        m_e = a * law[0] * (dx - law[2] * dc)
        m_f = a * friction_tangent(d - slip[e] * wp.cross(t1, t2), dx - slip[e] * dc, friction[0], friction[1])
        n = law[2] * m_e + slip[e] * m_f
        result.bend = m_e + m_f
        result.along = wp.cross(t2, n)
        result.across = wp.cross(n, t1)
    else:
        result.bend = (a * law[0]) * dx
    if law[1] > real(0.0):
        direction = damping_direction(d)
        result.bend += (b * law[1] * wp.dot(dx, direction)) * direction
    return result


@wp.kernel
def scatter_products(
    # Model
    elements: BendingModel,
    # State in
    slip: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    x: wp.array(dtype=vec3),
    a: real,
    b: real,
    # Out
    product_out: wp.array(dtype=vec3),
):
    """Adds (a K + b C) x, one thread per element."""
    e = wp.tid()
    moments = element_tangent(elements, e, slip, particle_q, x, a, b)
    for k in range(elements.start[e], elements.start[e + 1]):
        tangent = entry_tangent(elements.tangent, elements.turning, k)
        wp.atomic_sub(product_out, elements.particle[k], entry_force(elements.weight[k], tangent, moments))


@wp.kernel
def product_moments(
    # Model
    thread_offset: int,
    elements: BendingModel,
    # State in
    slip: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    x: wp.array(dtype=vec3),
    a: real,
    b: real,
    # Out
    moments_out: wp.array(dtype=Moments),
):
    """Moments of (a K + b C) x, for :func:`gather_products`."""
    e = thread_offset + wp.tid()
    moments_out[e] = element_tangent(elements, e, slip, particle_q, x, a, b)


@wp.kernel
def gather_products(
    # Model
    thread_offset: int,
    elements: BendingModel,
    row_start: wp.array(dtype=wp.int32),
    row_entry: wp.array(dtype=wp.int32),
    row_element: wp.array(dtype=wp.int32),
    # State in
    moments: wp.array(dtype=Moments),
    # Out
    product_out: wp.array(dtype=vec3),
):
    """Adds (a K + b C) x, one thread per particle: to the sums of :func:`scatter_products` on one thread."""
    i = thread_offset + wp.tid()
    total = product_out[i]
    for row in range(row_start[i], row_start[i + 1]):
        k = row_entry[row]
        tangent = entry_tangent(elements.tangent, elements.turning, k)
        total -= entry_force(elements.weight[k], tangent, moments[row_element[row]])
    product_out[i] = total


@wp.func
def measure_gradient(elements: BendingModel, k: int, curvature: real, t1: vec3, t2: vec3):
    """Derivative of d − κ c with respect to the particle of entry k, a 3×3 matrix."""
    tangent = elements.tangent[k]
    turn = curvature * (tangent[0] * wp.skew(t2) - tangent[1] * wp.skew(t1))
    return mat33(elements.weight[k] * wp.identity(n=3, dtype=real) + turn)


@wp.kernel
def diagonal(
    # Model
    thread_offset: int,
    elements: BendingModel,
    row_start: wp.array(dtype=wp.int32),
    row_entry: wp.array(dtype=wp.int32),
    row_element: wp.array(dtype=wp.int32),
    # State in
    slip: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    a: real,
    b: real,
    # Out
    blocks_out: wp.array(dtype=mat33),
):
    """Adds the 3×3 blocks on the diagonal of a K + b C, one thread per particle."""
    i = thread_offset + wp.tid()
    identity = wp.identity(n=3, dtype=real)
    total = mat33()
    for row in range(row_start[i], row_start[i + 1]):
        e = row_element[row]
        k = row_entry[row]
        law = elements.law[e]
        w = elements.weight[k]
        d = weighted_sum(elements, e, particle_q)
        if elements.turning == 1:
            t1 = tangent_sum(elements, e, particle_q, 0)
            t2 = tangent_sum(elements, e, particle_q, 1)
            friction = elements.friction[e]
            r = d - slip[e] * wp.cross(t1, t2)
            scale = friction_scale(r, friction[0], friction[1])
            stiff = scale * identity
            if scale < friction[0]:
                n = wp.normalize(r)
                stiff = scale * (identity - wp.outer(n, n))
            g = measure_gradient(elements, k, law[2], t1, t2)
            h = measure_gradient(elements, k, slip[e], t1, t2)
            total += a * (law[0] * wp.transpose(g) * g + wp.transpose(h) * stiff * h)
        else:
            total += (a * law[0] * w * w) * identity
        if law[1] > real(0.0):
            direction = damping_direction(d)
            total += (b * law[1] * w * w) * wp.outer(direction, direction)
    blocks_out[i] = blocks_out[i] + total
