"""Scene files, the scenes that come with warpcloth, and the way from a scene to a USD cache.

What touches OpenUSD or a device is loaded on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .load import bundled_scenes, load_scene, scene_from_toml
from .schema import Network, Scene
from .usd.loading import load_openusd

if TYPE_CHECKING:
    from .result import SimulationResult
    from .run import simulate
    from .shots.export import export_scene
    from .usd import CacheWriter, CheckReport, check_cache

_LAZY = {
    "CacheWriter": ".usd",
    "CheckReport": ".usd",
    "SimulationResult": ".result",
    "check_cache": ".usd",
    "export_scene": ".shots.export",
    "simulate": ".run",
}

__all__ = [
    "CacheWriter",
    "CheckReport",
    "Network",
    "Scene",
    "SimulationResult",
    "bundled_scenes",
    "check_cache",
    "export_scene",
    "load_scene",
    "scene_from_toml",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        load_openusd()
        return getattr(import_module(_LAZY[name], __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
