"""OFF: polygons of any size, in text."""

import re
from pathlib import Path

import numpy as np

from ..errors import MeshError
from .check import check_polygons
from .trianglemesh import TriangleMesh
from .triangulate import triangulate

_KEYWORD = re.compile("(ST)?C?N?OFF")  # whichever a vertex has besides, its coordinates come first


def read_off(path: Path) -> TriangleMesh:
    """The faces of an OFF file, vertices in the file's order; colours, normals and texture coordinates are left out.

    Raises:
        MeshError: the file is damaged, binary or not OFF, or has no faces.
    """
    try:
        points, counts, corners = _parsed(path.read_text(encoding="utf-8-sig", errors="replace"))
    except (ValueError, IndexError, OverflowError) as error:
        why = str(error) if type(error) is ValueError else type(error).__name__
        raise MeshError(f"The mesh file '{path.name}' is damaged or not OFF ({why}).") from None
    check_polygons(path.stem, points, counts, corners)
    return TriangleMesh(points, corners[triangulate(points, counts, corners)], name=path.stem)


def _parsed(text: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points [n, 3], corners of each face [f], and vertices of all corners."""
    lines = [words for line in text.split("\n") if (words := line.split("#", 1)[0].split())]
    if not lines or not _KEYWORD.fullmatch(lines[0][0]):
        raise ValueError("it does not begin with OFF")
    sizes, rows = (lines[0][1:], lines[1:]) if len(lines[0]) > 1 else (lines[1], lines[2:])
    if sizes[0] == "BINARY":
        raise ValueError("it is binary, and only text is read")
    vertices, faces = int(sizes[0]), int(sizes[1])
    if min(vertices, faces) < 0 or len(rows) < vertices + faces:
        raise ValueError(f"it has {len(rows)} lines for {vertices} vertices and {faces} faces")
    points = [[float(word) for word in (words[0], words[1], words[2])] for words in rows[:vertices]]
    corners: list[int] = []
    counts = []
    for words in rows[vertices : vertices + faces]:  # colours may follow
        counts.append(int(words[0]))
        corners.extend(int(words[1 + corner]) for corner in range(counts[-1]))
    return np.array(points).reshape(-1, 3), np.array(counts, np.int64), np.array(corners, np.int64)
