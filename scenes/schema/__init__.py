"""The schema of scene files: one pydantic model for each kind of table, from whole scene to single value."""

from .messages import explain, suggest
from .network import Network
from .scene import Scene

__all__ = ["Network", "Scene", "explain", "suggest"]
