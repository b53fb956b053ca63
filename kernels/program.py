"""Runs a recorded program on the CPU: launches, copies, loops, by one thread, and by others that help it.

A program is a row of 64-bit words, made by ``warpcloth/program.py``: one of the codes below, then its operands, which
are addresses and sizes. One thread goes through it. Where it comes to a launch that may run in ranges, it offers them:
each range is taken by whoever is free, and it goes on when all are done. So nobody waits for a helper that the system
keeps from running, unless that has just taken a range.

This is for the CPU only; graphs do it on GPUs. There the kernels do nothing.
"""

import sys

import warp as wp

from .precision import FORWARD_ONLY

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

END, CALL, COPY, FILL, APPLY, JUMP, JUMP_UNLESS = range(7)
TICKET, DONE, OFFER, STOP, TABLE_SIZE = range(5)  # what words of the table are for, on which threads meet
SPINS = 200  # looks at the table before a thread offers its core to others

_COMMON = f"""
#if !defined(__CUDA_ARCH__)
    typedef unsigned long long Word;
    typedef void (*Kernel)(void*, void*);
    typedef void (*Function)(Word);
    typedef void (*Idle)(void);
    Word* table = (Word*)table_out.data;
    const Word most = 0xffff;
    // Takes a range of the launch on offer and runs it; false if there is none left. A ticket is the number of the
    // offer and that of its next range, so that nobody takes a range of an offer that is over.
    auto take = [&]() -> bool {{
        Word ticket = __atomic_load_n(table + {TICKET}, __ATOMIC_ACQUIRE);
        const Word* offer = (const Word*)__atomic_load_n(table + {OFFER}, __ATOMIC_RELAXED);
        if (!offer || (ticket & most) >= offer[2])
            return false;
        const Word* range = offer + 3 + 2 * (ticket & most);
        if (!__atomic_compare_exchange_n(
                table + {TICKET}, &ticket, ticket + 1, false, __ATOMIC_ACQ_REL, __ATOMIC_RELAXED))
            return true;
        ((Kernel)offer[1])((void*)range[0], (void*)range[1]);
        __atomic_fetch_add(table + {DONE}, 1, __ATOMIC_RELEASE);
        return true;
    }};
"""

_RUN = (
    _COMMON
    + f"""
    Word offers = 0;
    const Word* at = (const Word*)program.data;
    for (;;) {{
        switch (at[0]) {{
        case {CALL}:
            if (at[2] == 1) {{
                ((Kernel)at[1])((void*)at[3], (void*)at[4]);
            }} else {{
                __atomic_store_n(table + {DONE}, 0, __ATOMIC_RELAXED);
                __atomic_store_n(table + {OFFER}, (Word)at, __ATOMIC_RELAXED);
                __atomic_store_n(table + {TICKET}, ++offers << 16, __ATOMIC_RELEASE);
                while (take()) {{}}
                for (int spins = 0; __atomic_load_n(table + {DONE}, __ATOMIC_ACQUIRE) < at[2]; ++spins)
                    if (spins >= {SPINS})
                        ((Idle)idle)();
            }}
            at += 3 + 2 * at[2];
            break;
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
            at = (const Word*)program.data + at[1];
            break;
        case {JUMP_UNLESS}:
            at = *(const unsigned*)at[1] ? at + 3 : (const Word*)program.data + at[2];
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
    for (int spins = 0; !__atomic_load_n(table + {STOP}, __ATOMIC_RELAXED); ++spins) {{
        if (take())
            spins = 0;
        else if (spins >= {SPINS})
            ((Idle)idle)();
    }}
#endif
"""
)


@wp.func_native(_RUN)
def _run(program: wp.array(dtype=wp.uint64), table_out: wp.array(dtype=wp.uint64), idle: wp.uint64): ...


@wp.func_native(_HELP)
def _help(table_out: wp.array(dtype=wp.uint64), idle: wp.uint64): ...


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
    idle: wp.uint64,
    # Out
    table_out: wp.array(dtype=wp.uint64),
):
    """Takes ranges until the program has ended, or the table says ``STOP``; to be launched with dimension 1."""
    _help(table_out, idle)
