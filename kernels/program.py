"""Runs a recorded program on the CPU: launches, copies, loops, by one thread or by several threads in step.

A program is a row of 64-bit words, made by ``warpcloth/program.py``: one of the codes below, then its operands, which
are addresses and sizes. Every thread runs the whole program. What may run in ranges each does for its own range; the
rest is the first one's. ``MEET`` is where all wait for each other, so that each sees what others wrote, and all decide
alike at jumps.

This is for the CPU only; graphs do it on GPUs. There the kernel does nothing.
"""

import sys

import warp as wp

from .precision import FORWARD_ONLY

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

END, CALL, COPY, FILL, APPLY, JUMP, JUMP_UNLESS, MEET = range(8)
SPINS = 200  # looks at the others before a thread offers its core to them

_RUN = f"""
#if !defined(__CUDA_ARCH__)
    typedef unsigned long long Word;
    typedef void (*Kernel)(void*, void*);
    typedef void (*Function)(Word);
    typedef void (*Idle)(void);
    const Word* at = (const Word*)program.data;
    Word* arrived = (Word*)meeting_out.data;
    const Word* given_up = arrived + 1;
    for (;;) {{
        switch (at[0]) {{
        case {CALL}: {{
            const Word* mine = at + 2 + 2 * thread;
            if (mine[0])
                ((Kernel)at[1])((void*)mine[0], (void*)mine[1]);
            at += 2 + 2 * threads;
            break;
        }}
        case {COPY}: {{
            const Word first = at[3] * thread / threads, last = at[3] * (thread + 1) / threads;
            memcpy((char*)at[1] + first, (const char*)at[2] + first, last - first);
            at += 4;
            break;
        }}
        case {FILL}:
            if (thread == 0)
                for (Word k = 0; k < at[4]; ++k)
                    memcpy((char*)at[1] + k * at[3], (const void*)at[2], at[3]);
            at += 5;
            break;
        case {APPLY}:
            if (thread == 0)
                ((Function)at[1])(at[2]);
            at += 3;
            break;
        case {JUMP}:
            at = (const Word*)program.data + at[1];
            break;
        case {JUMP_UNLESS}:
            at = *(const unsigned*)at[1] ? at + 3 : (const Word*)program.data + at[2];
            break;
        case {MEET}: {{
            const Word turn = __atomic_fetch_add(arrived, 1, __ATOMIC_ACQ_REL) / threads + 1;
            for (Word spins = 0; __atomic_load_n(arrived, __ATOMIC_ACQUIRE) < turn * threads; ++spins) {{
                if (__atomic_load_n(given_up, __ATOMIC_RELAXED))
                    return;
                if (spins >= {SPINS})
                    ((Idle)idle)();
            }}
            at += 1;
            break;
        }}
        default:
            return;
        }}
    }}
#endif
"""


@wp.func_native(_RUN)
def _run(
    program: wp.array(dtype=wp.uint64),
    meeting_out: wp.array(dtype=wp.uint64),
    thread: int,
    threads: int,
    idle: wp.uint64,
): ...


@wp.kernel
def run_thread(
    # Model
    program: wp.array(dtype=wp.uint64),
    thread: int,
    threads: int,
    idle: wp.uint64,
    # Out
    meeting_out: wp.array(dtype=wp.uint64),
):
    """One thread's way through a program; to be launched with dimension 1.

    ``idle`` is the address of a function that offers the core to other threads. ``meeting``: how many arrivals at
    meetings there have been, and whether a thread was given up, so that the others must not wait; both 0 at the start.
    """
    _run(program, meeting_out, thread, threads, idle)
