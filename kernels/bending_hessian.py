"""Stiffness and damping matrices of bending: their products, their 3×3 blocks on the diagonal, and all of these.

Both come from the law of ``bending_law.py``. K leaves out how moments turn with the tangents they are written in (Gauss
and Newton), and how damping changes as cloth moves: then it is positive semi-definite, exact for cloth that is flat at
rest, and for all at rest.
"""

import sys

import warp as wp

from .bending import BendingModel, Moments, element_sums, entry_force, entry_tangent, tangent_sum, weighted_sum
from .bending_law import damping_direction, friction_matrix
from .block_rows import BlockRows
from .precision import FORWARD_ONLY, mat33, real, vec2, vec3

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
        m_f = a * (friction_matrix(d - slip[e] * wp.cross(t1, t2), friction) * (dx - slip[e] * dc))
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


@wp.struct
class EntryMatrices:
    """Blocks of a K + b C between an entry and the others of its element: w_j plain + α_j along + β_j across; the last
    two are zero unless the element ``leans``, so that its moments turn with its tangents."""

    leans: wp.int32
    plain: mat33
    along: mat33
    across: mat33


@wp.func
def entry_matrices(
    elements: BendingModel,
    e: int,
    k: int,
    slip: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    a: real,
    b: real,
):
    """What entry k has with the others. With the measures d − κ c and d − p c, whose derivatives with respect to the
    particle of entry j are w_j I + κ (α_j [t₂]× − β_j [t₁]×), and with p for κ: Gᵀ k G + Hᵀ M H. Most elements are flat
    at rest and have not slipped, κ = p = 0, and leave little to do."""
    law = elements.law[e]
    w = elements.weight[k]
    identity = wp.identity(n=3, dtype=real)
    sums = element_sums(elements, e, particle_q)
    result = EntryMatrices()
    if elements.turning == 1 and (law[2] != real(0.0) or slip[e] != real(0.0)):
        result.leans = 1
        first = wp.skew(sums.t1)
        second = wp.skew(sums.t2)
        tangent = elements.tangent[k]
        turned = tangent[1] * first - tangent[0] * second  # transposed
        r = sums.d - slip[e] * wp.cross(sums.t1, sums.t2)
        elastic = mat33((a * law[0]) * (w * identity + law[2] * turned))
        friction = mat33((w * identity + slip[e] * turned) * friction_matrix(r, elements.friction[e]))
        leaning = mat33(law[2] * elastic + (a * slip[e]) * friction)
        result.plain = elastic + a * friction
        result.along = leaning * second
        result.across = -(leaning * first)
    else:
        result.plain = mat33((a * law[0] * w) * identity)
        if elements.turning == 1:
            result.plain = result.plain + (a * w) * friction_matrix(sums.d, elements.friction[e])
    if law[1] > real(0.0):
        direction = damping_direction(sums.d)
        result.plain = result.plain + (b * law[1] * w) * wp.outer(direction, direction)
    return result


@wp.func
def entry_block(weight: real, tangent: vec2, m: EntryMatrices):
    """The block with an entry of this weight and these tangents."""
    block = mat33(weight * m.plain)
    if m.leans == 1:
        block = block + tangent[0] * m.along + tangent[1] * m.across
    return block


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
    total = mat33()
    for row in range(row_start[i], row_start[i + 1]):
        k = row_entry[row]
        m = entry_matrices(elements, row_element[row], k, slip, particle_q, a, b)
        total += entry_block(elements.weight[k], entry_tangent(elements.tangent, elements.turning, k), m)
    blocks_out[i] = blocks_out[i] + total


@wp.kernel
def add_blocks(
    # Model
    thread_offset: int,
    elements: BendingModel,
    row_start: wp.array(dtype=wp.int32),
    row_entry: wp.array(dtype=wp.int32),
    row_element: wp.array(dtype=wp.int32),
    pair_start: wp.array(dtype=wp.int32),
    pair_slot: wp.array(dtype=wp.int32),
    # State in
    slip: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    a: real,
    b: real,
    # Out
    rows_out: BlockRows,
):
    """Adds a K + b C, one thread per particle; the pair (k, j) of the n entries of element e is number
    ``pair_start[e]`` + k n + j. Its diagonal blocks are those of :func:`diagonal`, to the same bits."""
    i = thread_offset + wp.tid()
    own = mat33()
    for row in range(row_start[i], row_start[i + 1]):
        e = row_element[row]
        k = row_entry[row]
        first = elements.start[e]
        count = elements.start[e + 1] - first
        pair = pair_start[e] + (k - first) * count
        m = entry_matrices(elements, e, k, slip, particle_q, a, b)
        for j in range(count):
            s = pair_slot[pair + j]
            if s >= 0:
                tangent = entry_tangent(elements.tangent, elements.turning, first + j)
                rows_out.block[s] = rows_out.block[s] + entry_block(elements.weight[first + j], tangent, m)
            elif first + j == k:
                own += entry_block(elements.weight[k], entry_tangent(elements.tangent, elements.turning, k), m)
    rows_out.diagonal[i] = rows_out.diagonal[i] + own
