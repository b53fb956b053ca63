"""Bending elements of any triangle mesh: the mean curvature tensor of each triangle.

By the divergence theorem a triangle's mean second derivative is what its three sides give,

    H = (1/A) Σ_i l_i [ (∂x/∂ν) ν νᵀ + (∂x/∂τ) sym(ν τᵀ) ]

with ν out of and τ along side i: Morley's element, but for the slope ∂x/∂ν, which is no unknown of its own here. The
slope at the middle of a side comes from the two triangles there, unfolded into one plane: their own slopes, weighted by
each other's heights, less what a quadratic surface makes those wrong by. That last part vanishes where both triangles
are mirror images or form a parallelogram; elsewhere it uses the quadratic surfaces fitted around both ends of the side.

So H is exact on quadratic surfaces on any mesh, and as both triangles at a side share its slope, constant curvature is
in equilibrium on any mesh, too. Averages that have only the first property (fits at vertices) or the second (hinges)
miss a cantilever's tip by 1 to 15 %, however fine the mesh.

A side on the border carries no moment across it: what its slope would do to H is left out of the energy.
"""

from dataclasses import dataclass

import numpy as np

from ..meshes.topology import SIDES, EdgeTable
from .bending import BendingElements
from .bending_sheet import BendingSheet
from .quadric import Quadrics, fit_quadrics, surface_frames

NEGLIGIBLE = 1e-9  # part of a side's length below which a slope is right without the fits


@dataclass(frozen=True, eq=False)
class Entries:
    """Loose terms of linear functions: function ``row`` has ``weight`` times the position of ``particle``."""

    row: np.ndarray
    particle: np.ndarray
    weight: np.ndarray

    @staticmethod
    def joined(parts: list["Entries"]) -> "Entries":
        """All terms of several."""
        return Entries(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("row", "particle", "weight")))

    def of_rows(self, rows: np.ndarray, count: int) -> tuple["Entries", np.ndarray]:
        """The functions that ``rows`` names, in that order: their terms, and which item of ``rows`` each is for."""
        order = np.argsort(self.row, kind="stable")
        start = np.searchsorted(self.row[order], np.arange(count + 1))
        lengths = start[rows + 1] - start[rows]
        item = np.repeat(np.arange(len(rows)), lengths)
        place = order[np.arange(len(item)) - np.repeat(np.cumsum(lengths) - lengths, lengths) + start[rows][item]]
        return Entries(item, self.particle[place], self.weight[place]), item


def mesh_bending(
    points: np.ndarray, triangles: np.ndarray, sheet: BendingSheet, warp: np.ndarray | None = None
) -> BendingElements:
    """Up to three elements per triangle: κ along warp and weft and the twist; less on the border.

    Args:
        points: rest shape [m], shape [n, 3], flat or not.
        triangles: shape [m, 3], at most two to an edge.
        sheet: the material.
        warp: direction of the warp, shape [3]; x if None.
    """
    if not sheet.bends:
        return BendingElements.none()
    warp = np.array([1.0, 0.0, 0.0]) if warp is None else warp
    mesh = _Mesh.of(points, triangles, warp)
    tensor = _tensor_entries(mesh, _slopes(mesh, fit_quadrics(points, triangles, warp)))
    rows = _rows(mesh, sheet)
    return _elements(mesh, tensor, rows)


@dataclass(frozen=True, eq=False)
class _Mesh:
    """A mesh with the frames of its triangles; sides are numbered 3 t + i, side i opposite to corner i.

    ``along``, ``across``: warp and weft in each triangle; ``normal``, ``tangent``: ν and τ of each side in these, shape
    [m, 3, 2]; τ leads from the smaller vertex of the edge to the larger one.
    """

    points: np.ndarray
    triangles: np.ndarray
    table: EdgeTable
    area: np.ndarray
    along: np.ndarray
    across: np.ndarray
    length: np.ndarray
    normal: np.ndarray
    tangent: np.ndarray
    gradient: np.ndarray

    @staticmethod
    def of(points: np.ndarray, triangles: np.ndarray, warp: np.ndarray) -> "_Mesh":
        a, b, c = (points[triangles[:, i]] for i in range(3))
        up = np.cross(b - a, c - a)
        double = np.linalg.norm(up, axis=1)
        along, across = surface_frames(up / double[:, None], warp)
        corners = np.stack(
            [np.stack([np.einsum("ij,ij->i", p - a, axis) for axis in (along, across)], 1) for p in (a, b, c)], 1
        )
        side = corners[:, SIDES[:, 1]] - corners[:, SIDES[:, 0]]
        length = np.linalg.norm(side, axis=2)
        normal = np.stack([side[..., 1], -side[..., 0]], axis=2) / length[..., None]
        forward = np.where(triangles[:, SIDES[:, 0]] < triangles[:, SIDES[:, 1]], 1.0, -1.0)
        tangent = side * (forward / length)[..., None]
        gradient = -normal * (length / double[:, None])[..., None]
        table = EdgeTable.of(triangles)
        return _Mesh(points, triangles, table, 0.5 * double, along, across, length, normal, tangent, gradient)

    @property
    def edge(self) -> np.ndarray:
        """Edge of each side, shape [m, 3]."""
        return self.table.of_side.reshape(-1, 3)


