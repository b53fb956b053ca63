"""Whether arrays of numbers have changed since they were last looked at, for the CPU.

In place of the numbers a hash of their bits is kept (FNV-1a of 32-bit words, for eight rows of them at once): a word
that changes always changes it, several at once all but always.
"""

import sys

import warp as wp

from .lanes import LANES, for_cpu
from .precision import FORWARD_ONLY, real

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

WORDS = 3 * LANES  # of the hashes of three arrays

_LOOK = for_cpu(f"""
    typedef unsigned I __attribute__((ext_vector_type({LANES})));
    auto hash = [&](const R* numbers, long long count) {{
        const unsigned* word = (const unsigned*)numbers;
        const long long words = count * (long long)(sizeof(R) / sizeof(unsigned));
        I h = 2166136261u, w = 0;
        long long k = 0;
        for (; k + {LANES} <= words; k += {LANES}) {{
            __builtin_memcpy(&w, word + k, sizeof(I));
            h = (h ^ w) * 16777619u;
        }}
        w = 0;
        __builtin_memcpy(&w, word + k, (words - k) * sizeof(unsigned));
        return (h ^ w) * 16777619u;
    }};
    const long long count = first.shape[0], from = count * part / parts, own = count * (part + 1) / parts - from;
    const I now[3] = {{hash(first.data + from, own), hash(second.data + from, own), hash(third.data + from, own)}};
    int* before = hash_out.data + {WORDS} * part;
    if (__builtin_memcmp(now, before, sizeof(now)) != 0) changed_out.data[0] = 1;
    __builtin_memcpy(before, now, sizeof(now));
""")


@wp.func_native(_LOOK)
def _look(
    part: int,
    parts: int,
    first: wp.array(dtype=real),
    second: wp.array(dtype=real),
    third: wp.array(dtype=real),
    hash_out: wp.array(dtype=wp.int32),
    changed_out: wp.array(dtype=wp.int32),
): ...


@wp.kernel
def look(
    # Model
    thread_offset: int,
    parts: int,
    first: wp.array(dtype=real),
    second: wp.array(dtype=real),
    third: wp.array(dtype=real),
    # Out
    hash_out: wp.array(dtype=wp.int32),
    changed_out: wp.array(dtype=wp.int32),
):
    """Sets ``changed_out[0]`` to 1 if a part of three arrays of one length has other hashes than before, and keeps
    these; a thread for each of ``parts``."""
    _look(thread_offset + wp.tid(), parts, first, second, third, hash_out, changed_out)
