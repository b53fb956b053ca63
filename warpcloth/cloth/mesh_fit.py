"""Springs of an arbitrary triangle mesh that stretch and shear like a given sheet in every direction.

A network behaves as a uniform sheet of tensor C, whatever its mesh, if it passes the patch test: under any uniform
strain ε the springs at each vertex balance the sheet's traction C:ε on the border there (nothing inside). With springs
of stiffness k along unit vectors d that is linear in the stiffnesses,

    Σ k d_a d_b d_c = −C_abcd N_d        for each vertex, N the outward border it owns [m]

four equations each. Edges alone cannot meet them; with springs to the second ring of neighbours (or the third, for soft
shear) there are more unknowns than equations. They are found by non-negative least squares together with the weaker
wish that the springs around each vertex have the sheet's tensor, ½ Σ k r d_a d_b d_c d_d = C_abcd A. All of it is
scaled by the size of the patch, so that it does not depend on resolution. The solution is sparse: six to nine springs a
vertex.

Central forces have C_xxyy = C_xyxy = G (Cauchy), so Poisson's ratio follows from Y and G, as on grids.
"""

from dataclasses import dataclass

import numpy as np

from ..meshes.topology import SIDES, EdgeTable
from .sheet import sheet_tensor

STAGES = ((1.0, 60), (0.02, 180))  # weight of the tensors against the balances, iterations: first near, then exact
SOFT_SHEAR = 0.15  # G/√(Y_x Y_y) below which two rings are too few
LEAST_EDGE = 0.02  # of Y A/L: no edge is without a spring, so that no triangle can fold over
STEEPEST = 0.5  # sine of the angle between a spring and the surface beyond which it would cut across
CLOSE_ENOUGH = 1e-5
NEGLIGIBLE = 1e-3

_THREE = ((0, 0, 0), (0, 0, 1), (0, 1, 1), (1, 1, 1))
_FOUR = ((0, 0, 0, 0), (0, 0, 0, 1), (0, 0, 1, 1), (0, 1, 1, 1), (1, 1, 1, 1))
_WEIGHTS = np.sqrt([1.0, 3.0, 3.0, 1.0, 1.0, 4.0, 6.0, 4.0, 1.0])  # how often each component occurs


@dataclass(frozen=True, eq=False)
class FittedSprings:
    """Springs in the surface of a mesh.

    Attributes:
        pairs: vertices, shape [s, 2]; the first ``edge_count`` are the mesh's edges. stiffness: k [N], shape [s].
        young, shear: moduli along warp and weft, and of shear [N/m], that they have on average over the sheet.
    """

    pairs: np.ndarray
    stiffness: np.ndarray
    edge_count: int
    young: tuple[float, float]
    shear: float


def fit_springs(
    points: np.ndarray, triangles: np.ndarray, warp: np.ndarray, stretch: tuple[float, float], shear: float
) -> FittedSprings:
    """Springs for Young's moduli ``stretch`` along warp and weft and the shear modulus ``shear`` [N/m].

    Args:
        points: [m], shape [n, 3]. triangles: of a manifold mesh, shape [m, 3].
        warp: its direction, shape [3], projected onto the surface.
    """
    table = EdgeTable.of(triangles)
    reach = 2 if shear >= SOFT_SHEAR * np.sqrt(stretch[0] * stretch[1]) else 3
    patches = _Patches.of(points, triangles, table, warp)
    pairs = np.concatenate([table.edges, patches.flat_pairs(_far_pairs(table.edges, len(points), reach))])
    system = _System(patches, pairs, stretch, shear)
    areas = np.bincount(table.of_side, np.repeat(patches.triangle_area, 3))
    start = np.zeros(len(pairs))
    start[: len(table.edges)] = np.sqrt(stretch[0] * stretch[1]) * areas / system.length[: len(table.edges)]
    stiffness = start
    for weight, iterations in STAGES:
        stiffness = system.solved(stiffness, LEAST_EDGE * start, weight, iterations)
    keep = stiffness > NEGLIGIBLE * stiffness.max()
    keep[: len(table.edges)] = True
    young, found = system.moduli(stiffness)
    return FittedSprings(pairs[keep], stiffness[keep], len(table.edges), young, found)


