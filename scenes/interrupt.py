"""Ctrl-C that waits until the frame in hand is finished and written."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

from warpcloth.command_start import interrupt

SIGNALS = (signal.SIGINT, signal.SIGTERM)
DEFAULTS = (signal.default_int_handler, signal.SIG_DFL, interrupt)


class StopRequest:
    """Whether the user, or the system, has asked to stop.

    Attributes:
        made: whether it was asked for.
        waits: whether there is something to finish first; if not, and if asked again, the request interrupts at once.
    """

    def __init__(self) -> None:
        self.made = False
        self.waits = False

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self.made or not self.waits:
            interrupt(number, frame)
        else:
            self.made = True


@contextlib.contextmanager
def stop_on_interrupt() -> Iterator[StopRequest]:
    """Note SIGINT and SIGTERM instead of dying of them, so that neither falls into the middle of a frame or a write.

    Signals reach the main thread only, and only those are taken that nobody else has claimed.
    """
    request = StopRequest()
    main = threading.current_thread() is threading.main_thread()
    taken = {number: signal.getsignal(number) for number in SIGNALS if main and signal.getsignal(number) in DEFAULTS}
    for number in taken:
        signal.signal(number, request._on_signal)
    try:
        yield request
    finally:
        for number, handler in taken.items():
            signal.signal(number, handler)
