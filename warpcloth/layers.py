"""Orders layers of cloth that lie in nearly the same place: one goes above the other, by the least that parts them.

Where two pieces are nearly parallel the shortest way out of each other is along their normals. The line in which they
meet says nothing about it: it is shortest when one piece has slid off the other.
"""

import numpy as np
import warp as wp

from .meshes.topology import connected
from .tangle import Tangle

PARALLEL = 0.97  # least |cosine| between normals: what is flattened out of a steeper slope would be strained
REACH = 10.0  # gaps; what is deeper inside, and further than an edge is long, belongs to another part of the piece
EVEN = 1e-3  # gaps; heights that differ by less are the same, so that rounding chooses no side
ROUNDS = 20


def part_layers(tangle: Tangle, rounds: int) -> int:
    """Moves nearly parallel pieces of cloth that intersect apart along their normals; pins stay.

    Each pair of pieces gets the order that costs less, and its particles move until they are a thickness apart there.

    Returns:
        how many rounds it took, at most ``rounds``.
    """
    layers = _Layers(tangle)
    parting, done = tangle.tangled & layers.worlds, 0
    while parting.any() and done < min(rounds, ROUNDS):
        layers.push(parting)
        parting &= tangle.look()
        done += 1
    tangle.back()
    return done


class _Layers:
    """The pieces of cloth that are in each other, and on which side of the other each has to be."""

    def __init__(self, tangle: Tangle):
        self.tangle, self.model, surface = tangle, tangle.model, tangle.found.surface
        self.tris = surface.tri_indices.numpy()[: surface.cloth_tris]
        self.free, self.radius = tangle.free.astype(float), self.model.particle_radius.numpy().astype(float)
        self.piece = connected(self.tris[:, [0, 1]].ravel(), self.tris[:, [1, 2]].ravel(), self.model.particle_count)
        self.pairs: list[tuple[int, int, float]] = []  # a piece, another, and the side of its normals to be on
        for low, high, facing in self._parallel(tangle.found.crossings(tangle.state)[0]):
            over, under = self._heights(high, low)[1], -facing * self._heights(low, high)[1]
            heights = np.concatenate([over, under, [0.0]])
            order = 1.0 if heights.min() + heights.max() >= -EVEN * self._gap(low, high) else -1.0
            self.pairs += [(high, low, order), (low, high, -order * facing)]

    @property
    def worlds(self) -> np.ndarray:
        """Of each world, whether it has such pieces."""
        return self.tangle.worlds_with(np.isin(self.piece, [mine for mine, _, _ in self.pairs]))

    def push(self, worlds: np.ndarray) -> None:
        """Moves every particle of some worlds, a mask, by its share of what is missing between the layers."""
        moves = np.zeros((self.model.particle_count, 3))
        for mine, other, side in self.pairs:
            if worlds[self.tangle.world[mine]]:
                members, height, normals, loose = self._heights(mine, other)
                missing = np.maximum(self._gap(mine, other) - side * height, 0.0) * self.free[members]
                moves[members] += (side * missing / (1.0 + loose))[:, None] * normals
        self.tangle.place(self.tangle.positions + moves, worlds)

    def _gap(self, mine: int, other: int) -> float:
        """How far apart two pieces come to rest [m]."""
        return float(self.radius[mine] + self.radius[other])

    def _parallel(self, where: np.ndarray) -> list[tuple[int, int, float]]:
        """Pairs of pieces most of whose crossings are between nearly parallel triangles; 1 if fronts face one way."""
        where = where[(where[:, :2] < len(self.tris)).all(axis=1)]
        normals = self._normals(self.tris)
        cosines = np.einsum("ij,ij->i", normals[where[:, 0]], normals[where[:, 1]])
        pieces = np.sort(self.piece[self.tris[where[:, :2], 0]], axis=1)
        found = []
        for low, high in np.unique(pieces, axis=0).tolist():
            here = cosines[(pieces == (low, high)).all(axis=1)]
            if low != high and np.median(np.abs(here)) > PARALLEL:
                found.append((low, high, 1.0 if here.sum() >= 0.0 else -1.0))
        return found

    def _heights(self, mine: int, other: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The particles of one piece that are near another, their heights over it, its normals there, and how free
        it is there to move, from 0 to 1."""
        members = np.flatnonzero(self.piece == mine).astype(np.int32)
        tris = self.tris[self.piece[self.tris[:, 0]] == other]
        q = self.tangle.positions
        edge = float(np.linalg.norm(q[tris] - q[np.roll(tris, 1, axis=1)], axis=2).mean())
        deep = max(REACH * self._gap(mine, other), edge)
        faces, weights = self._feet(members, tris, float(np.hypot(deep, edge)))
        members, weights, tris = members[faces >= 0], weights[faces >= 0], tris[faces[faces >= 0]]
        normals, away = self._normals(tris), q[members] - np.einsum("ij,ijk->ik", weights, q[tris])
        height = np.einsum("ij,ij->i", away, normals)
        beside = np.linalg.norm(away - height[:, None] * normals, axis=1)
        near = (np.abs(height) <= deep) & (beside <= edge)  # its triangles reach over the other's border
        loose = np.einsum("ij,ij->i", weights, self.free[tris])
        return members[near], height[near], normals[near], loose[near]

    def _feet(self, members: np.ndarray, tris: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """Row of the nearest of ``tris`` to each member, −1 beyond ``reach`` [m], and the weights of its corners."""
        device, count = self.model.device, len(members)
        points = wp.array(self.tangle.positions.astype(np.float32), dtype=wp.vec3, device=device)
        layer = wp.Mesh(points, wp.array(tris.ravel(), dtype=wp.int32, device=device))
        face = wp.zeros(count, dtype=wp.int32, device=device)
        weight = wp.zeros(count, dtype=wp.vec3, device=device)
        wp.launch(
            self.model.kernels.layers.find_feet,
            dim=count,
            inputs=[wp.array(members, device=device), reach, self.tangle.state.particle_q, layer.id],
            outputs=[face, weight],
            device=device,
        )
        return face.numpy(), weight.numpy().astype(float)

    def _normals(self, tris: np.ndarray) -> np.ndarray:
        a, b, c = np.moveaxis(self.tangle.positions[tris].astype(float), 1, 0)
        across = np.cross(b - a, c - a)
        return across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
