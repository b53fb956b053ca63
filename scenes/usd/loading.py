"""OpenUSD's modules, which swallow a Ctrl-C that falls into their import; so it waits until they are there."""

import importlib
import signal
import threading

MODULES = ("Ar", "Gf", "Kind", "Sdf", "Tf", "Usd", "UsdGeom", "UsdPhysics", "UsdShade", "UsdSkel", "UsdUtils", "Vt")


def load_openusd() -> None:
    """Imports what the modules of this package and its neighbours need of OpenUSD."""
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGINT) is None:
        _load()
        return
    made: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, frame: made.append(number))
    try:
        _load()
    finally:
        signal.signal(signal.SIGINT, handler)
    if made:
        signal.raise_signal(signal.SIGINT)


def _load() -> None:
    for name in MODULES:
        importlib.import_module(f"pxr.{name}")
