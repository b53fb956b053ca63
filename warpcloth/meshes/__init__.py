"""Triangle meshes from files, checked."""

from .assets import resolve_asset
from .load import load_mesh, read_mesh
from .trianglemesh import TriangleMesh, cloth_mesh, obstacle_mesh

__all__ = ["TriangleMesh", "cloth_mesh", "load_mesh", "obstacle_mesh", "read_mesh", "resolve_asset"]
