"""Runs a recorded program on the CPU: launches, copies, loops, by one thread, and by others that help it.

A program is a row of 64-bit words, made by ``warpcloth/program.py``: one of the codes below, then its operands, which
are addresses and sizes; jumps say how many words on, or back. One thread goes through it. Where it comes to a launch
that may run in ranges, it offers them: each helper takes its own, always the same part of the particles, which its
cache then holds; those that nobody has taken the thread runs itself, and it goes on when all are done. So it never
waits for a helper that the system keeps from running, unless that has just taken its range. Each offer has a range for
every thread, empty or not: a helper that comes late then finds its range taken, while one left out of an offer would
take that of the next, once more.

This is for the CPU only; graphs do it on GPUs. There the kernels do nothing.
"""

import sys

import warp as wp

from .precision import FORWARD_ONLY

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

END, CALL, COPY, FILL, APPLY, JUMP, JUMP_UNLESS, AGAIN = range(8)
LINE = 8  # words in a cache line: what one thread writes and others watch has one to itself
NUMBER, OFFER, DONE, STOP, CLAIMS = range(0, 5 * LINE, LINE)  # what is on the table where threads meet
SPINS = 200  # looks at the table before a thread offers its core to others

_COMMON = f"""
#if !defined(__CUDA_ARCH__)
#if defined(__x86_64__)
#define WARPCLOTH_PAUSE __builtin_ia32_pause()
#else
#define WARPCLOTH_PAUSE
#endif
    typedef unsigned long long Word;
    typedef void (*Kernel)(void*, void*);
    typedef void (*Function)(Word);
    typedef void (*Idle)(void);
    Word* table = (Word*)table_out.data;
    // Runs a range of the offer with that number, unless somebody else has taken it; the offer may then be over.
    auto take = [&](Word number, Word range) -> bool {{
        Word* claim = table + {CLAIMS} + {LINE} * range;
        Word claimed = __atomic_load_n(claim, __ATOMIC_RELAXED);
        if (claimed >= number
            || !__atomic_compare_exchange_n(claim, &claimed, number, false, __ATOMIC_ACQ_REL, __ATOMIC_RELAXED))
            return false;
        const Word* call = (const Word*)__atomic_load_n(table + {OFFER}, __ATOMIC_RELAXED);
        if (call[3 + 2 * range] != 0)
            ((Kernel)call[1])((void*)call[3 + 2 * range], (void*)call[4 + 2 * range]);
        __atomic_fetch_add(table + {DONE}, 1, __ATOMIC_RELEASE);
        return true;
    }};
"""

_RUN = (
    _COMMON
    + f"""
    Word number = 0;
    Word* at = (Word*)program.data;
    for (;;) {{
        switch (at[0]) {{
        case {CALL}: {{
            const Word ranges = at[2];
            if (ranges > 1) {{
                __atomic_store_n(table + {DONE}, 0, __ATOMIC_RELAXED);
                __atomic_store_n(table + {OFFER}, (Word)at, __ATOMIC_RELAXED);
                __atomic_store_n(table + {NUMBER}, ++number, __ATOMIC_RELEASE);
            }}
            ((Kernel)at[1])((void*)at[3], (void*)at[4]);
            for (Word range = 1; range < ranges; ++range)
                take(number, range);
            for (int spins = 0; __atomic_load_n(table + {DONE}, __ATOMIC_ACQUIRE) < ranges - 1; ++spins) {{
                WARPCLOTH_PAUSE;
                if (spins >= {SPINS})
                    ((Idle)idle)();
            }}
            at += 3 + 2 * ranges;
            break;
        }}
        case {COPY}:
            memcpy((void*)at[1], (const void*)at[2], at[3]);
            at += 4;
            break;
        case {FILL}:
            for (Word k = 0; k < at[4]; ++k)
                memcpy((char*)at[1] + k * at[3], (const void*)at[2], at[3]);
            at += 5;
            break;
        case {APPLY}:
            ((Function)at[1])(at[2]);
            at += 3;
            break;
        case {JUMP}:
            at += (long long)at[1];
            break;
        case {JUMP_UNLESS}:
            at += *(const unsigned*)at[2] ? 3 : (long long)at[1];
            break;
        case {AGAIN}:
            if (--at[2]) {{
                at += (long long)at[3];
            }} else {{
                at[2] = at[1];
                at += 4;
            }}
            break;
        default:
            __atomic_store_n(table + {STOP}, 1, __ATOMIC_RELEASE);
            return;
        }}
    }}
#endif
"""
)

_HELP = (
    _COMMON
    + f"""
    Word seen = 0;
    for (int spins = 0; !__atomic_load_n(table + {STOP}, __ATOMIC_RELAXED); ++spins) {{
        const Word number = __atomic_load_n(table + {NUMBER}, __ATOMIC_ACQUIRE);
        if (number != seen) {{
            seen = number;
            if (take(number, range))
                spins = 0;
        }}
        WARPCLOTH_PAUSE;
        if (spins >= {SPINS})
            ((Idle)idle)();
    }}
#endif
"""
)


@wp.func_native(_RUN)
def _run(program: wp.array(dtype=wp.uint64), table_out: wp.array(dtype=wp.uint64), idle: wp.uint64): ...


@wp.func_native(_HELP)
def _help(table_out: wp.array(dtype=wp.uint64), range: wp.uint64, idle: wp.uint64): ...


@wp.kernel
def run(
    # Model
    program: wp.array(dtype=wp.uint64),
    idle: wp.uint64,
    # Out
    table_out: wp.array(dtype=wp.uint64),
):
    """The way through a program, to be launched with dimension 1; ``table`` is all zeros before.

    ``idle`` is the address of a function that offers the core to other threads.
    """
    _run(program, table_out, idle)


@wp.kernel
def help_along(
    # Model
    range: wp.uint64,
    idle: wp.uint64,
    # Out
    table_out: wp.array(dtype=wp.uint64),
):
    """Takes one range of each launch until the table says ``STOP``, as when the program has ended; dimension 1."""
    _help(table_out, range, idle)
