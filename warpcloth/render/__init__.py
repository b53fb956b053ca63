"""Pictures and films of USD caches: smooth cloth in a studio, with soft shadows (extra ``render``).

Light is gathered by rays that Warp traces, at the vertices; VTK, by way of pyvista, draws what is seen.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .pictures import RenderResult, render

__all__ = ["RenderResult", "render"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(".pictures", __name__), name)
