"""Curvature of a triangle mesh at its vertices: quadratic surfaces fitted to the vertices around each.

In the tangent plane of a vertex with coordinates (u, v) along warp and weft, the surface x(u, v) is fitted by
x₀ + t₁ u + t₂ v + ½ x_uu u² + ½ x_vv v² + x_uv u v through the vertex itself and, by least squares weighted with
1/(u² + v²), the vertices around it. All five are linear in the vertices' positions, so what is stored is their
weights. They are exact on quadratic surfaces whatever the mesh, which hinge angles and cotangent weights are not
(Grinspun et al., Computing Discrete Shape Operators on General Meshes, 2006).

Across a crease that the mesh does not resolve, as of a hem, neighbours stand on the tangent plane and seem to be near
it, which would make bending there as stiff as in a mesh as fine as that; they are moved out within the plane.

One ring of neighbours is enough inside most meshes; where it is not, as at borders, two are taken. What a tiny mesh
cannot tell (two triangles have one curvature, not three) is left out by a pseudo-inverse that never mistakes a tilt for
a curvature.
"""

from dataclasses import dataclass

import numpy as np

from ..meshes.topology import EdgeTable

SMALLEST_SINGULAR_VALUE = 0.1  # of the scaled fit, below which one ring is not enough
CUT_OFF = 0.02  # singular values below this share of the largest tell nothing
STEEPEST = 0.5  # a neighbour seen at a smaller share of its distance lies beyond a crease: it is taken to be that far
TURNS = 6  # the tangent plane is the fitted one after so many rounds


@dataclass(frozen=True, eq=False)
class Quadrics:
    """Weights of the fits of all n vertices over their k neighbours (padded with weight 0).

    Attributes:
        neighbours: shape [n, k], int32; the vertex itself where padded.
        tangents: of t₁ and t₂ [1/m], shape [n, 2, k].
        curvatures: of x_uu, x_vv and x_uv [1/m²], shape [n, 3, k].
        along, across: the axes of u and v, unit vectors, shape [n, 3].

    The weight of the vertex itself is minus the sum over its neighbours.
    """

    neighbours: np.ndarray
    tangents: np.ndarray
    curvatures: np.ndarray
    along: np.ndarray
    across: np.ndarray


def fit_quadrics(points: np.ndarray, triangles: np.ndarray, warp: np.ndarray) -> Quadrics:
    """Fits at all vertices of a manifold mesh.

    Args:
        points: [m], shape [n, 3].
        triangles: shape [m, 3].
        warp: direction of the warp, shape [3]; where it is normal to the surface, the next axis stands in for it.
    """
    rings = _one_ring(len(points), triangles)
    normals = _vertex_normals(points, triangles)
    thin = _fit(points, rings, normals, warp)[2] < SMALLEST_SINGULAR_VALUE
    rings = _widened(rings, thin)
    for _ in range(TURNS):
        tangents, _, _ = _fit(points, rings, normals, warp)
        t = np.einsum("ntk,nkd->ntd", tangents, points[rings] - points[:, None])
        normals = _unit(np.cross(t[:, 0], t[:, 1]), normals)
    tangents, curvatures, _ = _fit(points, rings, normals, warp)
    return Quadrics(rings, tangents, curvatures, *surface_frames(normals, warp))


def _fit(
    points: np.ndarray, rings: np.ndarray, normals: np.ndarray, warp: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights of tangents and curvatures, and the smallest singular value of each fit."""
    d = points[rings] - points[:, None]
    distance = np.linalg.norm(d, axis=2)
    real = distance > 0.0
    size = distance.sum(axis=1) / np.maximum(real.sum(axis=1), 1)
    size[size == 0.0] = 1.0
    along, across = surface_frames(normals, warp)
    u, v = (np.einsum("nkd,nd->nk", d, axis) / size[:, None] for axis in (along, across))
    stretch = STEEPEST * distance / size[:, None] / np.maximum(np.hypot(u, v), 1e-9)
    u, v = u * np.maximum(1.0, stretch), v * np.maximum(1.0, stretch)
    weight = np.where(real, 1.0 / np.maximum(u * u + v * v, 1e-6), 0.0)
    linear = weight[..., None] * np.stack([u, v], axis=2)
    quadratic = weight[..., None] * np.stack([0.5 * u * u, 0.5 * v * v, u * v], axis=2)
    flat = np.linalg.pinv(linear, rcond=CUT_OFF)
    rest = quadratic - linear @ (flat @ quadratic)
    singular = np.linalg.svd(rest, compute_uv=False)[:, -1] if rest.shape[1] >= 3 else np.zeros(len(points))
    bent = np.linalg.pinv(rest, rcond=CUT_OFF)
    bent = bent - (bent @ linear) @ flat
    tangents = flat - (flat @ quadratic) @ bent
    scale = size[:, None, None]
    return tangents * weight[:, None] / scale, bent * weight[:, None] / scale**2, singular


def surface_frames(normals: np.ndarray, warp: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors along warp and weft in each tangent plane."""
    instead = np.roll(np.eye(3)[np.argmax(np.abs(warp))], 1)
    along = warp - (normals @ warp)[:, None] * normals
    other = instead - (normals @ instead)[:, None] * normals
    along = np.where(np.linalg.norm(along, axis=1, keepdims=True) > 0.1 * np.linalg.norm(warp), along, other)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    return along, np.cross(normals, along)


def _vertex_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (points[triangles[:, i]] for i in range(3))
    total = np.zeros_like(points)
    np.add.at(total, triangles.ravel(), np.repeat(np.cross(b - a, c - a), 3, axis=0))
    return _unit(total, np.broadcast_to([0.0, 0.0, 1.0], points.shape))


def _unit(vectors: np.ndarray, instead: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0.0, vectors / np.where(length > 0.0, length, 1.0), instead)


def _one_ring(count: int, triangles: np.ndarray) -> np.ndarray:
    edges = EdgeTable.of(triangles).edges
    return _padded(count, np.concatenate([edges, edges[:, ::-1]]))


def _widened(rings: np.ndarray, thin: np.ndarray) -> np.ndarray:
    """Two rings of the vertices that are ``thin``, one of the others."""
    count = len(rings)
    own = np.arange(count)[:, None]
    first = np.stack([np.broadcast_to(own, rings.shape).ravel(), rings.ravel()], axis=1)
    few = np.flatnonzero(thin)
    reached = rings[rings[few]].reshape(len(few), rings.shape[1] ** 2)
    second = np.stack([np.repeat(few, reached.shape[1]), reached.ravel()], axis=1)
    pairs = np.concatenate([first, second])
    return _padded(count, pairs[pairs[:, 0] != pairs[:, 1]])


def _padded(count: int, pairs: np.ndarray) -> np.ndarray:
    """Rows of the second of each pair by the first, sorted, filled up with the row's own number."""
    keys = np.unique(pairs[:, 0].astype(np.int64) * count + pairs[:, 1])
    row, column = np.divmod(keys, count)
    lengths = np.bincount(row, minlength=count)
    width = int(lengths.max(initial=0))
    rings = np.repeat(np.arange(count, dtype=np.int32)[:, None], width, axis=1)
    rings[row, np.arange(len(keys)) - np.repeat(np.cumsum(lengths) - lengths, lengths)] = column
    return rings
