"""Spring networks, and the springs of an arbitrary triangle mesh.

A spring p–q with rest length r pulls with k_s (|x_q − x_p|/r − 1) newtons, so k_s is in newtons and k_d in newton
seconds. Everything here turns properties of the sheet (per width) into such springs.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .. import validate
from ..errors import FabricWarning, InputError
from ..fabric import Fabric
from ..meshes.topology import EdgeTable
from ..validate import Array, ReadOnly
from .mesh_fit import extreme_moduli, fit_springs

STRUCTURAL, SHEAR, BEND = 0, 1, 2
MESH_SPRINGS = ("stretch", "shear", "fitted", "woven")
LARGEST_DEVIATION = 0.1  # of a mesh's moduli from the fabric's before a warning
LARGEST_ANISOTROPY = 2.0  # of its Young's moduli, likewise
FEWEST_TRIANGLES = 100  # whose directions tell something about a sheet
KIND_NAMES = ("structural", "shear", "bend")


@dataclass(frozen=True, eq=False)
class SpringNetwork(ReadOnly):
    """Springs between particles.

    Args:
        indices: particle pairs, shape [s, 2], int32.
        rest_lengths: [m], shape [s], > 0.
        stiffness: k_s [N], shape [s], > 0.
        damping: k_d [N s], shape [s], >= 0.
        kinds: STRUCTURAL, SHEAR or BEND, shape [s], uint8.
        limit_stiffness: what is added to k_s beyond the fabric's strain limit [N], shape [s], >= 0; zeros for None.

    Raises:
        InputError: on unequal lengths, values out of range, or a spring from a particle to itself.
    """

    indices: Array
    rest_lengths: Array
    stiffness: Array
    damping: Array
    kinds: Array
    limit_stiffness: Array = None

    def __post_init__(self):
        indices = validate.array(self.indices, "springs: indices", (None, 2), np.int32)
        count = (len(indices),)
        limit = np.zeros(count) if self.limit_stiffness is None else self.limit_stiffness
        values = {
            "indices": indices,
            "rest_lengths": validate.array(self.rest_lengths, "springs: rest_lengths", count),
            "stiffness": validate.array(self.stiffness, "springs: stiffness", count),
            "damping": validate.array(self.damping, "springs: damping", count),
            "kinds": validate.array(self.kinds, "springs: kinds", count, np.uint8),
            "limit_stiffness": validate.array(limit, "springs: limit_stiffness", count),
        }
        _refuse(indices[:, 0] == indices[:, 1], "joins a particle to itself")
        _refuse(indices.min(axis=1, initial=0) < 0, "has a negative index")
        _refuse(values["rest_lengths"] <= 0.0, "has a rest length that is not greater than 0")
        _refuse(values["stiffness"] <= 0.0, "has a stiffness that is not greater than 0")
        _refuse(values["damping"] < 0.0, "has negative damping")
        _refuse(values["limit_stiffness"] < 0.0, "has negative stiffness beyond its limit")
        _refuse(values["kinds"] > BEND, "has an unknown kind (structural 0, shear 1, bend 2)")
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.indices)

    @staticmethod
    def from_pairs(
        pairs: np.ndarray,
        points: np.ndarray,
        stiffness: np.ndarray,
        kind: int,
        damping_time: float,
        limit_share: float = 0.0,
    ) -> "SpringNetwork":
        """Springs at rest between ``points`` with k_s = ``stiffness`` [N], k_d = ``damping_time`` k_s and k_L =
        ``limit_share`` k_s."""
        lengths = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
        k_s = np.broadcast_to(np.asarray(stiffness, float), lengths.shape)
        kinds = np.full(len(pairs), kind, np.uint8)
        return SpringNetwork(pairs, lengths, k_s, damping_time * k_s, kinds, limit_share * k_s)

    @staticmethod
    def joined(parts: Sequence["SpringNetwork"]) -> "SpringNetwork":
        """All springs of several networks over the same particles; there may be none."""
        fields = ("indices", "rest_lengths", "stiffness", "damping", "kinds", "limit_stiffness")
        if not parts:
            return SpringNetwork(np.zeros((0, 2), np.int32), [], [], [], [])
        return SpringNetwork(*(np.concatenate([getattr(part, name) for part in parts]) for name in fields))


def triangle_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Areas [m²], shape [m]."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def lumped_masses(points: np.ndarray, triangles: np.ndarray, areal_density: float) -> np.ndarray:
    """A third of each triangle's mass to each of its vertices [kg], shape [n]."""
    thirds = np.repeat(triangle_areas(points, triangles) * (areal_density / 3.0), 3)
    return np.bincount(triangles.ravel(), weights=thirds, minlength=len(points))


