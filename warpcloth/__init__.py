"""warpcloth: cloth simulation on NVIDIA Warp.

``import warpcloth as wc``; the names below are the public surface. Everything is in SI units, Z up.
"""

from typing import Any

from . import command_start as command_start  # before whatever takes time

# isort: split
from . import errors
from .air import Air
from .cloth import Cloth, Inflation, pin, pin_box, pin_nearest
from .contact import ContactPlanes
from .errors import WarpclothError
from .fabric import Fabric
from .fabric_library import fabrics, library_fabric
from .forces import AppliedForce, UserForce
from .grab import Grab, GrabTape
from .hooks import Hook
from .integrators import integrators
from .model import Model
from .motion import Motion
from .obstacles import Box, Capsule, MeshObstacle, Plane, Sphere
from .simulation import Simulation
from .state import Memory, State

__version__ = "0.1.0"

_SCENE_LAYER = ("load_scene", "simulate")

__all__ = [
    "Air", "AppliedForce", "Box", "Capsule", "Cloth", "ContactPlanes", "Fabric", "Grab", "GrabTape", "Hook",
    "Inflation", "Memory", "MeshObstacle", "Model", "Motion", "Plane", "Simulation", "Sphere", "State", "UserForce",
    "WarpclothError", "errors", "fabrics", "integrators", "library_fabric", "load_scene", "pin", "pin_box",
    "pin_nearest", "simulate",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """``load_scene`` and ``simulate`` live in the scene layer, which is imported only when asked for."""
    if name in _SCENE_LAYER:
        from . import scenes

        return getattr(scenes, name)
    raise AttributeError(f"module 'warpcloth' has no attribute {name!r}")