def extreme_moduli(
    points: np.ndarray, triangles: np.ndarray, pairs: np.ndarray, stiffness: np.ndarray
) -> tuple[float, float]:
    """Smallest and largest Young's modulus [N/m] over all directions, of the mean tensor of springs in a surface.

    Along unit vectors u the compliance is u_a u_b S_abcd u_c u_d, S the inverse of C as a matrix over pairs of indices.
    """
    patches = _Patches.of(points, triangles, EdgeTable.of(triangles), np.array([1.0, 0.0, 0.0]))
    xxxx, xxxy, xxyy, xyyy, yyyy = _System(patches, pairs, (1.0, 1.0), 0.0).mean_tensor(stiffness)
    matrix = np.array([[xxxx, xxyy, xxxy], [xxyy, yyyy, xyyy], [xxxy, xyyy, xxyy]])  # Voigt's, with 2 ε_xy
    angle = np.linspace(0.0, np.pi, 36, endpoint=False)
    stress = np.stack([np.cos(angle) ** 2, np.sin(angle) ** 2, np.sin(angle) * np.cos(angle)])
    compliance = np.einsum("ia,ij,ja->a", stress, np.linalg.pinv(matrix, rcond=1e-6, hermitian=True), stress)
    return float(1.0 / compliance.max()), float(1.0 / compliance.min())


