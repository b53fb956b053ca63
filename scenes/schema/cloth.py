"""Cloths of a scene: one table for each shape."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from warpcloth.cloth import Cloth, Inflation
from warpcloth.cloth.inflation import STANDARD_ATMOSPHERE
from warpcloth.transforms import placement

from .fabric import FabricTable
from .files import MeshPath, PrimPath, mesh_source
from .pin import PinTable
from .table import Table, field
from .values import MOST_VERTICES, Name, Number, Point, Speed, Turn, Vector, at_least_zero, positive, refuse


class ClothTable(Table):
    """What all cloths have in common."""

    name: Name | None = field(None, "Name in the USD file; by default `cloth`, numbered if there are several.")
    position: Point = field((0.0, 0.0, 0.0), "Where the shape's origin goes.")
    rotation: Turn = field(
        (0.0, 0.0, 0.0), "Rotation vector (axis times angle) about the shape's origin: `[90, 0, 0]` turns 90° about x."
    )
    fabric: FabricTable = field(FabricTable(), "What it is made of.")
    pins: list[PinTable] = Field([], description="Points that are held or led.", max_length=10_000)
    velocity: Speed = field((0.0, 0.0, 0.0), "Velocity at the start.")
    jitter: Annotated[float, at_least_zero("m", 1.0)] = field(
        0.0,
        "Standard deviation of random displacements of the start positions, drawn from the scene's seed; "
        "breaks the symmetry of a perfect start. Pinned points stay.",
    )

    def build(self, name: str, folder: Path) -> Cloth:
        """The simulator's cloth.

        Args:
            name: Name to give it.
            folder: Folder that relative mesh paths start from.
        """
        return self.shaped(
            folder,
            {
                "name": name,
                "fabric": self.fabric.build(),
                "pins": [pin.build() for pin in self.pins],
                "transform": placement(self.position, np.radians(self.rotation), getattr(self, "scale", 1.0)),
                "velocity": self.velocity,
            },
        )

    def shaped(self, folder: Path, common: dict[str, Any]) -> Cloth:
        """The cloth of this shape, given what it has in common with the others."""
        raise NotImplementedError


SPRINGS = (
    "What the springs have of the fabric: its `stretch` stiffness (shear follows), its `shear` stiffness (stretch "
    "follows; for the drape of woven fabrics), or all of it: `woven`, along the yarns inside triangles, on any mesh; "
    "`fitted`, between vertices, for knits and for schemes that only solve springs between vertices."
)


class GridTable(ClothTable):
    """A rectangle in the xy plane, centred on its origin."""

    shape: Literal["grid"] = field(..., '`"grid"`')
    size: Annotated[tuple[float, float], Vector("width height", positive("m"))] = field(
        (1.0, 1.0), "Width along x and height along y."
    )
    resolution: Annotated[tuple[int, int], Vector("nx ny", Number("", 2, MOST_VERTICES, whole=True))] = field(
        (33, 33), "Vertices along x and y."
    )

    @property
    def vertices(self) -> int:
        """Number of vertices."""
        return self.resolution[0] * self.resolution[1]

    @model_validator(mode="after")
    def _not_too_many(self) -> Self:
        if self.vertices > MOST_VERTICES:
            raise refuse(
                f"must have a resolution of at most {MOST_VERTICES:,} vertices, and "
                f"{self.resolution[0]} by {self.resolution[1]} are {self.vertices:,}"
            )
        return self

    def shaped(self, folder: Path, common: dict[str, Any]) -> Cloth:
        return Cloth.grid(size=self.size, resolution=self.resolution, **common)


class DiscTable(ClothTable):
    """A round cloth in the xy plane, centred on its origin."""

    shape: Literal["disc"] = field(..., '`"disc"`')
    radius: Annotated[float, positive("m")] = field(0.5, "Radius.")
    resolution: Annotated[int, Number("", 1, 1000, whole=True)] = field(
        16, "Rings of vertices between the centre and the edge."
    )
    springs: Literal["stretch", "shear", "fitted", "woven"] = field("stretch", SPRINGS)

    @property
    def vertices(self) -> int:
        """Number of vertices: the centre, and six more in each ring than in the one before."""
        return 1 + 3 * self.resolution * (self.resolution + 1)

    def shaped(self, folder: Path, common: dict[str, Any]) -> Cloth:
        return Cloth.disc(radius=self.radius, resolution=self.resolution, springs=self.springs, **common)


class InflationTable(Table):
    """What is inside a closed cloth."""

    pressure: Annotated[float, Number("Pa", -1e7, 1e7)] = field(..., "Pressure over that outside, at rest.")
    gas: bool = field(
        False, "Whether a fixed amount of gas is shut in, whose pressure falls as it expands; or the pressure stays."
    )
    ambient: Annotated[float, positive("Pa", 1e9)] = field(STANDARD_ATMOSPHERE, "Pressure outside; a gas needs it.")

    def build(self) -> Inflation:
        """The simulator's inflation."""
        return Inflation(**dict(self))


class MeshClothTable(ClothTable):
    """A cloth whose rest shape is a triangle mesh read from a file."""

    shape: Literal["mesh"] = field(..., '`"mesh"`')
    path: MeshPath
    prim: PrimPath
    scale: Annotated[float, positive("", 1e6)] = field(1.0, "Scale about the file's origin.")
    springs: Literal["stretch", "shear", "fitted", "woven"] = field("stretch", SPRINGS)
    inflation: InflationTable | None = field(None, "Pressure inside a mesh that is closed.")

    def shaped(self, folder: Path, common: dict[str, Any]) -> Cloth:
        inflation = None if self.inflation is None else self.inflation.build()
        options: dict[str, Any] = {"prim": self.prim, "springs": self.springs, "inflation": inflation}
        return Cloth.from_mesh(mesh_source(self.path, folder), **options, **common)


CLOTHS = (GridTable, DiscTable, MeshClothTable)
