"""The two streams: results on stdout, everything else (progress, warnings, Warp's own chatter) on stderr."""

import contextlib
import io
import os
import sys
import warnings
from collections.abc import Iterator
from typing import Any, TextIO

from rich.console import Console

from ..errors import ContactWarning, ConvergenceWarning, FabricWarning, MeshWarning, MixedBatchWarning, StabilityWarning

OURS = (ContactWarning, ConvergenceWarning, FabricWarning, MeshWarning, MixedBatchWarning, StabilityWarning)


def messages() -> Console:
    """Console on stderr, for progress and remarks."""
    return plain_console(stderr=True, soft_wrap=True)


def plain_console(**options: Any) -> Console:
    """Console that writes text as it is: brackets and colons in a path are no markup and no emoji."""
    return Console(markup=False, emoji=False, highlight=False, **options)


def open_streams() -> None:
    """Give the process the streams that it was started without, as by ``>&-``, and let stdout take any character.

    Where a terminal or a pipe is not UTF-8, what its encoding lacks is written as on stderr: ``\\u03c9``.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:  # else the next file that is opened would be taken for the stream
            os.open(os.devnull, os.O_RDWR)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper) and not is_unicode(sys.stdout):
        sys.stdout.reconfigure(errors="backslashreplace")


def is_unicode(stream: TextIO) -> bool:
    """Whether a stream can take any character."""
    return (getattr(stream, "encoding", None) or "utf-8").lower().startswith("utf")


@contextlib.contextmanager
def stdout_for_results() -> Iterator[TextIO]:
    """Send to stderr what anything, native code included, writes to stdout, and yield the real stdout.

    Warp prints from Python and from C++, and compilers print what they like; a program that reads our JSON must not.
    """
    results = sys.stdout
    results.flush()
    with contextlib.redirect_stdout(sys.stderr), _redirected(1, 2):
        yield results


@contextlib.contextmanager
def warnings_as_lines() -> Iterator[None]:
    """Show warpcloth's own warnings as one line on stderr each, once, without the place in the code."""
    shown = set()

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if issubclass(category, OURS):
            if str(message) not in shown:
                messages().print(f"warpcloth: {message}")
            shown.add(str(message))
        else:
            usual(message, category, filename, lineno, file, line)

    with warnings.catch_warnings():
        usual = warnings.showwarning
        warnings.showwarning = show
        for kind in OURS:
            warnings.simplefilter("always", kind)
        yield


@contextlib.contextmanager
def quiet_warp(wanted: bool = True) -> Iterator[None]:
    """Keep Warp from reporting devices, caches and every kernel module; errors it still reports."""
    import warp as wp

    before = wp.config.log_level
    wp.config.log_level = wp.LOG_ERROR if wanted else before
    try:
        yield
    finally:
        wp.config.log_level = before


def start_warp() -> None:
    """Initialise Warp; where it is to be quiet, without its notice on stderr that there is no CUDA driver."""
    import warp as wp

    if wp.config.log_level < wp.LOG_ERROR:
        wp.init()
        return
    with open(os.devnull, "wb") as nothing, _redirected(2, nothing.fileno()):
        wp.init()


@contextlib.contextmanager
def _redirected(descriptor: int, target: int) -> Iterator[None]:
    """Let one file descriptor lead where another does, for native code too."""
    try:
        original = os.dup(descriptor)
    except OSError:  # there is no such descriptor, e.g. under pythonw
        yield
        return
    try:
        os.dup2(target, descriptor)
        yield
    finally:
        os.dup2(original, descriptor)
        os.close(original)
