"""A symmetric matrix of 3×3 blocks, row by row: force terms add it up once, and it is then multiplied many times.

What couples particles is kept such that the product does not see a motion common to all, however stiff they are:

    (A x)_i = D_i x_i + Σ_j A_ij (x_j − x_i)

with D_i = Σ_j A_ij, which is zero for forces between particles, and is what holds particles to the air or to obstacles.
"""

import sys

import warp as wp

from .precision import FORWARD_ONLY, mat33, real, vec3

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


# Of a block's nine numbers rows are taken four at a time, so that one lane is not part of the row, and is not summed.
_ROW = f"""
    const auto here = x.data[i];
#if defined(__CUDA_ARCH__)
    auto total = wp::sub(here, here);
    for (int s = rows.start.data[i]; s < rows.start.data[i + 1]; ++s) {{
        const auto apart = wp::sub(x.data[rows.column.data[s]], here);
        total = wp::add(total, wp::mul(rows.block.data[s], apart));
    }}
    return total;
#else
    typedef {"double" if real.__name__ == "float64" else "float"} R;
    typedef R Four __attribute__((ext_vector_type(4)));
    auto four = [](const R* from) {{ Four v; __builtin_memcpy(&v, from, sizeof(Four)); return v; }};
    auto three = [](const void* from) {{ Four v = 0; __builtin_memcpy(&v, from, 3 * sizeof(R)); return v; }};
    const Four base = three(x.data + i);
    Four a = 0, b = 0, c = 0;
    for (int s = rows.start.data[i]; s < rows.start.data[i + 1]; ++s) {{
        const R* block = (const R*)(rows.block.data + s);
        const Four apart = three(x.data + rows.column.data[s]) - base;
        a += four(block) * apart;
        b += four(block + 3) * apart;
        c += four(block + 5) * __builtin_shufflevector(apart, apart, -1, 0, 1, 2);
    }}
    return {{a[0] + a[1] + a[2], b[0] + b[1] + b[2], c[1] + c[2] + c[3]}};
#endif
"""


@wp.func_native(_ROW)
def pulls(rows: BlockRows, x: wp.array(dtype=vec3), i: int) -> vec3:
    """Σ_j A_ij (x_j − x_i)."""


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
    product_out[i] = product_out[i] + rows.own[i] * x[i] + pulls(rows, x, i)


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
