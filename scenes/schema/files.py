"""Mesh files that a scene names."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from warpcloth.validate import at_home

from .values import Text

MeshPath = Annotated[
    str,
    Text("", "the path of a mesh file", 4096),
    Field(
        description="Mesh file: OBJ, PLY, STL, GLB or USD; relative to the scene file, or `warp:bunny.usd` for an "
        "asset of Warp's wheel. A USD file keeps its own axes and units and is converted."
    ),
]
PrimPath = Annotated[
    Annotated[str, Text("/.*", "a USD prim path such as '/root/bunny'", 4096)] | None,
    Field(default=None, description="In a USD file with several meshes: path of the mesh prim."),
]


def mesh_source(path: str, folder: Path) -> str:
    """What to load for a mesh path in a scene file that lies in ``folder``."""
    return path if path.startswith("warp:") else str(folder / at_home(path))
