"""Smooth surfaces from triangle meshes, by Loop subdivision.

The mesh never changes within a shot, so its refinement is worked out once, as sparse weights; each frame then costs a
few sums. (C. Loop, Smooth Subdivision Surfaces Based on Triangles, 1987; weights after Warren; boundaries are cubic
B-splines, and stay sharp where the outline of the rest pose has a corner.)
"""

import numpy as np

CORNER_ANGLE = np.radians(135.0)  # of the cloth at a boundary vertex, below which the outline has a corner there

ROUNDS = 3  # of smoothing that take ripple off


class Weights:
    """A sparse matrix as rows of weights: ``apply`` gives, for each row, the weighted sum of values."""

    def __init__(self, rows: np.ndarray, columns: np.ndarray, weights: np.ndarray):
        order = np.argsort(rows, kind="stable")
        self.columns, self.weights = columns[order], weights[order]
        self.starts = np.searchsorted(rows[order], np.arange(rows.max() + 1))

    def apply(self, values: np.ndarray) -> np.ndarray:
        """Values (n, k) to (rows, k)."""
        return np.add.reduceat(self.weights[:, None] * values[self.columns], self.starts, axis=0)


class Level:
    """One refinement of a mesh: each triangle becomes four, each edge a vertex after the old ones.

    Args:
        triangles: of the coarse mesh, shape [m, 3].
        count: its vertices.
        corners: those that stay where they are, bool, shape [count].
    """

    def __init__(self, triangles: np.ndarray, count: int, corners: np.ndarray):
        sides = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        self.edges, self.edge_of_side, uses = np.unique(
            np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True
        )
        self.edge_of_side = self.edge_of_side.reshape(-1, 3)
        self.count, self.inner = count, uses == 2
        self.corners = np.concatenate([corners, np.zeros(len(self.edges), bool)])
        self.triangles = self._children(triangles)
        opposite = triangles[:, [2, 0, 1]]
        self.step = self._step(opposite)
        self.limit = self._limit()

    def interpolate(self, values: np.ndarray) -> np.ndarray:
        """Values at vertices of the coarse mesh, linearly to those of the fine one."""
        return np.concatenate([values, 0.5 * (values[self.edges[:, 0]] + values[self.edges[:, 1]])])

    def _children(self, triangles: np.ndarray) -> np.ndarray:
        a, b, c = triangles.T
        ab, bc, ca = (self.count + self.edge_of_side).T
        children = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        return np.stack([np.stack(child, axis=1) for child in children], axis=1).reshape(-1, 3)

    def _step(self, opposite: np.ndarray) -> Weights:
        """Vertices of the fine mesh from those of the coarse one."""
        middle = self.count + np.arange(len(self.edges))
        ends = np.where(self.inner, 0.375, 0.5)
        wing = self.inner[self.edge_of_side.ravel()]
        edge_rows = [middle, middle, (self.count + self.edge_of_side.ravel())[wing]]
        edge_columns = [self.edges[:, 0], self.edges[:, 1], opposite.ravel()[wing]]
        edge_weights = [ends, ends, np.full(wing.sum(), 0.125)]
        valence = self._valence()
        beta = np.where(valence == 3, 0.1875, 0.375 / np.maximum(valence, 1))
        rows, columns, weights = self._around(beta, 0.125)
        return Weights(
            np.concatenate([rows, *edge_rows]),
            np.concatenate([columns, *edge_columns]),
            np.concatenate([weights, *edge_weights]),
        )

    def _limit(self) -> Weights:
        """Where the limit surface has the vertices of the coarse mesh."""
        valence = self._valence()
        beta = np.where(valence == 3, 0.1875, 0.375 / np.maximum(valence, 1))
        return Weights(*self._around(1.0 / (valence + 0.375 / beta), 1.0 / 6.0))

    def _valence(self) -> np.ndarray:
        return np.bincount(self.edges.ravel(), minlength=self.count)

    def _around(self, inner_share: np.ndarray, boundary_share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Each vertex from itself and its neighbours of weight ``inner_share``, on the boundary ``boundary_share``."""
        on_boundary = np.zeros(self.count, bool)
        on_boundary[self.edges[~self.inner].ravel()] = True
        here = np.concatenate([self.edges[:, 0], self.edges[:, 1]])
        there = np.concatenate([self.edges[:, 1], self.edges[:, 0]])
        along = np.tile(~self.inner, 2)
        share = np.where(on_boundary[here], np.where(along, boundary_share, 0.0), inner_share[here])
        share[self.corners[here]] = 0.0
        kept = share > 0.0
        here, there, share = here[kept], there[kept], share[kept]
        own = 1.0 - np.bincount(here, share, minlength=self.count)
        every = np.arange(self.count)
        return np.concatenate([every, here]), np.concatenate([every, there]), np.concatenate([own, share])


class SmoothMesh:
    """A mesh and its refinements.

    Args:
        rest: rest pose [m], shape [n, 3], which shows where the outline has corners.
        triangles: shape [m, 3].
        levels: how often to refine.
    """

    def __init__(self, rest: np.ndarray, triangles: np.ndarray, levels: int):
        self.coarse = triangles
        corners = outline_corners(rest, triangles)
        self.levels: list[Level] = []
        for _ in range(levels):
            level = Level(triangles, len(corners), corners)
            self.levels.append(level)
            triangles, corners = level.triangles, level.corners

    def triangles(self, depth: int) -> np.ndarray:
        """Triangles after ``depth`` refinements."""
        return self.levels[depth - 1].triangles if depth else self.coarse

    def filtered(self, points: np.ndarray) -> np.ndarray:
        """Vertices without the ripple that cells leave along folds which run across them; wider shapes stay as large.

        With s for :data:`ROUNDS` of smoothing the filter is s (2 − s): what s takes off wide shapes is put back.
        """
        if not self.levels:
            return points

        def smooth(values: np.ndarray) -> np.ndarray:
            for _ in range(ROUNDS):
                values = self.levels[0].limit.apply(values)
            return values

        once = smooth(points)
        return once + smooth(points - once)

    def points(self, points: np.ndarray, smoothings: int = 0) -> list[np.ndarray]:
        """Vertices of the mesh and of each refinement, for vertices (n, 3) of the mesh.

        With ``smoothings`` the mesh is smoothed first: its normals then show folds, but not the single cells.
        """
        found = [points]
        for _ in range(smoothings if self.levels else 0):
            found = [self.levels[0].limit.apply(found[0])]
        for level in self.levels:
            found.append(level.step.apply(found[-1]))
        return found

    def interpolate(self, values: np.ndarray, first: int, last: int) -> np.ndarray:
        """Values at vertices after ``first`` refinements, linearly to those after ``last``."""
        for level in self.levels[first:last]:
            values = level.interpolate(values)
        return values

    def corner_values(self, values: np.ndarray) -> np.ndarray:
        """Values (m, 3, k) at the corners of triangles, linearly to the corners of the last refinement's."""
        for _ in self.levels:
            a, b, c = values[:, 0], values[:, 1], values[:, 2]
            ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
            children = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
            values = np.stack([np.stack(child, axis=1) for child in children], axis=1).reshape(-1, 3, values.shape[2])
        return values


def outline_corners(rest: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which vertices are corners of the outline, bool, shape [n]."""
    corners = rest[triangles]
    angles = np.zeros(len(rest))
    for k in range(3):
        u, v = (corners[:, (k + step) % 3] - corners[:, k] for step in (1, 2))
        sine, cosine = np.linalg.norm(np.cross(u, v), axis=1), np.sum(u * v, axis=1)
        np.add.at(angles, triangles[:, k], np.arctan2(sine, cosine))
    on_boundary = np.zeros(len(rest), bool)
    on_boundary[boundary_edges(triangles).ravel()] = True
    return on_boundary & (angles < CORNER_ANGLE)


def boundary_edges(triangles: np.ndarray) -> np.ndarray:
    """Edges of one triangle only, in its winding, shape [k, 2]."""
    sides = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, inverse, uses = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True)
    return sides[uses[inverse.ravel()] == 1]
