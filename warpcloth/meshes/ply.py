"""PLY: polygons of any size, in text or binary, with texture coordinates of vertices or of corners."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import MeshError
from .check import check_polygons
from .trianglemesh import TriangleMesh
from .triangulate import triangulate

_KINDS = {
    "char": "i1", "short": "i2", "int": "i4", "uchar": "u1", "ushort": "u2", "uint": "u4",
    "int8": "i1", "int16": "i2", "int32": "i4", "uint8": "u1", "uint16": "u2", "uint32": "u4",
    "float": "f4", "double": "f8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_HEADER = re.compile(rb"ply[ \t]*(\r\n|\n|\r)(.*?)end_header[ \t]*\1", re.DOTALL)
_CORNERS = ("vertex_indices", "vertex_index")  # there is no one name for them, nor for texture coordinates
_TEXTURE = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
_TEXTURE_OF_CORNERS = "texcoord"


@dataclass(frozen=True)
class _Element:
    """``count`` rows of ``properties``, each a name, its kind, and for lists the kind of their length."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]]


def read_ply(path: Path) -> TriangleMesh:
    """The faces of a PLY file, vertices in the file's order.

    Raises:
        MeshError: the file is damaged or not PLY, or has no faces.
    """
    try:
        tables = dict(_tables(path.read_bytes()))
        vertices, faces = tables.get("vertex", []), tables.get("face", [])
        points = np.stack([_column(vertices, axis) for axis in "xyz"], axis=1).astype(float) if vertices else None
        name = next((name for name in _CORNERS if faces and name in (faces[0].dtype.names or ())), None)
        if points is None or name is None:
            raise MeshError(f"'{path.stem}' holds no triangle mesh.")
        counts, corners = _lengths(faces, name), _column(faces, name).astype(np.int64)
        uvs, uv_of_corner = _texture(vertices, faces, counts, corners)
    except MeshError:
        raise
    except (ValueError, LookupError, OverflowError) as error:
        why = str(error) if type(error) is ValueError else type(error).__name__
        raise MeshError(f"The mesh file '{path.name}' is damaged or not PLY ({why}).") from None
    check_polygons(path.stem, points, counts, corners)
    cuts = triangulate(points, counts, corners)
    return TriangleMesh(points, corners[cuts], uvs, None if uvs is None else uv_of_corner[cuts], path.stem)


def _texture(
    vertices: list[np.ndarray], faces: list[np.ndarray], counts: np.ndarray, corners: np.ndarray
) -> tuple[np.ndarray | None, np.ndarray]:
    """Texture coordinates [k, 2], and which of them each corner has."""
    given = _TEXTURE_OF_CORNERS in (faces[0].dtype.names or ())
    if given and np.array_equal(_lengths(faces, _TEXTURE_OF_CORNERS), 2 * counts):
        uvs = _column(faces, _TEXTURE_OF_CORNERS).astype(float).reshape(-1, 2)
        return (uvs if np.isfinite(uvs).all() else None), np.arange(len(corners))
    for pair in _TEXTURE:
        if set(pair) <= set(vertices[0].dtype.names or ()):
            uvs = np.stack([_column(vertices, name) for name in pair], axis=1).astype(float)
            return (uvs if np.isfinite(uvs).all() else None), corners
    return None, corners


def _column(rows: list[np.ndarray], name: str) -> np.ndarray:
    return np.concatenate([run[name].ravel() for run in rows])


def _lengths(rows: list[np.ndarray], name: str) -> np.ndarray:
    """Lengths of the lists of a property, one for each row."""
    return np.concatenate([np.full(len(run), run[name].shape[1], np.int64) for run in rows])


def _tables(content: bytes) -> Iterator[tuple[str, list[np.ndarray]]]:
    """Each element's name and rows, as structured arrays of one or more rows whose lists are equally long."""
    header = _HEADER.match(content)
    if header is None:
        raise ValueError("it has no header")
    order, elements = _elements(header[2].decode("ascii", "replace"))
    body, at = content[header.end() :], 0
    if not order:  # text, of which all in double precision is as good as binary
        body = np.array(body.split(), float).tobytes()
    for element in elements:
        rows = []
        for run in _runs(body, at, element, order):
            rows.append(run if order else run.astype(_as_said(run.dtype, element)))
            at += run.nbytes
        yield element.name, rows


def _elements(header: str) -> tuple[str, list[_Element]]:
    """Byte order, empty for text, and elements."""
    order = ""
    elements: list[_Element] = []
    for words in map(str.split, header.splitlines()):
        if words[:1] == ["format"]:
            order = _ORDERS[words[1]]
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], int(words[2]), []))
        elif words[:2] == ["property", "list"]:
            elements[-1].properties.append((words[4], _KINDS[words[3]], _KINDS[words[2]]))
        elif words[:1] == ["property"]:
            elements[-1].properties.append((words[2], _KINDS[words[1]], None))
    return order, elements


def _runs(body: bytes, at: int, element: _Element, order: str) -> Iterator[np.ndarray]:
    """The rows of an element, as many at once as have lists of the same lengths."""
    left, ahead = element.count, 1
    lists = [f"#{name}" for name, _, length in element.properties if length]
    while left > 0:
        row = _row(body, at, element, order)
        ahead = min(ahead, left, (len(body) - at) // row.itemsize if row.itemsize else 0)
        if ahead == 0:
            raise ValueError("it ends too early")
        rows = np.frombuffer(body, row, ahead, at)
        same = np.all([rows[name] == rows[name][0] for name in lists], axis=0) if lists else np.ones(ahead, bool)
        whole = bool(same.all())
        run = rows if whole else rows[: int(np.argmin(same))]
        yield run
        left, at, ahead = left - len(run), at + run.nbytes, 2 * ahead if whole else len(run)


def _row(body: bytes, at: int, element: _Element, order: str) -> np.dtype:
    """The type of the row that begins at a byte, with the length of a list before it, under its name and a #."""
    fields: list[tuple] = []
    for name, kind, length in element.properties:
        if length:
            counted = order + length if order else "f8"
            (size,) = np.frombuffer(body, counted, 1, at + np.dtype(fields).itemsize).tolist()
            fields.append((f"#{name}", counted))
            fields.append((name, order + kind if order else "f8", (int(size),)))
        else:
            fields.append((name, order + kind if order else "f8"))
    return np.dtype(fields)


def _as_said(row: np.dtype, element: _Element) -> np.dtype:
    """The type of a row of text with the precision that the header gives each property."""
    kinds = {name: kind for name, kind, _ in element.properties}
    return np.dtype([(name, kinds.get(name, "f8"), row[name].shape) for name in row.names or ()])
