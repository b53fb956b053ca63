"""Spring networks, and the springs of an arbitrary triangle mesh.

A spring p–q with rest length r pulls with k_s (|x_q − x_p|/r − 1) newtons, so k_s is in newtons and k_d in newton
seconds. Everything here turns properties of the sheet (per width) into such springs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .. import validate
from ..errors import InputError
from ..fabric import Fabric
from ..meshes.topology import EdgeTable
from ..validate import Array

STRUCTURAL, SHEAR, BEND = 0, 1, 2
KIND_NAMES = ("structural", "shear", "bend")


@dataclass(frozen=True, eq=False)
class SpringNetwork:
    """Springs between particles.

    Args:
        indices: particle pairs, shape [s, 2], int32.
        rest_lengths: [m], shape [s], > 0.
        stiffness: k_s [N], shape [s], > 0.
        damping: k_d [N s], shape [s], >= 0.
        kinds: STRUCTURAL, SHEAR or BEND, shape [s], uint8.

    Raises:
        InputError: on unequal lengths, values out of range, or a spring from a particle to itself.
    """

    indices: Array
    rest_lengths: Array
    stiffness: Array
    damping: Array
    kinds: Array

    def __post_init__(self):
        indices = validate.array(self.indices, "springs: indices", (None, 2), np.int32)
        count = (len(indices),)
        values = {
            "indices": indices,
            "rest_lengths": validate.array(self.rest_lengths, "springs: rest_lengths", count),
            "stiffness": validate.array(self.stiffness, "springs: stiffness", count),
            "damping": validate.array(self.damping, "springs: damping", count),
            "kinds": validate.array(self.kinds, "springs: kinds", count, np.uint8),
        }
        _refuse(indices[:, 0] == indices[:, 1], "joins a particle to itself")
        _refuse(indices.min(axis=1, initial=0) < 0, "has a negative index")
        _refuse(values["rest_lengths"] <= 0.0, "has a rest length that is not greater than 0")
        _refuse(values["stiffness"] <= 0.0, "has a stiffness that is not greater than 0")
        _refuse(values["damping"] < 0.0, "has negative damping")
        _refuse(values["kinds"] > BEND, "has an unknown kind (structural 0, shear 1, bend 2)")
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.indices)

    @staticmethod
    def from_pairs(
        pairs: np.ndarray, points: np.ndarray, stiffness: np.ndarray, kind: int, damping_time: float
    ) -> "SpringNetwork":
        """Springs at rest between ``points`` with k_s = ``stiffness`` [N] and k_d = ``damping_time`` k_s."""
        lengths = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
        k_s = np.broadcast_to(np.asarray(stiffness, float), lengths.shape)
        return SpringNetwork(pairs, lengths, k_s, damping_time * k_s, np.full(len(pairs), kind, np.uint8))

    @staticmethod
    def joined(parts: Sequence["SpringNetwork"]) -> "SpringNetwork":
        """All springs of several networks over the same particles."""
        fields = ("indices", "rest_lengths", "stiffness", "damping", "kinds")
        return SpringNetwork(*(np.concatenate([getattr(part, name) for part in parts]) for name in fields))


def triangle_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Areas [m²], shape [m]."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def lumped_masses(points: np.ndarray, triangles: np.ndarray, areal_density: float) -> np.ndarray:
    """A third of each triangle's mass to each of its vertices [kg], shape [n]."""
    thirds = np.repeat(triangle_areas(points, triangles) * (areal_density / 3.0), 3)
    return np.bincount(triangles.ravel(), weights=thirds, minlength=len(points))


def mesh_springs(points: np.ndarray, triangles: np.ndarray, fabric: Fabric) -> SpringNetwork:
    """Springs of a manifold triangle mesh: structural ones along edges, bend springs across them.

    An edge of length L has k_s = Y A/L, A the area of its one or two triangles. The energy density of a triangle under
    a strain ε is then Y/2 Σ (nᵀ ε n)² over its edge directions n: Young's modulus is Y and Poisson's ratio 1/3, exactly
    for equilateral triangles (Seung and Nelson 1988) and on average over the orientations of any others. A bend spring
    joins the vertices opposite to an edge and has k_s = bend_stiffness A/L with L its own length.

    Args:
        points: [m], shape [n, 3].
        triangles: shape [m, 3], at most two to an edge.
        fabric: shear_stiffness is not used.
    """
    areas = triangle_areas(points, triangles)
    table = EdgeTable.of(triangles)
    edges, edge_area = table.edges, np.bincount(table.of_side, weights=np.repeat(areas, 3))
    lengths = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
    stiffness = fabric.stretch_stiffness * edge_area / lengths
    parts = [SpringNetwork.from_pairs(edges, points, stiffness, STRUCTURAL, fabric.damping_time)]
    if fabric.bend_stiffness > 0.0:
        parts.append(_across_edges(points, triangles, table, edge_area, fabric))
    return SpringNetwork.joined(parts)


def _across_edges(
    points: np.ndarray, triangles: np.ndarray, table: EdgeTable, edge_area: np.ndarray, fabric: Fabric
) -> SpringNetwork:
    """One bend spring for each interior edge whose opposite vertices are apart and not joined already."""
    pairs = np.sort(triangles.ravel()[table.side_pairs()], axis=1)  # corner i lies opposite to side i
    area = edge_area[table.counts == 2]
    lengths = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
    keys = _keys(pairs, len(points))
    first = np.unique(keys, return_index=True)[1]
    keep = (lengths > 1e-3 * np.sqrt(area)) & ~np.isin(keys, _keys(table.edges, len(points)))
    keep &= np.isin(np.arange(len(pairs)), first)
    stiffness = fabric.bend_stiffness * area[keep] / lengths[keep]
    return SpringNetwork.from_pairs(pairs[keep], points, stiffness, BEND, fabric.damping_time)


def _keys(pairs: np.ndarray, count: int) -> np.ndarray:
    return pairs[:, 0].astype(np.int64) * count + pairs[:, 1]


def _refuse(bad: np.ndarray, complaint: str) -> None:
    if np.any(bad):
        raise InputError(f"Springs: spring {int(np.flatnonzero(bad)[0])} {complaint}.")
