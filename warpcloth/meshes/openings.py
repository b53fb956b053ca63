"""Whether a triangle mesh has an inside."""

import numpy as np

from .topology import SIDES, EdgeTable, connected
from .trianglemesh import TriangleMesh

OPEN = 0.1  # share of what would close a mesh, of all it would then be


def has_inside(points: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether a mesh, closed where it has openings, would have a tenth of its surface there at most.

    Scans have small holes, and are solid; bowls, glasses and tubes are shells, in which cloth may lie.
    """
    if EdgeTable.of(triangles).is_closed:
        return True
    mesh = TriangleMesh(points, triangles).welded()
    a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
    surface = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    openings = float(np.linalg.norm(_area_vectors_of_openings(mesh), axis=1).sum())
    return openings <= OPEN * (surface + openings)


def _area_vectors_of_openings(mesh: TriangleMesh) -> np.ndarray:
    """Of each row of edges with one triangle [m²], shape [k, 3]: ½ Σ a × b over its edges from a to b."""
    table = EdgeTable.of(mesh.triangles)
    start, end = mesh.triangles[:, SIDES].reshape(-1, 2)[table.counts[table.of_side] == 1].T
    loop = connected(start, end, len(mesh.points))[start]
    centred = mesh.points - mesh.points.mean(axis=0)
    names, number = np.unique(loop, return_inverse=True)
    areas = np.zeros((len(names), 3))
    np.add.at(areas, number.ravel(), 0.5 * np.cross(centred[start], centred[end]))
    return areas
