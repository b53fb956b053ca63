"""Ctrl-C while the command line is still being loaded: one sentence and exit code 130, as later.

Python's own answer, an exception, has nobody to catch it yet. Nothing is begun before a command has what it needs, so
the process may end on the spot. Later on it is an exception, but never within an import: OpenUSD's modules and trimesh
catch, and forget, whatever falls into theirs.
"""

import _thread
import os
import signal
import sys
import threading
import time
from pathlib import Path
from types import FrameType

AGAIN = 0.02  # [s] until Ctrl-C is tried once more
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
    """From now on there is somebody to catch an exception."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, interrupt)


def interrupt(number: int, frame: FrameType | None) -> None:
    """The answer to a signal, as Python's own, but not before a module that is being imported is there.

    Raises:
        KeyboardInterrupt: no import is under way.
    """
    if not _within_import(frame):
        raise KeyboardInterrupt
    _thread.start_new_thread(_send_again, (number,))  # threading's locks may be held by what is interrupted here


def _within_import(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib."):
            return True
        frame = frame.f_back
    return False


def _send_again(number: int) -> None:
    time.sleep(AGAIN)
    if hasattr(signal, "pthread_kill"):  # ends a wait of the main thread, too, by when it has come to one
        signal.pthread_kill(threading.main_thread().ident or 0, number)
    else:
        _thread.interrupt_main(signal.Signals(number))


def _leave(number: int, frame: FrameType | None) -> None:
    os.write(2, b"warpcloth: interrupted.\n")
    if "--json" in sys.argv:
        os.write(1, JSON)
    os._exit(130)


begin()
