"""Rectangular cloth: a grid of vertices in the local xy plane, row by row, x fastest."""

from dataclasses import dataclass

import numpy as np

from ..fabric import Fabric
from .springs import BEND, SHEAR, STRUCTURAL, SpringNetwork

DIAGONALS = ("alternate", "same")


@dataclass(frozen=True)
class GridShape:
    """A grid of ``nx`` × ``ny`` vertices, ``width`` × ``height`` metres; vertex (i, j) has index j nx + i."""

    width: float
    height: float
    nx: int
    ny: int

    @property
    def cell(self) -> tuple[float, float]:
        """Edge lengths of a cell [m]."""
        return self.width / (self.nx - 1), self.height / (self.ny - 1)

    @property
    def index(self) -> np.ndarray:
        """Vertex indices, shape [ny, nx]."""
        return np.arange(self.nx * self.ny, dtype=np.int32).reshape(self.ny, self.nx)

    def uvs(self) -> np.ndarray:
        """Texture coordinates from (0, 0) at the lower left to (1, 1), shape [nx ny, 2]."""
        u, v = np.meshgrid(np.linspace(0.0, 1.0, self.nx), np.linspace(0.0, 1.0, self.ny))
        return np.stack([u.ravel(), v.ravel()], axis=1)

    def points(self) -> np.ndarray:
        """Vertices, centred on the origin [m], shape [nx ny, 3]."""
        flat = (self.uvs() - 0.5) * (self.width, self.height)
        return np.column_stack([flat, np.zeros(len(flat))])

    def triangles(self, diagonals: str) -> np.ndarray:
        """Two counter-clockwise triangles to a cell, shape [2 (nx−1) (ny−1), 3].

        "alternate" turns the diagonal from cell to cell like a chessboard, "same" draws it from lower left to upper
        right everywhere.
        """
        index = self.index
        a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
        rising = np.stack([a, b, c, a, c, d], axis=-1)
        if diagonals == "same":
            return rising.reshape(-1, 3)
        falling = np.stack([a, b, d, b, c, d], axis=-1)
        odd = np.add.outer(np.arange(self.ny - 1), np.arange(self.nx - 1)) % 2 == 1
        return np.where(odd[:, :, None], falling, rising).reshape(-1, 3)

    def masses(self, areal_density: float) -> np.ndarray:
        """A quarter of each cell's mass to its corners [kg], shape [nx ny].

        This is the mean of lumping thirds of triangles over both diagonals, and unlike either as symmetric as the grid.
        """
        dx, dy = self.cell
        return areal_density * np.outer(_owned(self.ny, dy), _owned(self.nx, dx)).ravel()

    def named_vertices(self) -> dict[str, np.ndarray]:
        """Edges and corners by name: left −x, right +x, bottom −y, top +y."""
        index = self.index
        edges = {"left": index[:, 0], "right": index[:, -1], "bottom": index[0], "top": index[-1]}
        corners = {f"{row}_{col}": np.intersect1d(edges[row], edges[col]) for row in _ROWS for col in _COLUMNS}
        return edges | corners

    def springs(self, points: np.ndarray, fabric: Fabric) -> SpringNetwork:
        """Structural, shear and bend springs for a fabric; at rest at ``points``.

        Per area, springs along x add k_x/dy to the tensor component C_xx of the sheet, the two diagonals of length d
        add k_d 2 dx dy/d³ to C_xyxy, and so on. Asking for Young's modulus Y along x and y and shear modulus G gives
        k_d = G d³/(2 dx dy), k_x = dy (C − G dx²/dy²), k_y = dx (C − G dy²/dx²) with C = (Y + √(Y² + 4 G²))/2; for
        square cells k_x = a (C − G) and k_d = √2 a G. Springs on the border own half a cell and have half of it.
        Where cells are so long that k_x or k_y would vanish, G is lowered and Y kept.
        """
        dx, dy = self.cell
        stretch, shear = sheet_moduli(fabric, max(dx / dy, dy / dx))
        index, width_x, width_y = self.index, _owned(self.ny, dy)[:, None], _owned(self.nx, dx)[None, :]
        diagonal = np.hypot(dx, dy) ** 3 / (2.0 * dx * dy)
        families = [
            (index[:, :-1], index[:, 1:], (stretch - shear * (dx / dy) ** 2) * width_x, STRUCTURAL),
            (index[:-1], index[1:], (stretch - shear * (dy / dx) ** 2) * width_y, STRUCTURAL),
            (index[:-1, :-1], index[1:, 1:], shear * diagonal, SHEAR),
            (index[:-1, 1:], index[1:, :-1], shear * diagonal, SHEAR),
            (index[:, :-2], index[:, 2:], fabric.bend_stiffness * width_x, BEND),
            (index[:-2], index[2:], fabric.bend_stiffness * width_y, BEND),
        ]
        parts = []
        for start, end, stiffness, kind in families:
            k_s = np.broadcast_to(stiffness, start.shape).ravel()
            if k_s.size and k_s.max() > 0.0:
                pairs = np.stack([start.ravel(), end.ravel()], axis=1)
                parts.append(SpringNetwork.from_pairs(pairs, points, k_s, kind, fabric.damping_time))
        return SpringNetwork.joined(parts)


def sheet_moduli(fabric: Fabric, aspect: float) -> tuple[float, float]:
    """Tensor components (C_xx, G) [N/m] that a grid with cells ``aspect`` >= 1 times as long as wide can have.

    Long springs keep at least the share f = (1 − aspect⁻⁴)/10 of C_xx, which bounds G by (1 − f) C_xx/aspect².
    """
    young, shear = fabric.stretch_stiffness, fabric.shear_stiffness
    share = (1.0 - 0.1 * (1.0 - aspect**-4)) / aspect**2
    if share < 1.0:
        shear = min(shear, share * young / (1.0 - share**2))
    return 0.5 * (young + np.hypot(young, 2.0 * shear)), shear


def _owned(count: int, spacing: float) -> np.ndarray:
    """Width that each line of a grid stands for: a cell, half a cell at both ends [m]."""
    widths = np.full(count, spacing)
    widths[[0, -1]] *= 0.5
    return widths


_ROWS, _COLUMNS = ("bottom", "top"), ("left", "right")