def mesh_springs(points: np.ndarray, triangles: np.ndarray, fabric: Fabric, kind: str = "stretch") -> SpringNetwork:
    """Springs of a manifold triangle mesh: in its surface, and bend springs across edges.

    "stretch" and "shear" put springs along edges only; an edge of length L has k_s = Y A/L, A the area of its one or
    two triangles. The energy density of a triangle under a strain ε is then Y/2 Σ (nᵀ ε n)² over its edge directions n:
    Young's modulus is Y, Poisson's ratio 1/3 and the shear modulus 3/8 Y, exactly for equilateral triangles (Seung and
    Nelson 1988) and on average over the orientations of any others. Y is the mean of the fabric's two for "stretch";
    "shear" has the fabric's G instead and Y = 8/3 G, which suits the drape of woven fabrics: they shear long before
    they stretch.

    "woven" has all of the fabric's moduli on any mesh. Its springs join no vertices: they run along the yarns inside
    triangles (:mod:`warpcloth.cloth.woven`), so that here are bend springs only. "fitted" adds springs to vertices
    further away (:mod:`warpcloth.cloth.mesh_fit`), which has the fabric's moduli where G is at least some 0.06 Y, as in
    knits. It is there for what only knows springs between vertices: Newton, and the schemes that solve for no others
    (pbd, projective_dynamics, vbd). Such springs resist bending where cells are large, with an energy that grows with
    the fourth power of curvature and size.

    A bend spring joins the vertices opposite to an edge and has k_s = bend_stiffness A/L with L its own length.

    Args:
        points: [m], shape [n, 3].
        triangles: shape [m, 3], at most two to an edge.
        fabric: its warp runs along x.
        kind: one of :data:`MESH_SPRINGS`.

    Warns:
        FabricWarning: the springs have other moduli than they should, or differ much between directions.
    """
    table = EdgeTable.of(triangles)
    edge_area = np.bincount(table.of_side, weights=np.repeat(triangle_areas(points, triangles), 3))
    parts = [] if kind == "woven" else _surface_springs(points, triangles, table, edge_area, fabric, kind)
    if fabric.bend_stiffness > 0.0:
        parts.append(_across_edges(points, triangles, table, edge_area, fabric))
    return SpringNetwork.joined(parts)


def _surface_springs(
    points: np.ndarray, triangles: np.ndarray, table: EdgeTable, edge_area: np.ndarray, fabric: Fabric, kind: str
) -> list[SpringNetwork]:
    """Springs in the surface, between vertices: along edges, and if fitted, to vertices further away."""
    if kind == "fitted":
        fitted = fit_springs(points, triangles, np.array([1.0, 0.0, 0.0]), fabric.stretch, fabric.shear_stiffness)
        _warn_of_other_moduli(fabric, fitted.young, fitted.shear)
        pairs, stiffness = fitted.pairs, fitted.stiffness
    else:
        young = np.mean(fabric.stretch) if kind == "stretch" else 8.0 / 3.0 * fabric.shear_stiffness
        pairs = table.edges
        stiffness = young * edge_area / np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
        _warn_of_anisotropy(fabric, points, triangles, pairs, stiffness)
    count, parts = len(table.edges), []
    share = _limit_share(points, table, edge_area, stiffness[:count], fabric)
    for part, family, beyond in ((slice(count), STRUCTURAL, share), (slice(count, None), SHEAR, 0.0)):
        if len(pairs[part]) and stiffness[part].max() > 0.0:
            law = stiffness[part], family, fabric.damping_time, beyond
            parts.append(SpringNetwork.from_pairs(pairs[part], points, *law))
    return parts


