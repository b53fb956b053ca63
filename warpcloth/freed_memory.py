"""Memory that building a simulation has freed goes back to the system.

Arrays are computed from larger ones that are freed at once. The C library of Linux keeps such memory for later, and a
simulation, which never asks for so much again, would seem to need up to twice as much as it does.
"""

import ctypes
import functools
from collections.abc import Callable


def return_freed_memory() -> None:
    """Gives back what the C library keeps, where it is glibc; a millisecond for 16,000 particles."""
    _trim()(0)


@functools.cache
def _trim() -> Callable[[int], int]:
    """glibc's ``malloc_trim``; elsewhere what does nothing, as other allocators give memory back by themselves."""
    try:
        return ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):  # another libc; none that is found; Windows, where None is no name
        return lambda _pad: 0
