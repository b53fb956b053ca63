"""Rows of arrays, some to each world: put back or cleared for the worlds in a mask. Words of 32 bits, of any type."""

import sys

import warp as wp

from .precision import OPTIONS

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.kernel
def copy_rows(
    # State in
    mask: wp.array(dtype=wp.bool),
    row_world: wp.array(dtype=wp.int32),
    start: wp.array2d(dtype=wp.int32),
    # Out
    rows_out: wp.array2d(dtype=wp.int32),
):
    """Rows of the worlds in the mask become those of ``start``."""
    row, word = wp.tid()
    if mask[row_world[row]]:
        rows_out[row, word] = start[row, word]


@wp.kernel
def clear_rows(
    # State in
    mask: wp.array(dtype=wp.bool),
    row_world: wp.array(dtype=wp.int32),
    # Out
    rows_out: wp.array2d(dtype=wp.int32),
):
    """Rows of the worlds in the mask become zero."""
    row, word = wp.tid()
    if mask[row_world[row]]:
        rows_out[row, word] = 0
