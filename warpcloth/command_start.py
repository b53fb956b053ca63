"""Ctrl-C while the command line is still being loaded: one sentence and exit code 130, as later.

Python's own answer, an exception, has nobody to catch it yet, and OpenUSD's modules swallow one that falls into their
import. Nothing is begun before a command has what it needs, so the process may end on the spot.
"""

import os
import signal
import sys
import threading
from pathlib import Path
from types import FrameType

JSON = b'{\n  "error": "interrupted.",\n  "exit_code": 130\n}\n'


def is_command() -> bool:
    """Whether this process was started as ``warpcloth`` or ``python -m warpcloth``, rather than by another program.

    Workers were not: they have the arguments of the command in ``sys.argv`` only.
    """
    words = sys.orig_argv[1:3]
    return words == ["-m", "warpcloth"] or any(Path(word).stem == "warpcloth" for word in words[:1])


def begin() -> None:
    """Let Ctrl-C end the process at once, where that is not somebody else's to decide."""
    main = threading.current_thread() is threading.main_thread()
    if main and is_command() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)


def done() -> None:
    """Leave Ctrl-C to Python again."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _leave(number: int, frame: FrameType | None) -> None:
    os.write(2, b"warpcloth: interrupted.\n")
    if "--json" in sys.argv:
        os.write(1, JSON)
    os._exit(130)


begin()
