"""Bending elements of rectangular grids: second differences."""

import numpy as np

from .bending import BendingElements
from .bending_sheet import BendingSheet
from .grid import GridShape


def grid_bending(shape: GridShape, points: np.ndarray, sheet: BendingSheet) -> BendingElements:
    """Second differences along the rows and columns, and the twist of each cell.

    E = ½ Σ [B_x A_x |δ_xx|² + B_y A_y |δ_yy|² + 2 B_xy A |δ_xy|²]: three vertices in line own a cell's length times the
    width of their line (half of it on the border), four corners their cell. A vertex on the border has no second
    difference across it, as a free edge carries no moment. Exact on quadratic surfaces; a sheet of inextensible cloth
    comes out with an error of second order in the cell.

    Args:
        shape: the grid.
        points: rest pose [m], shape [nx ny, 3], flat.
        sheet: the material.
    """
    if not sheet.bends:
        return BendingElements.none()
    dx, dy = shape.cell
    index, (wide, high) = shape.index, shape.owned
    a, b = index[:, 1:-1], index[1:-1]
    rows = [
        _line(index[:, :-2], a, index[:, 2:], dx, dx * np.broadcast_to(high[:, None], a.shape)),
        _line(index[:-2], b, index[2:], dy, dy * np.broadcast_to(wide[None, :], b.shape)),
        _twist(index, dx, dy),
    ]
    moduli = (sheet.rigidity[0], sheet.rigidity[1], 2.0 * sheet.twist_rigidity)
    slips = (0.5 * sheet.hysteresis[0], 0.5 * sheet.hysteresis[1], 0.0)
    element, particle, weights, stiffness, slip, first = [], [], [], [], [], 0
    normal = _central(index, dx, dy)
    for (particles, w, area), modulus, moment in zip(rows, moduli, slips, strict=True):
        number = first + np.arange(len(particles))
        first += len(particles)
        for column, value in zip(particles.T, w, strict=True):
            element.append(number)
            particle.append(column)
            weights.append(np.broadcast_to([value, 0.0, 0.0], (len(column), 3)))
        if moment > 0.0:
            for column, along, across in normal:
                element.append(number)
                particle.append(column[particles[:, 1]])
                weights.append(
                    np.stack([np.zeros(len(number)), along[particles[:, 1]], across[particles[:, 1]]], axis=1)
                )
        stiffness.append(modulus * area)
        slip.append(moment * area)
    return BendingElements.from_entries(
        np.concatenate(element), np.concatenate(particle), np.concatenate(weights),
        stiffness=np.concatenate(stiffness), slip_moment=np.concatenate(slip), points=points,
    )  # fmt: skip


def _line(
    left: np.ndarray, middle: np.ndarray, right: np.ndarray, step: float, area: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    particles = np.stack([left.ravel(), middle.ravel(), right.ravel()], axis=1)
    return particles, np.array([1.0, -2.0, 1.0]) / step**2, area.ravel()


def _twist(index: np.ndarray, dx: float, dy: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    corners = (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:])
    particles = np.stack([corner.ravel() for corner in corners], axis=1)
    return particles, np.array([1.0, -1.0, -1.0, 1.0]) / (dx * dy), np.full(len(particles), dx * dy)


def _central(index: np.ndarray, dx: float, dy: float) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Tangents by central differences, one-sided on the border: for each vertex its neighbour, α and β, four times."""
    ny, nx = index.shape
    i, j = np.tile(np.arange(nx), ny), np.repeat(np.arange(ny), nx)
    zero = np.zeros(nx * ny)
    right, left = np.minimum(i + 1, nx - 1), np.maximum(i - 1, 0)
    above, below = np.minimum(j + 1, ny - 1), np.maximum(j - 1, 0)
    along, across = 1.0 / ((right - left) * dx), 1.0 / ((above - below) * dy)
    return [
        (index[j, right], along, zero),
        (index[j, left], -along, zero),
        (index[above, i], zero, across),
        (index[below, i], zero, -across),
    ]