def _slopes(mesh: _Mesh, fits: Quadrics) -> Entries:
    """∂x/∂ν at the middle of each inner edge, ν out of the first of its two triangles; rows are edges."""
    first, second = mesh.table.side_pairs().T
    inner = np.flatnonzero(mesh.table.counts == 2)
    p, q = mesh.table.edges[inner].T
    middle, length = 0.5 * (mesh.points[p] + mesh.points[q]), mesh.length.ravel()[first]
    direction = (mesh.points[q] - mesh.points[p]) / length[:, None]
    height, foot, apex = [], [], []
    for side in (first, second):
        height.append(2.0 * mesh.area[side // 3] / length)
        apex.append(mesh.triangles.ravel()[side])
        foot.append(np.einsum("ij,ij->i", mesh.points[apex[-1]] - middle, direction))
    weight = [height[1] / (height[0] + height[1]), height[0] / (height[0] + height[1])]
    parts = []
    for k, sign in ((0, -1.0), (1, 1.0)):  # the first triangle lies behind ν
        w = sign * weight[k] / height[k]
        share = foot[k] / length
        parts += [
            Entries(inner, apex[k], w),
            Entries(inner, p, w * (share - 0.5)),
            Entries(inner, q, -w * (share + 0.5)),
        ]
    twist = weight[0] * foot[0] + weight[1] * foot[1]
    bow = [0.5 * foot[k] ** 2 - 0.125 * length**2 for k in (0, 1)]
    bend = weight[1] * bow[1] / height[1] - weight[0] * bow[0] / height[0]
    wrong = np.flatnonzero(np.abs(twist) + np.abs(bend) > NEGLIGIBLE * length)
    if wrong.size:
        outward = np.einsum("mij,mjk->mik", mesh.normal, np.stack([mesh.along, mesh.across], 1)).reshape(-1, 3)
        normal = 0.5 * (outward[first] - outward[second])  # of both, so that it does not matter which one is the first
        for end in (p, q):
            parts += _corrections(
                fits, inner[wrong], end[wrong], twist[wrong], bend[wrong], normal[wrong], direction[wrong]
            )
    return Entries.joined(parts)


def _corrections(
    fits: Quadrics,
    edge: np.ndarray,
    end: np.ndarray,
    twist: np.ndarray,
    bend: np.ndarray,
    normal: np.ndarray,
    direction: np.ndarray,
) -> list[Entries]:
    """−½ (twist x_ντ + bend x_ττ), the second derivatives those of the fit at one end of each edge."""
    n, t = (
        np.stack([np.einsum("ij,ij->i", v, axis[end]) for axis in (fits.along, fits.across)], 1)
        for v in (normal, direction)
    )
    twist, bend = twist[:, None], bend[:, None]
    mixed = np.column_stack([n[:, 0] * t[:, 0], n[:, 1] * t[:, 1], n[:, 0] * t[:, 1] + n[:, 1] * t[:, 0]])
    plain = np.column_stack([t[:, 0] ** 2, t[:, 1] ** 2, 2.0 * t[:, 0] * t[:, 1]])
    weight = -0.5 * np.einsum("ic,ick->ik", twist * mixed + bend * plain, fits.curvatures[end])
    width = weight.shape[1]
    return [
        Entries(np.repeat(edge, width), fits.neighbours[end].ravel(), weight.ravel()),
        Entries(edge, end, -weight.sum(axis=1)),
    ]


def _tensor_entries(mesh: _Mesh, slopes: Entries) -> list[Entries]:
    """Terms of H_uu, H_vv and √2 H_uv of all triangles."""
    parts: list[list[Entries]] = [[], [], []]
    number = np.arange(len(mesh.triangles))
    first = np.zeros(len(mesh.table.edges), np.int64) - 1
    pairs = mesh.table.side_pairs()
    first[mesh.table.counts == 2] = pairs[:, 0]
    for i in range(3):
        edge, n, t = mesh.edge[:, i], mesh.normal[:, i], mesh.tangent[:, i]
        factor = (mesh.length[:, i] / mesh.area)[:, None]
        outward, mixed = factor * _tensor(n, n), factor * _tensor(n, t)
        inside = np.flatnonzero(mesh.table.counts[edge] == 2)
        sign = np.where(first[edge[inside]] == 3 * inside + i, 1.0, -1.0)
        found, item = slopes.of_rows(edge[inside], len(mesh.table.edges))
        p, q = mesh.table.edges[edge].T
        for c in range(3):
            weight = found.weight * (sign * outward[inside, c])[item]
            slope = mixed[:, c] / mesh.length[:, i]
            parts[c] += [
                Entries(inside[item], found.particle, weight),
                Entries(number, q, slope),
                Entries(number, p, -slope),
            ]
    return [Entries.joined(part) for part in parts]


def _tensor(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Components uu, vv and √2 uv of sym(a bᵀ)."""
    twist = (a[:, 0] * b[:, 1] + a[:, 1] * b[:, 0]) / np.sqrt(2.0)
    return np.column_stack([a[:, 0] * b[:, 0], a[:, 1] * b[:, 1], twist])


@dataclass(frozen=True, eq=False)
class _Rows:
    """Elements: d is the product of ``factors`` [e, 3] and (H_uu, H_vv, √2 H_uv) of ``triangle`` [e]."""

    triangle: np.ndarray
    factors: np.ndarray
    stiffness: np.ndarray
    slip_moment: np.ndarray


def _rows(mesh: _Mesh, sheet: BendingSheet) -> _Rows:
    """The energy ½ A |S H|², S² = diag(B_u, B_v, B_uv), as squares; on the border least over the slopes there."""
    s = np.sqrt([*sheet.rigidity, sheet.twist_rigidity])
    half = 0.5 * np.array([*sheet.hysteresis])
    border = mesh.table.counts[mesh.edge] == 1
    number = border.sum(axis=1)
    parts = []
    inner = np.flatnonzero(number == 0)
    for c, (slip, size) in enumerate(((half[0], 1.0), (half[1], 1.0), (0.0, 0.5))):
        area = mesh.area[inner]
        factors = np.tile(np.sqrt(size) * np.eye(3)[c], (len(inner), 1))
        parts.append(_Rows(inner, factors, s[c] ** 2 / size * area, slip * area))
    one = np.flatnonzero(number == 1)
    if one.size:
        side = np.argmax(border[one], axis=1)
        n, t = mesh.normal[one, side], mesh.tangent[one, side]
        across = _unit(s * _tensor(n, n))
        along = s * _tensor(t, t)
        along = _unit(along - np.einsum("ij,ij->i", along, across)[:, None] * across)
        slip = (t**2 @ half) * mesh.area[one]
        parts.append(_scaled(mesh, one, along, s, _tensor(t, t), slip))
        parts.append(_scaled(mesh, one, np.cross(along, across), s, _tensor(n, t), 0.0 * slip))
    two = np.flatnonzero(number == 2)
    if two.size:
        sides = np.argsort(~border[two], axis=1, kind="stable")[:, :2]
        n = [s * _tensor(v, v) for v in (mesh.normal[two, sides[:, 0]], mesh.normal[two, sides[:, 1]])]
        twist = _unit(np.cross(*n))
        parts.append(_scaled(mesh, two, twist, s, twist / s, np.zeros(len(two))))
    names = ("triangle", "factors", "stiffness", "slip_moment")
    return _Rows(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _scaled(
    mesh: _Mesh, triangles: np.ndarray, direction: np.ndarray, s: np.ndarray, unit: np.ndarray, slip: np.ndarray
) -> _Rows:
    """½ A (direction · S H)² with d = 1 for H = ``unit``."""
    size = np.einsum("ij,ij->i", direction, s * unit)
    return _Rows(triangles, direction * s / size[:, None], mesh.area[triangles] * size**2, slip)


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def _elements(mesh: _Mesh, tensor: list[Entries], rows: _Rows) -> BendingElements:
    parts = []
    for c, entries in enumerate(tensor):
        found, item = entries.of_rows(rows.triangle, len(mesh.triangles))
        parts.append(Entries(found.row, found.particle, found.weight * rows.factors[item, c]))
    bend = Entries.joined(parts)
    corners = mesh.triangles[rows.triangle]
    gradient = mesh.gradient[rows.triangle].reshape(-1, 2)
    weights = np.concatenate(
        [
            np.column_stack([bend.weight, np.zeros((len(bend.weight), 2))]),
            np.column_stack([np.zeros(len(gradient)), gradient]),
        ]
    )
    return BendingElements.from_entries(
        np.concatenate([bend.row, np.repeat(np.arange(len(corners)), 3)]),
        np.concatenate([bend.particle, corners.ravel()]),
        weights,
        stiffness=rows.stiffness,
        slip_moment=rows.slip_moment,
        points=mesh.points,
    )
