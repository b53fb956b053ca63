"""USD caches: write them while simulating, check them afterwards, read their obstacles back.

OpenUSD is loaded on first use of a name below, not when this package is imported.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .loading import load_openusd

if TYPE_CHECKING:
    from .check import check_cache
    from .obstacle_reader import read_obstacles
    from .report import CheckReport, ClothCheck
    from .writer import CacheWriter

__all__ = ["CacheWriter", "CheckReport", "ClothCheck", "check_cache", "read_obstacles"]

_HOMES = {
    "CacheWriter": "writer",
    "CheckReport": "report",
    "ClothCheck": "report",
    "check_cache": "check",
    "read_obstacles": "obstacle_reader",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    load_openusd()
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)
