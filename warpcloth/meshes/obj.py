"""Wavefront OBJ: vertices in the file's order, polygons of any size, texture seams that do not split vertices."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..errors import MeshError
from .check import refuse_non_finite
from .trianglemesh import TriangleMesh
from .triangulate import triangulate

_KEYWORDS = ("v", "vt", "vn", "vp", "f", "l", "p", "g", "o", "s", "mtllib", "usemtl")


def read_obj(path: Path) -> TriangleMesh:
    """All faces of an OBJ file as one mesh; groups, objects and materials do not divide it.

    Raises:
        MeshError: naming the line that cannot be read; or there are no faces, or the file is not OBJ.
    """
    points: list[list[float]] = []
    uvs: list[list[float]] = []
    counts: list[int] = []
    corners: list[tuple[int, int]] = []
    for number, words in _statements(path):
        try:
            if words[0] == "v":
                points.append([float(word) for word in words[1:4]])
            elif words[0] == "vt":
                uvs.append([float(word) for word in (*words[1:3], "0")[:2]])
            elif words[0] == "f":
                counts.append(len(words) - 1)
                corners.extend(_corner(word, len(points), len(uvs)) for word in words[1:])
            complete = not (words[0] == "v" and len(points[-1]) < 3) and not (words[0] == "f" and counts[-1] < 3)
        except (ValueError, IndexError):
            complete = False
        if not complete:
            raise MeshError(f"{path.name}, line {number}: cannot read {' '.join(words)[:60]!r}.")
    if not points and any(words[0] not in _KEYWORDS for _, words in _lines(path)):
        rule = "no line of it gives a vertex, as 'v 0 0 1' does in UTF-8 text"
        raise MeshError(f"The mesh file '{path.name}' is damaged or not OBJ: {rule}.")
    return _mesh(path.stem, points, uvs, counts, np.array(corners, np.int64).reshape(-1, 2))


def _mesh(name: str, points: list, uvs: list, counts: list[int], corners: np.ndarray) -> TriangleMesh:
    if not counts:
        raise MeshError(f"Mesh '{name}' is empty: it has {len(points)} vertices and 0 faces.")
    vertices = np.array(points, float).reshape(-1, 3)
    refuse_non_finite(vertices, f"mesh '{name}'")
    outside = np.flatnonzero((corners[:, 0] < 0) | (corners[:, 0] >= len(vertices)))
    if outside.size:
        bad = corners[outside[0], 0] + 1
        raise MeshError(f"Mesh '{name}': a face refers to vertex {bad}, which is not one of 1 to {len(vertices)}.")
    triangles = triangulate(vertices, np.array(counts), corners[:, 0])
    textured = len(uvs) > 0 and np.all((corners[:, 1] >= 0) & (corners[:, 1] < len(uvs)))
    uv_indices = corners[:, 1][triangles] if textured else None
    return TriangleMesh(vertices, corners[:, 0][triangles], np.array(uvs) if textured else None, uv_indices, name)


def _corner(word: str, points: int, uvs: int) -> tuple[int, int]:
    """Vertex and texture coordinate of "v", "v/vt", "v//vn" or "v/vt/vn", counted from 0; −1: none."""
    fields = word.split("/")
    vertex = int(fields[0])
    texture = int(fields[1]) if len(fields) > 1 and fields[1] else 0
    first = vertex - 1 if vertex > 0 else _from_end(vertex, points)
    return first, texture - 1 if texture >= 0 else _from_end(texture, uvs)


def _from_end(index: int, count: int) -> int:
    """A negative index counts back from the last item so far; 0 and what reaches too far back is refused."""
    if not -count <= index < 0:
        raise ValueError
    return count + index


def _statements(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and words of "v", "vt" and "f" statements."""
    return ((number, words) for number, words in _lines(path) if words[0] in ("v", "vt", "f"))


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Numbers and words of lines that have any besides comments, continuation lines joined."""
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").split("\n")
    except OSError as error:
        raise MeshError(f"The mesh file '{path}' cannot be read: {error.strerror}.") from None
    pending = ""
    for number, line in enumerate(lines, 1):
        text = pending + line.split("#", 1)[0]
        pending = text.rstrip()[:-1] + " " if text.rstrip().endswith("\\") else ""
        words = text.split()
        if not pending and words:
            yield number, words
