"""How steps ask for work on the device: launched at once, or recorded into a program for the CPU.

All that runs within a frame goes through these functions, which otherwise do what Warp's functions of the same kind do.
A kernel whose first argument is ``thread_offset`` may run in ranges at the same time, its threads being numbered from
there: each writes only what is its own, or counts with ``kernels/counting.py``. Callers leave ``thread_offset`` out.
"""

import functools
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar

import warp as wp


class _Recording(threading.local):
    recorder: Any = None  # a warpcloth.program.ProgramWriter, which is built on this module


_recording = _Recording()

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
_gate = threading.Condition()
_launching: list[int] = []  # threads within calls that launch


def launches(call: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Marks what launches: it waits while another thread records a graph, and lets none begin to.

    Warp (1.19) puts what *any* thread launches on a device into the graph that is being captured there.
    """

    @functools.wraps(call)
    def marked(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        thread = threading.get_ident()
        with _gate:
            _launching.append(thread)
        try:
            return call(*arguments, **options)
        finally:
            with _gate:
                _launching.remove(thread)
                _gate.notify_all()

    return marked


def launches_alone(call: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Marks what launches under a tape: it waits until no other thread launches, and all others wait for its end.

    Warp (1.19) has one tape for the process, which holds what *any* thread launches.
    """

    @functools.wraps(call)
    def marked(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        with _gate:
            _gate.wait_for(lambda: set(_launching) <= {threading.get_ident()})
            return call(*arguments, **options)

    return marked


@contextmanager
def alone() -> Iterator[bool]:
    """Nothing that is marked so begins to launch inside; yields whether nothing else does so already."""
    with _gate:
        yield set(_launching) <= {threading.get_ident()}


@contextmanager
def recording(recorder: Any) -> Iterator[None]:
    """What is asked for inside, by this thread, is recorded instead."""
    _recording.recorder = recorder
    try:
        yield
    finally:
        _recording.recorder = None


def runs_in_ranges(kernel: wp.Kernel) -> bool:
    """Whether ranges of the kernel may run at the same time."""
    arguments = kernel.adj.args
    return bool(arguments) and arguments[0].label == "thread_offset"


def records(item: Any) -> bool:
    """Whether all launches of a hook or force go through this module, as its own class says, not one it builds on."""
    return bool(vars(type(item)).get("launches_recorded", False))


def launch(
    kernel: wp.Kernel,
    dim: int,
    inputs: Sequence[Any],
    outputs: Sequence[Any] = (),
    device: Any = None,
    record_tape: bool = True,
) -> None:
    """``wp.launch`` with ``dim`` threads."""
    if _recording.recorder is not None:
        _recording.recorder.launch(kernel, dim, [*inputs, *outputs])
        return
    inputs = [*([0] if runs_in_ranges(kernel) else []), *inputs]
    wp.launch(kernel, dim=dim, inputs=inputs, outputs=list(outputs), device=device, record_tape=record_tape)


def copy(target: wp.array, source: wp.array, count: int = 0) -> None:
    """``wp.copy`` of contiguous arrays: the first ``count`` elements, 0: all."""
    if _recording.recorder is not None:
        _recording.recorder.copy(target, source, count or source.size)
    else:
        wp.copy(target, source, count=count)


def fill(target: wp.array, value: Any = 0) -> None:
    """Sets all elements of a contiguous array."""
    if _recording.recorder is not None:
        _recording.recorder.fill(target, value)
    else:
        target.fill_(value)


def refit(tree: wp.Bvh | wp.Mesh) -> None:
    """Fits a tree to what has moved."""
    if _recording.recorder is not None:
        _recording.recorder.refit(tree)
    else:
        tree.refit()


def repeat(count: int, body: Callable[[], None]) -> None:
    """The body ``count`` times; once it does the same twice, a recorder takes it that it goes on doing so."""
    if _recording.recorder is not None:
        _recording.recorder.repeat(count, body)
        return
    for _ in range(count):
        body()


def repeat_while(condition: wp.array, body: Callable[[], None]) -> None:
    """``wp.capture_while``: the body again and again while ``condition[0]``, int32, is not 0."""
    if _recording.recorder is not None:
        _recording.recorder.repeat_while(condition, body)
    else:
        wp.capture_while(condition, body)


def only_if(condition: wp.array, body: Callable[[], None], otherwise: Callable[[], None] | None = None) -> None:
    """``wp.capture_if``: the body if ``condition[0]``, int32, is not 0."""
    if _recording.recorder is not None:
        _recording.recorder.only_if(condition, body, otherwise)
    else:
        wp.capture_if(condition, on_true=body, on_false=otherwise)
