"""A symmetric matrix of 3×3 blocks, row by row: force terms add it up once, and it is then multiplied many times.

What couples particles is kept such that the product does not see a motion common to all, however stiff they are:

    (A x)_i = D_i x_i + Σ_j A_ij (x_j − x_i)

with D_i = Σ_j A_ij, which is zero for forces between particles, and is what holds particles to the air or to obstacles.
"""

import sys

import warp as wp

from .direct import int_at, matrix_at, vector_at
from .precision import FORWARD_ONLY, mat33, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.struct
class BlockRows:
    """Row i has blocks ``start[i]`` to ``start[i + 1]``: A_ij in ``block``, j ≠ i in ``column``; D_i in ``own``.

    ``diagonal`` has A_ii of those terms that add it as well, which products do not need, but preconditioners do.
    """

    start: wp.array(dtype=wp.int32)
    column: wp.array(dtype=wp.int32)
    block: wp.array(dtype=mat33)
    own: wp.array(dtype=mat33)
    diagonal: wp.array(dtype=mat33)


@wp.kernel
def multiply(
    # Model
    thread_offset: int,
    # State in
    rows: BlockRows,
    x: wp.array(dtype=vec3),
    # Out
    product_out: wp.array(dtype=vec3),
):
    """Adds A x, one thread per particle."""
    i = thread_offset + wp.tid()
    here = x[i]
    total = product_out[i] + rows.own[i] * here
    for s in range(rows.start[i], rows.start[i + 1]):
        apart = vector_at(x, int_at(rows.column, s)) - here
        total += matrix_at(rows.block, s) * apart
    product_out[i] = total


@wp.kernel
def add_diagonal(
    # Model
    thread_offset: int,
    # State in
    rows: BlockRows,
    # Out
    blocks_out: wp.array(dtype=mat33),
):
    """Adds the blocks A_ii."""
    i = thread_offset + wp.tid()
    blocks_out[i] = blocks_out[i] + rows.diagonal[i]
