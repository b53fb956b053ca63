"""Frames as programs for the CPU, run by one or several threads (``kernels/program.py``).

Warp replays a graph on the CPU in one thread, and takes microseconds for each launch in it; a program takes 0.1 µs, and
its launches run in ranges on all threads (0.3 µs more). What they compute does not depend on how many there are.
"""

import ctypes
import functools
import os
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import warp as wp

from .kernels import KernelSet
from .launching import recording, runs_in_ranges

PARTICLES_PER_THREAD = 1000  # fewer do not pay for the waiting


def cores() -> int:
    """Cores of the CPU that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def default_threads(particles: int) -> int:
    """Threads for a simulation of so many particles: as many as there are cores, but none with too little to do."""
    return max(1, min(cores(), particles // PARTICLES_PER_THREAD))


@functools.cache
def programs_work() -> bool:
    """Whether this Warp's recorded launches can be taken apart as programs need them; if not, frames are graphs."""
    kernels = KernelSet("float32").program
    nothing = wp.zeros(kernels.CLAIMS, dtype=wp.uint64, device="cpu")
    call = wp.launch(kernels.run, 1, [nothing, 0], [nothing], device="cpu", record_cmd=True)
    taken_apart = all(hasattr(call, name) for name in ("hooks", "params", "bounds"))
    return taken_apart and hasattr(call.hooks, "forward") and len(call.params) == 4


def record_program(frame: Callable[[], None], kernels: KernelSet, threads: int) -> "Program":
    """What ``frame`` asks for through :mod:`warpcloth.launching`, without doing it.

    Args:
        frame: a function; everything that it uses must live as long as the program, which keeps arrays, not objects.
        kernels: the model's. threads: how many will run it.
    """
    recorder = ProgramWriter(kernels, threads)
    with recording(recorder):
        frame()
    return recorder.program()


class ProgramWriter:
    """Writes a program word by word."""

    def __init__(self, kernels: KernelSet, threads: int):
        self._kernels, self._codes, self._threads = kernels, kernels.program, threads
        self._words: list[int] = []
        self._kept: list[Any] = []
        self._calls: dict[tuple, list[int]] = {}
        self._patterns: dict[tuple, wp.array] = {}

    def launch(self, kernel: wp.Kernel, dim: int, arguments: Sequence[Any]) -> None:
        """A launch on the CPU; the same one again shares its arguments."""
        if dim <= 0:
            return
        key = (kernel, dim, *map(_identity, arguments))
        if key not in self._calls:
            self._calls[key] = self._prepared(kernel, dim, arguments)
            self._kept.append(arguments)
        self._words += self._calls[key]

    def copy(self, target: wp.array, source: wp.array, count: int) -> None:
        """So many elements of one contiguous array to another."""
        if not (target.is_contiguous and source.is_contiguous and target.strides[-1] == source.strides[-1]):
            raise ValueError("only contiguous arrays of one type are copied within frames")
        self._words += [self._codes.COPY, target.ptr or 0, source.ptr or 0, count * source.strides[-1]]
        self._kept += [target, source]

    def fill(self, target: wp.array, value: Any) -> None:
        """All elements of a contiguous array."""
        key = (target.dtype, _identity(value))
        if key not in self._patterns:
            self._patterns[key] = wp.full(1, value, dtype=target.dtype, device="cpu")
        pattern = self._patterns[key]
        self._words += [self._codes.FILL, target.ptr or 0, pattern.ptr, pattern.strides[0], target.size]
        self._kept += [target, pattern]

    def refit(self, tree: wp.Bvh | wp.Mesh) -> None:
        """A call of Warp's own function."""
        runtime: Any = wp._src.context.runtime
        core = runtime.core
        function = core.wp_mesh_refit_host if isinstance(tree, wp.Mesh) else core.wp_bvh_refit_host
        self._words += [self._codes.APPLY, _address(function), tree.id]
        self._kept.append(tree)

    def repeat(self, count: int, body: Callable[[], None]) -> None:
        """So many times the body, written out until it is the same twice, as the first time may differ from the others;
        the rest is a loop."""
        before: list[int] | None = None
        for done in range(count):
            head = len(self._words)
            body()
            block = self._words[head:]
            if block == before:
                self._words[head:] = [self._codes.AGAIN, *[count - done + 1] * 2, _word(-len(block))]
                return
            before = block

    def repeat_while(self, condition: wp.array, body: Callable[[], None]) -> None:
        """A loop with the condition at its head."""
        head = len(self._words)
        exit_jump = self._jump_unless(condition)
        body()
        self._words += [self._codes.JUMP, _word(head - len(self._words))]
        self._lead_here(exit_jump)

    def only_if(
        self, condition: wp.array, body: Callable[[], None], otherwise: Callable[[], None] | None = None
    ) -> None:
        """A branch."""
        else_jump = self._jump_unless(condition)
        body()
        end_jump = len(self._words)
        self._words += [self._codes.JUMP, 0]
        self._lead_here(else_jump)
        if otherwise is not None:
            otherwise()
        self._lead_here(end_jump)

    def program(self) -> "Program":
        """All of it."""
        self._words.append(self._codes.END)
        return Program(self._words, self._kept, self._kernels, self._threads)

    def _jump_unless(self, condition: wp.array) -> int:
        """A jump, yet to be led somewhere; where it is."""
        jump = len(self._words)
        self._words += [self._codes.JUMP_UNLESS, 0, condition.ptr]
        self._kept.append(condition)
        return jump

    def _lead_here(self, jump: int) -> None:
        """Jumps say how far, not where to, so that the same work is the same words wherever it stands."""
        self._words[jump + 1] = len(self._words) - jump

    def _prepared(self, kernel: wp.Kernel, dim: int, arguments: Sequence[Any]) -> list[int]:
        """A launch as words: one range, or as many as there are threads, the last ones empty where there is too little.

        All offers then have equally many ranges, so whoever takes one of them knows that it is still the same offer.
        """
        ranged = runs_in_ranges(kernel)
        count = min(self._threads, dim) if ranged else 1
        words = [self._codes.CALL, 0, count]
        for k in range(count):
            first, last = dim * k // count, dim * (k + 1) // count
            inputs = [first, *arguments] if ranged else list(arguments)
            call = wp.launch(kernel, dim=last - first, inputs=inputs, device="cpu", record_cmd=True)
            values = call.params[1:]
            fields = [(f"_{k}", type(value)) for k, value in enumerate(values)]
            packed = type("Arguments", (ctypes.Structure,), {"_fields_": fields})(*values)
            self._kept += [call, packed]
            words[1] = _address(call.hooks.forward)
            words += [ctypes.addressof(call.bounds), ctypes.addressof(packed)]
        if count > 1:
            words[2] = self._threads
            words += [0, 0] * (self._threads - count)
        return words