@dataclass(frozen=True, eq=False)
class _Patches:
    """What belongs to each vertex: its tangent axes, area [m²] and border N in these axes [m]."""

    points: np.ndarray
    normal: np.ndarray
    axes: np.ndarray
    area: np.ndarray
    border: np.ndarray
    triangle_area: np.ndarray

    @staticmethod
    def of(points: np.ndarray, triangles: np.ndarray, table: EdgeTable, warp: np.ndarray) -> "_Patches":
        count = len(points)
        a, b, c = (points[triangles[:, i]] for i in range(3))
        vector = 0.5 * np.cross(b - a, c - a)
        area = np.linalg.norm(vector, axis=1)
        normal = _unit(_summed(triangles.ravel(), np.repeat(vector, 3, axis=0), count))
        along = _unit(_tangent_of(np.asarray(warp, float), normal))
        axes = np.stack([along, np.cross(normal, along)], axis=1)
        side = np.flatnonzero(table.counts[table.of_side] == 1)
        ends = triangles[side // 3][np.arange(len(side))[:, None], SIDES[side % 3]]
        outward = np.cross(points[ends[:, 1]] - points[ends[:, 0]], vector[side // 3] / area[side // 3, None])
        border = _summed(ends.ravel(), np.repeat(0.5 * outward, 2, axis=0), count)
        shares = np.bincount(triangles.ravel(), np.repeat(area / 3.0, 3), count)
        return _Patches(points, normal, axes, shares, np.einsum("nad,nd->na", axes, border), area)

    def flat_pairs(self, pairs: np.ndarray) -> np.ndarray:
        """Those that lie near the surface at both ends."""
        d = _unit(self.points[pairs[:, 1]] - self.points[pairs[:, 0]])
        steep = [np.abs(np.einsum("sd,sd->s", d, self.normal[pairs[:, end]])) for end in range(2)]
        return pairs[np.maximum(*steep) < STEEPEST]


class _System:
    """The least-squares problem: nine equations for each vertex, four of balance and five of its tensor."""

    def __init__(self, patches: _Patches, pairs: np.ndarray, stretch: tuple[float, float], shear: float):
        self.pairs, self.patches = pairs, patches
        d = patches.points[pairs[:, 1]] - patches.points[pairs[:, 0]]
        self.length = np.linalg.norm(d, axis=1)
        rows = [self._columns(d if end == 0 else -d, end) for end in range(2)]
        self.scale = max(stretch)
        self.columns = np.stack(rows, axis=1) / self.scale
        self.target = self._targets(stretch, shear) / self.scale

    def solved(self, start: np.ndarray, least: np.ndarray, tensor_weight: float, iterations: int) -> np.ndarray:
        """Stiffnesses >= ``least`` by accelerated projected gradients (Beck and Teboulle 2009) with restarts."""
        weight = _WEIGHTS * ([1.0] * 4 + [tensor_weight] * 5)
        columns, target = self.columns * weight, self.target * weight
        unit = 1.0 / np.maximum(np.sqrt(np.einsum("sek,sek->s", columns, columns)), 1e-12)
        columns *= unit[:, None, None]
        low, x = least / unit, start / unit
        step = 1.0 / (1.05 * self._largest(columns))
        y, momentum = x, 1.0
        for _ in range(iterations):
            gradient = self._transposed(columns, self._applied(columns, y) - target)
            following = np.maximum(y - step * gradient, low)
            change = following - x
            momentum = 1.0 if np.sum(gradient * change) > 0.0 else momentum
            later = 0.5 + 0.5 * np.sqrt(1.0 + 4.0 * momentum * momentum)
            y, x, momentum = following + (momentum - 1.0) / later * change, following, later
            if np.sum(change * change) <= CLOSE_ENOUGH**2 * np.sum(x * x):  # BLAS would wait for its threads
                break
        return np.asarray(x * unit)

    def moduli(self, stiffness: np.ndarray) -> tuple[tuple[float, float], float]:
        """Young's moduli and shear modulus [N/m] of the mean tensor."""
        xxxx, _, xxyy, _, yyyy = self.mean_tensor(stiffness)
        return (float(xxxx - xxyy**2 / yyyy), float(yyyy - xxyy**2 / xxxx)), float(xxyy)

    def mean_tensor(self, stiffness: np.ndarray) -> np.ndarray:
        """Components xxxx, xxxy, xxyy, xyyy, yyyy [N/m] of the mean over the sheet, along warp and weft."""
        per_vertex = self._applied(self.columns, stiffness)[:, 4:] * self.scale
        return np.asarray(self.patches.area @ per_vertex / self.patches.area.sum())

    def _columns(self, d: np.ndarray, end: int) -> np.ndarray:
        """What a spring of 1 N adds to the nine equations of the vertex at one end, shape [s, 9]."""
        vertex, patches = self.pairs[:, end], self.patches
        flat = _unit(np.einsum("sad,sd->sa", patches.axes[vertex], d))
        three = np.stack([flat[:, a] * flat[:, b] * flat[:, c] for a, b, c in _THREE], axis=1)
        four = np.stack([np.prod(flat[:, list(four)], axis=1) for four in _FOUR], axis=1)
        area = patches.area[vertex, None]
        return np.concatenate([three / np.sqrt(area), 0.5 * self.length[:, None] * four / area], axis=1)

    def _targets(self, stretch: tuple[float, float], shear: float) -> np.ndarray:
        xxxx, yyyy = sheet_tensor(stretch, shear)
        component: dict[tuple[int, ...], float] = dict(zip(_FOUR, (xxxx, 0.0, shear, 0.0, yyyy), strict=True))
        border = self.patches.border / np.sqrt(self.patches.area)[:, None]
        pulled = [-sum(component[tuple(sorted((*three, d)))] * border[:, d] for d in range(2)) for three in _THREE]
        tensor = np.tile([component[four] for four in _FOUR], (len(border), 1))
        return np.concatenate([np.stack(pulled, axis=1), tensor], axis=1)

    def _applied(self, columns: np.ndarray, x: np.ndarray) -> np.ndarray:
        rows = (columns * x[:, None, None]).reshape(-1, 9)
        return _summed(self.pairs.ravel(), rows, len(self.patches.area))

    def _transposed(self, columns: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.einsum("sek,sek->s", columns, y[self.pairs])

    def _largest(self, columns: np.ndarray) -> float:
        x, value = np.ones(len(columns)), 1.0
        for _ in range(20):
            x = self._transposed(columns, self._applied(columns, x / np.sqrt(np.sum(x * x))))
            value = float(np.sqrt(np.sum(x * x)))
        return value


def _far_pairs(edges: np.ndarray, count: int, reach: int) -> np.ndarray:
    """Pairs of vertices two (or two and three) edges apart, each once."""
    both = np.concatenate([edges, edges[:, ::-1]]).astype(np.int64)
    both = both[np.argsort(both[:, 0], kind="stable")]
    start = np.searchsorted(both[:, 0], np.arange(count + 1))
    near, ring = np.unique(both[:, 0] * count + both[:, 1]), both
    far = np.zeros(0, np.int64)
    for _ in range(reach - 1):
        degree = start[ring[:, 1] + 1] - start[ring[:, 1]]
        offset = np.arange(degree.sum()) - np.repeat(np.cumsum(degree) - degree, degree)
        reached = both[np.repeat(start[ring[:, 1]], degree) + offset, 1]
        keys = np.unique(np.repeat(ring[:, 0], degree) * count + reached)
        keys = np.setdiff1d(keys, np.concatenate([near, far]), assume_unique=True)
        keys = keys[keys // count != keys % count]
        far, ring = np.concatenate([far, keys]), np.stack(np.divmod(keys, count), axis=1)
    pairs = np.stack(np.divmod(far, count), axis=1)
    return pairs[pairs[:, 0] < pairs[:, 1]].astype(np.int32)


def _tangent_of(warp: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The warp in each tangent plane; where it is normal to the surface, the next axis stands in for it."""
    instead = np.roll(np.eye(3)[np.argmax(np.abs(warp))], 1)
    flat, other = (v - (normal @ v)[:, None] * normal for v in (warp / np.linalg.norm(warp), instead))
    return np.where(np.linalg.norm(flat, axis=1, keepdims=True) > 0.1, flat, other)


def _summed(index: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    return np.stack([np.bincount(index, column, count) for column in rows.T], axis=1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)
