"""A USD stage that cloths and colliders come from."""

from typing import Annotated, Literal

from pydantic import Field

from .fabric import FabricTable
from .table import Table, field
from .values import Rows, Text

PrimPaths = Annotated[tuple[str, ...], Rows(Text("/.*", "a USD prim path such as '/World/Shirt'", 4096), least=0)]


class StageTable(Table):
    """A USD stage whose meshes are the cloth and whose colliders are the obstacles; it is left as it is."""

    path: Annotated[
        str,
        Text(r".+\.usd[acz]?", "the path of a USD file (.usd, .usda, .usdc or .usdz)", 4096),
        Field(description="The stage; relative to the scene file. It has the defaults of frames, gravity, …"),
    ]
    cloth: PrimPaths = field(
        (), "Prims that are cloth, each a mesh or a parent of some; by default those that say so themselves."
    )
    collider: PrimPaths = field((), "Prims that cloth collides with, besides those that say so themselves.")
    fabric: FabricTable | None = field(None, "What all of its cloth is made of, in place of what its materials say.")
    springs: Literal["stretch", "shear", "fitted", "woven"] | None = field(
        None, "What the springs have of the fabric, see `springs` of a mesh; by default as `warpcloth:springs` says."
    )