def _limit_share(
    points: np.ndarray, table: EdgeTable, edge_area: np.ndarray, stiffness: np.ndarray, fabric: Fabric
) -> float:
    """k_L/k_s with which springs along edges have the mean of what the fabric adds beyond its limit along warp and
    weft, whatever share of its stretch stiffness is theirs."""
    lengths = np.linalg.norm(points[table.edges[:, 1]] - points[table.edges[:, 0]], axis=1)
    young = float(np.sum(stiffness * lengths) / np.sum(edge_area))
    beyond = fabric.beyond_limit * float(np.mean(fabric.stretch)) / fabric.stretch_stiffness
    return beyond / young if young > 0.0 else 0.0


def _warn_of_other_moduli(fabric: Fabric, young: tuple[float, float], shear: float) -> None:
    """Says so where one of the moduli that the springs have is off by more than a tenth."""
    wanted, found = (*fabric.stretch, fabric.shear_stiffness), (*young, shear)
    if max(abs(a - b) / max(a, b) for a, b in zip(wanted, found, strict=True)) > LARGEST_DEVIATION:
        warnings.warn(
            f"Fabric '{fabric.name}' should have stretch stiffnesses of {wanted[0]:.3g} and {wanted[1]:.3g} N/m and a "
            f"shear stiffness of {wanted[2]:.3g} N/m, but springs on this mesh give it about {found[0]:.3g}, "
            f"{found[1]:.3g} and {found[2]:.3g}; springs = 'woven' have what they should on any mesh.",
            FabricWarning,
            stacklevel=5,
        )


def _warn_of_anisotropy(
    fabric: Fabric, points: np.ndarray, triangles: np.ndarray, pairs: np.ndarray, stiffness: np.ndarray
) -> None:
    """Says so where springs along edges are much stiffer one way than another, as with diagonals all one way."""
    weakest, stiffest = extreme_moduli(points, triangles, pairs, stiffness)
    if stiffest > LARGEST_ANISOTROPY * weakest and len(triangles) >= FEWEST_TRIANGLES:
        warnings.warn(
            f"Fabric '{fabric.name}' stretches {stiffest / weakest:.2g} times as easily in one direction of this mesh "
            "as in another, as its edges lie; use springs = 'woven', or a mesh with edges in more directions.",
            FabricWarning,
            stacklevel=5,
        )


def _across_edges(
    points: np.ndarray, triangles: np.ndarray, table: EdgeTable, edge_area: np.ndarray, fabric: Fabric
) -> SpringNetwork:
    """A bend spring for the vertices opposite to an interior edge, if they are apart and not joined already. Those of
    two edges, as around vertices with four neighbours, are one spring."""
    pairs = np.sort(triangles.ravel()[table.side_pairs()], axis=1)  # corner i lies opposite to side i
    keys, first, place = np.unique(_keys(pairs, len(points)), return_index=True, return_inverse=True)
    area = np.bincount(place.ravel(), edge_area[table.counts == 2], len(keys))
    pairs = pairs[first]
    lengths = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
    keep = (lengths > 1e-3 * np.sqrt(area)) & ~np.isin(keys, _keys(table.edges, len(points)))
    stiffness = fabric.bend_stiffness * area[keep] / lengths[keep]
    return SpringNetwork.from_pairs(pairs[keep], points, stiffness, BEND, fabric.damping_time)


def _keys(pairs: np.ndarray, count: int) -> np.ndarray:
    return pairs[:, 0].astype(np.int64) * count + pairs[:, 1]


def _refuse(bad: np.ndarray, complaint: str) -> None:
    if np.any(bad):
        raise InputError(f"Springs: spring {int(np.flatnonzero(bad)[0])} {complaint}.")
