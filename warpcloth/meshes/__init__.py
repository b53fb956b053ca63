"""Triangle meshes from files."""

from .trianglemesh import TriangleMesh, cloth_mesh, load_mesh

__all__ = ["TriangleMesh", "cloth_mesh", "load_mesh"]
