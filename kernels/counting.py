"""Counting by several threads at once, on the CPU too.

Warp's own ``atomic_add`` is a plain addition there, as Warp runs a CPU kernel on one thread. Ranges of one kernel may
run on several (``program.py``), so kernels that do so count with these. Integers only: they add up to the same whatever
the order.

An atomic addition takes some 20 cycles, needed or not. What is added to dozens of times for each pair is also told
whether it is ``alone``, with one thread, and then adds plainly.
"""

import warp as wp


def _adding(place: str, alone: str = "false") -> str:
    return f"""
#if defined(__CUDA_ARCH__)
    return wp::atomic_add({place}, value);
#else
    auto* at = {place};
    if ({alone}) {{
        const auto before = *at;
        *at = before + value;
        return before;
    }}
    return __atomic_fetch_add(at, value, __ATOMIC_RELAXED);
#endif
"""


@wp.func_native(_adding("&wp::index(counts_out, i)"))
def count_up(counts_out: wp.array(dtype=wp.int32), i: int, value: wp.int32) -> wp.int32:
    """Adds ``value`` to element i; returns what was there before."""


@wp.func_native(_adding("&wp::index(sums_out, i)", "alone"))
def add_whole(sums_out: wp.array(dtype=wp.int64), i: int, value: wp.int64, alone: bool) -> wp.int64:
    """The same with 64 bits."""


@wp.func_native(_adding("&wp::index(sums_out, i, j)", "alone"))
def add_whole_at(sums_out: wp.array2d(dtype=wp.int64), i: int, j: int, value: wp.int64, alone: bool) -> wp.int64:
    """The same in two dimensions."""
