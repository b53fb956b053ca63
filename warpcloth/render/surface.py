"""What is drawn: triangles with normals, a colour and a look; cloth as a shell with two sides and a rim."""

from dataclasses import dataclass, field

import numpy as np

from ..scenes.usd.surface import vertex_normals
from .refine import SmoothMesh, boundary_edges

BAKED_VERTICES = 20_000  # most per side of a cloth at which light is gathered
DRAWN_VERTICES = 80_000  # most per side that are drawn
MOST_LEVELS = 3
NORMAL_SMOOTHINGS = 2


@dataclass(eq=False)
class Surface:
    """Triangles that receive light.

    Attributes:
        points, normals: shape [n, 3]; normals point to the side that is seen.
        triangles: shape [m, 3].
        albedo: linear colour, shape [3] or [n, 3].
        sheen: strength of the soft rim that fibres give cloth. gloss: strength of a highlight, of solids.
        translucency: share of the light on the other side that comes through.
        twin: the vertex on the other side of each vertex, or None.
        light: what each vertex sees of sun, sky and ground, from :mod:`warpcloth.render.bake`, shape [n, 3].
        texture: vertices by texture coordinates, or None.
        pattern: the texture, an image that colours are multiplied with, or None.
    """

    points: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    albedo: np.ndarray
    sheen: float = 0.0
    gloss: float = 0.0
    translucency: float = 0.0
    twin: np.ndarray | None = None
    light: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    texture: "TexturedVertices | None" = None
    pattern: np.ndarray | None = None


class TexturedVertices:
    """A vertex for each pair of vertex and texture coordinates, as a drawing library wants them.

    Args:
        triangles: shape [m, 3]. uvs: texture coordinates at their corners, shape [m, 3, 2].

    Attributes:
        vertex: the vertex that each one stands for, shape [k]. uvs: its coordinates, shape [k, 2].
        triangles: over these, shape [m, 3].
    """

    def __init__(self, triangles: np.ndarray, uvs: np.ndarray):
        corners = np.column_stack([triangles.ravel(), uvs.reshape(-1, 2)])
        distinct, inverse = np.unique(np.round(corners, 9), axis=0, return_inverse=True)
        self.vertex, self.uvs = distinct[:, 0].astype(int), distinct[:, 1:]
        self.triangles = inverse.reshape(-1, 3)


class ClothShell:
    """A cloth as it is drawn: refined, with a front, a back half a thickness apart from the middle, and a rim.

    Args:
        rest: rest pose [m], shape [n, 3]. triangles: shape [m, 3]. uvs: at corners, shape [m, 3, 2], or None.
        thickness: [m].
        layered: whether other cloth may lie on it, so that it must not be smoothed.
    """

    def __init__(
        self,
        rest: np.ndarray,
        triangles: np.ndarray,
        uvs: np.ndarray | None,
        thickness: float,
        layered: bool = False,
    ):
        self.thickness, self.layered = thickness, layered
        self.baked = _levels_below(len(rest), BAKED_VERTICES)
        self.drawn = max(self.baked, _levels_below(len(rest), DRAWN_VERTICES))
        self.mesh = SmoothMesh(rest, triangles, self.drawn)
        self._triangles = {depth: self._closed(depth) for depth in {self.baked, self.drawn}}
        self.texture: TexturedVertices | None = None
        if uvs is not None:
            fine = self.mesh.corner_values(uvs)
            closed = self._triangles[self.drawn]
            rim = np.zeros((len(closed) - 2 * len(fine), 3, 2))
            self.texture = TexturedVertices(closed, np.concatenate([fine, fine[:, ::-1], rim]))

    def place(self, points: np.ndarray) -> tuple["Sides", "Sides"]:
        """The shell at vertices (n, 3) [m], as coarse as light is gathered at and as fine as it is drawn."""
        points = points if self.layered else self.mesh.filtered(points)
        levels, smoothed = self.mesh.points(points), self.mesh.points(points, NORMAL_SMOOTHINGS)
        coarse, fine = (self._sides(levels[depth], smoothed[depth], depth) for depth in (self.baked, self.drawn))
        return coarse, fine

    def refined(self, values: np.ndarray) -> np.ndarray:
        """Values at the cloth's vertices, linearly to one side of what is drawn."""
        return self.mesh.interpolate(values, 0, self.drawn)

    def refined_light(self, light: np.ndarray) -> np.ndarray:
        """Light at both sides as baked, smoothed a little, linearly to both sides as drawn."""
        sides = np.split(light, 2)
        if self.baked < self.drawn:
            sides = [self.mesh.levels[self.baked].limit.apply(side) for side in sides]
        return np.concatenate([self.mesh.interpolate(side, self.baked, self.drawn) for side in sides])

    def _sides(self, middle: np.ndarray, smoothed: np.ndarray, depth: int) -> "Sides":
        triangles = self.mesh.triangles(depth)
        normals = vertex_normals(smoothed, triangles)
        half = 0.5 * self.thickness * vertex_normals(middle, triangles)
        return Sides(
            points=np.concatenate([middle + half, middle - half]),
            normals=np.concatenate([normals, -normals]),
            triangles=self._triangles[depth],
        )

    def _closed(self, depth: int) -> np.ndarray:
        """Triangles of both sides and the rim, shape [2 m + 2 k, 3]."""
        triangles = self.mesh.triangles(depth)
        count = int(triangles.max()) + 1
        a, b = boundary_edges(triangles).T
        rim = [np.stack([a, a + count, b], axis=1), np.stack([b, a + count, b + count], axis=1)]
        return np.concatenate([triangles, triangles[:, ::-1] + count, *rim])


@dataclass(eq=False)
class Sides:
    """Both sides of a cloth, the front's vertices before the back's; the triangles close the gap along the outline."""

    points: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray

    @property
    def twin(self) -> np.ndarray:
        """The vertex on the other side of each."""
        count = len(self.points) // 2
        return np.concatenate([np.arange(count, 2 * count), np.arange(count)])


def _levels_below(count: int, most: int) -> int:
    """How often a mesh of ``count`` vertices is refined so as to have at most ``most``."""
    levels = 0
    while levels < MOST_LEVELS and count * 4 ** (levels + 1) <= most:
        levels += 1
    return levels
