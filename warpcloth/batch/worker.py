"""A worker: a process that simulates the jobs it is sent, and goes when its parent has gone."""

import multiprocessing
import os
import signal
import sys
import threading
import traceback
from multiprocessing.connection import Connection
from typing import Any

from ..errors import WarpclothError
from .folder import BatchFolder
from .job import Job, Outcome

ORPHANED = 1


def serve(connection: Connection, folder: str, gpu: int | None = None, threads: int = 1) -> None:
    """Runs in the worker's process: takes lists of sample numbers until the connection closes.

    Sends ``("alive", None)`` after each frame, ``("outcome", Outcome)`` for each sample, ``("idle", None)`` when it is
    ready for a job, and ``("broken", sentence)`` before it ends because nothing can be written any more.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent says what to do
    if gpu is not None:
        os.environ["CUDA_VISIBLE_DEVICES"] = str(gpu)
    threading.Thread(target=_go_with_parent, daemon=True).start()
    try:
        _serve(connection, BatchFolder(folder), threads)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        os._exit(ORPHANED)
    except WarpclothError as error:
        connection.send(("broken", str(error)))
    except OSError as error:
        connection.send(("broken", f"The batch cannot go on: {error}."))
    except BaseException as error:
        traceback.print_exc()
        connection.send(("broken", f"A worker has a defect ({type(error).__name__}: {error})."))


def _serve(connection: Connection, folder: BatchFolder, threads: int) -> None:
    sweep = folder.sweep
    quiet_warp()
    ready_kernels(sweep.base["simulation"])

    def on_frame() -> None:
        connection.send(("alive", None))

    def on_outcome(outcome: Outcome) -> None:
        connection.send(("outcome", outcome))

    while True:
        connection.send(("idle", None))
        Job(sweep, folder, on_frame, on_outcome, threads).run(connection.recv())


def quiet_warp() -> None:
    """Warp without its messages; there would be as many as workers."""
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    sys.stderr.flush()
    keep = os.dup(2)
    with open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(keep, 2)
            os.close(keep)


def ready_kernels(options: dict[str, Any]) -> None:
    """Has the kernels for a scene's ``[simulation]`` compiled, by this process or by another one on this machine."""
    from ..model import find_device
    from .compilation import compile_here

    device = find_device(None if options["device"] == "auto" else options["device"])
    compile_here([options["precision"]], device.alias)


def _go_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(ORPHANED)
