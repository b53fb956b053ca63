"""Specimens: rectangles cut from cloth and meshed in any direction."""

import numpy as np

from ..cloth import Cloth
from ..errors import MissingExtraError
from ..fabric import Fabric
from ..meshes.trianglemesh import TriangleMesh
from .setup import Setup

JITTER = 0.3  # of a cell, by which the vertices of irregular meshes are displaced
CLEAR = 0.6  # of a cell, between the vertices inside and those on the outline
THINNEST = 1e-4  # area of a triangle over a cell, below which it is a sliver of the outline


def rectangle(
    lower: tuple[float, float],
    upper: tuple[float, float],
    cell: float,
    setup: Setup,
    fabric: Fabric,
    lines: tuple[float, ...] = (),
    springs: str = "stretch",
) -> Cloth:
    """The rectangle from ``lower`` to ``upper`` [m] in the xy plane, its mesh as ``setup`` asks; nothing is pinned.

    A plain grid has square cells, or nearly. Other meshes have vertices on the outline and on the ``lines`` x = const,
    a cell apart, and between those a grid at an angle or irregular points; their ``springs`` are as for
    :meth:`~warpcloth.cloth.Cloth.from_mesh`.

    Raises:
        MissingExtraError: scipy, which makes such meshes, is not installed.
    """
    size = np.subtract(upper, lower)
    counts = np.maximum(np.round(size / cell).astype(int), 1)
    if setup.oriented:
        centre = (*(0.5 * np.add(lower, upper)), 0.0)
        return Cloth.grid(tuple(size), tuple((counts + 1).tolist()), fabric, transform=centre, name="specimen")
    fixed = [_line(lower, (upper[0], lower[1]), counts[0]), _line((lower[0], upper[1]), upper, counts[0])]
    for x in (lower[0], *lines, upper[0]):
        fixed.append(_line((x, lower[1]), (x, upper[1]), counts[1]))
    outline = np.unique(np.round(np.concatenate(fixed) / (1e-6 * cell)), axis=0) * (1e-6 * cell)
    points = np.concatenate([outline, _filling(lower, upper, cell, setup, outline)])
    mesh = TriangleMesh(np.column_stack([points, np.zeros(len(points))]), triangulated(points, cell), name="specimen")
    return Cloth.from_mesh(mesh, fabric, springs=springs)


def disc_ring(disc: float, radius: float, cells: int, setup: Setup, fabric: Fabric) -> Cloth:
    """The outer ring of a round specimen [m] whose inside is held by a disc; nothing is pinned.

    Two rings of vertices lie half a cell on either side of the disc's edge, ``cells`` cells from the specimen's. In
    between there are equilateral triangles, turned by the angle that ``setup`` asks for, or irregular ones.

    Raises:
        MissingExtraError: scipy is not installed.
    """
    cell = (radius - disc) / cells
    rings = np.concatenate([_circle(r, cell) for r in (disc - 0.5 * cell, disc + 0.5 * cell, radius)])
    corner = (radius, radius)
    inside = _filling((-corner[0], -corner[1]), corner, cell, setup, rings, hexagonal=True)
    distance = np.linalg.norm(inside, axis=1)
    inside = inside[(distance > disc + (0.5 + CLEAR) * cell) & (distance < radius - CLEAR * cell)]
    points = np.concatenate([rings, inside])
    triangles = triangulated(points, cell)
    triangles = triangles[np.linalg.norm(points[triangles].mean(axis=1), axis=1) > disc - 0.5 * cell]
    mesh = TriangleMesh(np.column_stack([points, np.zeros(len(points))]), triangles, name="specimen")
    return Cloth.from_mesh(mesh, fabric)


def triangulated(points: np.ndarray, cell: float) -> np.ndarray:
    """Delaunay triangles of points in a convex region, counter-clockwise, without slivers, shape [m, 3]."""
    try:
        from scipy.spatial import Delaunay
    except ImportError as error:
        raise MissingExtraError(
            "Meshes other than plain grids need scipy; install it with `pip install 'warpcloth[lab]'`."
        ) from error
    corners = Delaunay(points).simplices
    a, b, c = (points[corners[:, i]] for i in range(3))
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    corners = np.where((area < 0.0)[:, None], corners[:, ::-1], corners)
    return corners[np.abs(area) > THINNEST * cell * cell].astype(np.int32)


def _circle(radius: float, cell: float) -> np.ndarray:
    angle = np.linspace(0.0, 2.0 * np.pi, max(round(2.0 * np.pi * radius / cell), 12), endpoint=False)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _line(start: tuple[float, float], stop: tuple[float, float], count: int) -> np.ndarray:
    return np.linspace(start, stop, int(count) + 1)


def _filling(
    lower: tuple[float, float],
    upper: tuple[float, float],
    cell: float,
    setup: Setup,
    outline: np.ndarray,
    *,
    hexagonal: bool = False,
) -> np.ndarray:
    """Vertices inside: a grid of squares or triangles turned by the angle, or one displaced at random; none too close
    to the outline's."""
    centre, reach = 0.5 * np.add(lower, upper), 0.5 * float(np.hypot(*np.subtract(upper, lower)))
    steps = np.arange(-int(2.0 * reach / cell) - 2, int(2.0 * reach / cell) + 3)
    lattice = cell * np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    if hexagonal:
        lattice = lattice @ np.array([[1.0, 0.0], [0.5, 0.5 * np.sqrt(3.0)]])
    if setup.mesh == "irregular":
        lattice = lattice + np.random.default_rng(setup.seed).uniform(-JITTER, JITTER, lattice.shape) * cell
    turn = np.deg2rad(setup.angle)
    matrix = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    points = centre + lattice @ matrix
    margin = CLEAR * cell
    points = points[np.all((points > np.add(lower, margin)) & (points < np.subtract(upper, margin)), axis=1)]
    if len(points) == 0:
        return points
    nearest = np.array([np.min(np.sum((outline - p) ** 2, axis=1)) for p in points])
    return points[nearest > margin * margin]
