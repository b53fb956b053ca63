"""Ctrl-C that waits until the frame in hand is finished and written."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType


class StopRequest:
    """Whether the user has asked to stop."""

    def __init__(self) -> None:
        self.made = False

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        """Note the first request; a second one interrupts at once."""
        if self.made:
            raise KeyboardInterrupt
        self.made = True


@contextlib.contextmanager
def stop_on_interrupt() -> Iterator[StopRequest]:
    """Note Ctrl-C instead of raising, so that it never falls into the middle of a frame or of a write.

    Signals reach the main thread only, and only while nobody else has taken them; elsewhere this does nothing.
    """
    request = StopRequest()
    ours = threading.current_thread() is threading.main_thread() and (
        signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if not ours:
        yield request
        return
    signal.signal(signal.SIGINT, request._on_signal)
    try:
        yield request
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