class Program:
    """A recorded frame; :meth:`run` does it.

    Args:
        words: the program. kept: whatever it points to. kernels: the model's. threads: how many run it.
    """

    def __init__(self, words: Sequence[int], kept: Sequence[Any], kernels: KernelSet, threads: int):
        self._kept = kept
        self._words = wp.array(np.array(words, np.uint64), dtype=wp.uint64, device="cpu")
        codes, idle = kernels.program, _address(_idle_function())
        self._stop = codes.STOP
        self._table = wp.zeros(codes.CLAIMS + codes.LINE * threads, dtype=wp.uint64, device="cpu")
        self._shared = self._table.numpy()  # the same memory

        def call(kernel: wp.Kernel, *inputs: Any) -> wp.Launch:
            return wp.launch(kernel, 1, [*inputs, idle], [self._table], device="cpu", record_cmd=True)

        self._run = call(codes.run, self._words)
        self._helpers = [call(codes.help_along, k) for k in range(1, threads)]

    def run(self) -> None:
        """Once through the program; other programs that have helpers wait."""
        if not self._helpers:
            self._run.launch()
            return
        with _pool_lock:
            self._shared[:] = 0
            helping = []
            try:
                helping += [_pool(len(self._helpers)).submit(helper.launch) for helper in self._helpers]
                self._run.launch()
            finally:
                self._shared[self._stop] = 1  # if it was interrupted before it ran, say
                for one in helping:
                    one.result()


_pool_lock = threading.Lock()  # helpers of one program must not keep those of another waiting


@functools.cache
def _pool(count: int) -> ThreadPoolExecutor:
    """Threads kept for the life of the process."""
    return ThreadPoolExecutor(count, thread_name_prefix="warpcloth")


def _identity(argument: Any) -> Any:
    """What two arguments have in common if launches with them are the same: numbers, vectors and matrices their values,
    all else that it is the same object."""
    if isinstance(argument, ctypes.Array):
        return type(argument), bytes(argument)
    return id(argument) if hasattr(argument, "__dict__") else argument


def _word(value: int) -> int:
    """A number, negative ones too, as a word."""
    return value % 2**64


def _address(function: Any) -> int:
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


def _idle_function() -> Any:
    """What offers the core to other threads."""
    if sys.platform == "win32":
        return ctypes.windll.kernel32.SwitchToThread
    return ctypes.CDLL(None).sched_yield


if hasattr(os, "register_at_fork"):  # threads do not survive a fork
    os.register_at_fork(after_in_child=_pool.cache_clear)
