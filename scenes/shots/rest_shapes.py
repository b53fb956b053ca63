"""What a mesh was before it became triangles: grids and discs have springs that a mesh alone does not tell.

The note counts as long as the mesh has the points and triangles of such a shape; where its points lie is up to the
stage, so a grid may start crumpled.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from warpcloth.cloth import Cloth
from warpcloth.errors import UsdError

from ..usd.rigid import split
from .notes import doubles, note, noted

RIGID = 1e-9  # how far from 1 a scale is that nobody has asked for


@dataclass(frozen=True)
class RestShape:
    """A grid or disc in its own xy plane.

    Args:
        kind: "grid" or "disc".
        size: width and height, or radius [m].
        resolution: vertices along x and y, or rings.
    """

    kind: str
    size: tuple[float, ...]
    resolution: tuple[int, ...]

    @property
    def vertices(self) -> int:
        """Number of vertices."""
        first = self.resolution[0]
        return first * self.resolution[1] if self.kind == "grid" else 1 + 3 * first * (first + 1)

    def write(self, prim: Usd.Prim) -> None:
        """Notes the shape on a mesh."""
        note(prim, "shape", self.kind, Sdf.ValueTypeNames.Token)
        note(prim, "size", doubles(self.size), Sdf.ValueTypeNames.DoubleArray)
        note(prim, "resolution", list(self.resolution), Sdf.ValueTypeNames.IntArray)

    def cloth(
        self, prim: Usd.Prim, matrix: np.ndarray, triangles: np.ndarray, springs: str, options: dict[str, Any]
    ) -> Cloth | None:
        """The cloth of this shape, placed by ``matrix``; None where that mirrors, shears or unrounds it.

        Discs have ``springs`` as :meth:`warpcloth.Cloth.from_mesh` has; grids have their own.

        Raises:
            UsdError: the mesh has other triangles.
        """
        placed = self._placed(matrix)
        if placed is None:
            return None
        size, rigid = placed
        if self.kind == "grid":
            cloth = Cloth.grid(size=size, resolution=self.resolution, transform=rigid, **options)
        else:
            cloth = Cloth.disc(size[0], self.resolution[0], transform=rigid, springs=springs, **options)
        if not np.array_equal(cloth.triangles, triangles):
            what = f"a {self.kind} of resolution {' × '.join(map(str, self.resolution))}"
            rule = "remove its attribute warpcloth:shape if its mesh has changed"
            raise UsdError(f"Cloth {prim.GetPath()} says that it is {what}, but has other triangles; {rule}.")
        return cloth

    def _placed(self, matrix: np.ndarray) -> tuple[tuple[float, ...], np.ndarray] | None:
        """Its size under ``matrix``, and what is left of that: a rigid one."""
        frame = split(matrix)
        if frame is None or np.linalg.det(matrix[:3, :3]) < 0.0:
            return None
        if np.abs(frame.scales - 1.0).max() < RIGID:
            return self.size, matrix
        if self.kind == "disc" and abs(frame.scales[0] - frame.scales[1]) > 1e-6 * frame.scales[0]:
            return None
        rigid = matrix.copy()
        rigid[:3, :3] = frame.rotation
        return tuple(length * scale for length, scale in zip(self.size, frame.scales, strict=False)), rigid


def read_rest_shape(prim: Usd.Prim) -> RestShape | None:
    """The shape noted on a mesh, or None.

    Raises:
        UsdError: it is none that there is.
    """
    kind = noted(prim, "shape")
    if kind is None:
        return None
    size, resolution = tuple(noted(prim, "size") or ()), tuple(noted(prim, "resolution") or ())
    wanted = {"grid": 2, "disc": 1}.get(kind)
    if wanted is None or len(size) != wanted or len(resolution) != wanted:
        raise UsdError(f"Cloth {prim.GetPath()} has a warpcloth:shape that is neither a whole 'grid' nor a 'disc'.")
    return RestShape(kind, size, resolution)
