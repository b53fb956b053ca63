"""Rectangular cloth: a grid of vertices in the local xy plane, row by row, x fastest."""

import warnings
from dataclasses import dataclass

import numpy as np

from ..errors import FabricWarning
from ..fabric import Fabric
from .sheet import sheet_tensor
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

    @property
    def owned(self) -> tuple[np.ndarray, np.ndarray]:
        """Widths that each column and each row stand for: a cell, half a cell at both ends [m]."""
        dx, dy = self.cell
        return _owned(self.nx, dx), _owned(self.ny, dy)

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

    def corner_share(self, triangles: np.ndarray) -> np.ndarray:
        """Shares of the corners in a triangle's mass that make up :meth:`masses`: a half at the right angle, and
        quarters at the ends of the cell's diagonal, shape [m, 3]."""
        column, row = triangles % self.nx, triangles // self.nx
        same_column = np.sum(column[:, :, None] == column[:, None, :], axis=2) == 2
        same_row = np.sum(row[:, :, None] == row[:, None, :], axis=2) == 2
        return np.where(same_column & same_row, 0.5, 0.25)

    def named_vertices(self) -> dict[str, np.ndarray]:
        """Edges and corners by name: left −x, right +x, bottom −y, top +y."""
        index = self.index
        edges = {"left": index[:, 0], "right": index[:, -1], "bottom": index[0], "top": index[-1]}
        corners = {f"{row}_{col}": np.intersect1d(edges[row], edges[col]) for row in _ROWS for col in _COLUMNS}
        return edges | corners

    def springs(self, points: np.ndarray, fabric: Fabric) -> SpringNetwork:
        """Structural, shear and bend springs for a fabric with its warp along x; at rest at ``points``.

        Per area, springs along x add k_x/dy to the tensor component C_xx of the sheet, the two diagonals of length d
        add k_d 2 dx dy/d³ to C_xyxy, and so on. Asking for Young's moduli Y_x and Y_y and shear modulus G gives
        k_d = G d³/(2 dx dy), k_x = dy (C_xx − G dx²/dy²), k_y = dx (C_yy − G dy²/dx²), the C of :func:`sheet_tensor`;
        for square cells k_x = a (C_xx − G) and k_d = √2 a G. Springs on the border own half a cell and have half of it.
        What is added to k_x and k_y beyond a strain limit is for every shape of cells what it is for square ones.

        Warns:
            FabricWarning: cells are so long that k_x or k_y would vanish; G is lowered and Y kept.
        """
        dx, dy = self.cell
        shear = min(fabric.shear_stiffness, self.largest_shear(fabric))
        if shear < fabric.shear_stiffness:
            _warn_of_long_cells(fabric, shear, max(dx / dy, dy / dx))
        c_x, c_y = sheet_tensor(fabric.stretch, shear)
        index, width_x, width_y = self.index, _owned(self.ny, dy)[:, None], _owned(self.nx, dx)[None, :]
        diagonal = np.hypot(dx, dy) ** 3 / (2.0 * dx * dy)
        per_width = c_x - shear * (dx / dy) ** 2, c_y - shear * (dy / dx) ** 2
        beyond = (fabric.beyond_limit * square / (c_x - shear) for square in (c_x - shear, c_y - shear))
        share_x, share_y = (added / own for added, own in zip(beyond, per_width, strict=True))
        families = [
            (index[:, :-1], index[:, 1:], per_width[0] * width_x, STRUCTURAL, share_x),
            (index[:-1], index[1:], per_width[1] * width_y, STRUCTURAL, share_y),
            (index[:-1, :-1], index[1:, 1:], shear * diagonal, SHEAR, 0.0),
            (index[:-1, 1:], index[1:, :-1], shear * diagonal, SHEAR, 0.0),
            (index[:, :-2], index[:, 2:], fabric.bend_stiffness * width_x, BEND, 0.0),
            (index[:-2], index[2:], fabric.bend_stiffness * width_y, BEND, 0.0),
        ]
        parts = []
        for start, end, stiffness, kind, share in families:
            k_s = np.broadcast_to(stiffness, start.shape).ravel()
            if k_s.size and k_s.max() > 0.0:
                pairs = np.stack([start.ravel(), end.ravel()], axis=1)
                parts.append(SpringNetwork.from_pairs(pairs, points, k_s, kind, fabric.damping_time, share))
        return SpringNetwork.joined(parts)

    def largest_shear(self, fabric: Fabric) -> float:
        """Largest shear modulus G [N/m] that springs of these cells can give a fabric of these stretch moduli.

        Structural springs must keep at least the share f = (1 − aspect⁻⁴)/10 of C_xx and C_yy. With q = r²/((1 − f) Y),
        r the aspect along Y, that is G (q² − 1/(Y_x Y_y)) <= q.
        """
        dx, dy = self.cell
        keep = 1.0 - 0.1 * (1.0 - min(dx / dy, dy / dx) ** 4)
        product, bounds = fabric.stretch[0] * fabric.stretch[1], [np.inf]
        for young, aspect in zip(fabric.stretch, (dx / dy, dy / dx), strict=True):
            q = aspect * aspect / (keep * young)
            if q * q > (1.0 + 1e-12) / product:
                bounds.append(q / (q * q - 1.0 / product))
        return float(min(bounds))


def _warn_of_long_cells(fabric: Fabric, shear: float, aspect: float) -> None:
    warnings.warn(
        f"Fabric '{fabric.name}' has a shear stiffness of {fabric.shear_stiffness:g} N/m, but springs on cells "
        f"{aspect:.2g} times as long as wide can only give it {shear:.3g}; use nearly square cells.",
        FabricWarning,
        stacklevel=4,
    )


def _owned(count: int, spacing: float) -> np.ndarray:
    """Width that each line of a grid stands for: a cell, half a cell at both ends [m]."""
    widths = np.full(count, spacing)
    widths[[0, -1]] *= 0.5
    return widths


_ROWS, _COLUMNS = ("bottom", "top"), ("left", "right")
