"""PLY: polygons of any size, in text or binary, with texture coordinates of vertices or of corners."""

import re
import struct
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


@dataclass(frozen=True)
class _Column:
    """Values of a property, row after row, and how many each row has: one, where it is no list."""

    values: np.ndarray
    lengths: np.ndarray


_Columns = dict[str, _Column]


def read_ply(path: Path) -> TriangleMesh:
    """The faces of a PLY file, vertices in the file's order.

    Raises:
        MeshError: the file is damaged or not PLY, or has no faces.
    """
    try:
        tables = dict(_tables(path.read_bytes()))
        vertices, faces = tables.get("vertex", {}), tables.get("face", {})
        points = np.stack([vertices[axis].values for axis in "xyz"], axis=1).astype(float) if vertices else None
        name = next((name for name in _CORNERS if name in faces), None)
        if points is None or name is None:
            raise MeshError(f"'{path.stem}' holds no triangle mesh.")
        counts, corners = faces[name].lengths, faces[name].values.astype(np.int64)
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
    vertices: _Columns, faces: _Columns, counts: np.ndarray, corners: np.ndarray
) -> tuple[np.ndarray | None, np.ndarray]:
    """Texture coordinates [k, 2], and which of them each corner has."""
    given = faces.get(_TEXTURE_OF_CORNERS)
    if given is not None and np.array_equal(given.lengths, 2 * counts):
        uvs = given.values.astype(float).reshape(-1, 2)
        return (uvs if np.isfinite(uvs).all() else None), np.arange(len(corners))
    for pair in _TEXTURE:
        if set(pair) <= set(vertices):
            uvs = np.stack([vertices[name].values for name in pair], axis=1).astype(float)
            return (uvs if np.isfinite(uvs).all() else None), corners
    return None, corners


def _tables(content: bytes) -> Iterator[tuple[str, _Columns]]:
    """Each element's name and columns; none where it has no rows."""
    header = _HEADER.match(content)
    if header is None:
        raise ValueError("it has no header")
    order, elements = _elements(header[2].decode("ascii", "replace"))
    body, at = content[header.end() :], 0
    if not order:  # text, of which all in double precision is as good as binary
        body = np.array(body.split(), float).tobytes()
    for element in elements:
        columns, at = _columns(body, at, element, order) if element.count > 0 else ({}, at)
        yield element.name, columns


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


def _columns(body: bytes, at: int, element: _Element, order: str) -> tuple[_Columns, int]:
    """The columns of an element that begins at a byte, and where it ends."""
    row = _row(body, at, element, order)
    lists = [f"#{name}" for name, _, length in element.properties if length]
    if row.itemsize * element.count <= len(body) - at:
        rows = np.frombuffer(body, row, element.count, at)
        if all((rows[name] == rows[name][0]).all() for name in lists):
            columns = {}
            for name, kind, _ in element.properties:
                lengths = np.full(element.count, rows[name][0].size, np.int64)
                columns[name] = _Column(rows[name].astype(kind).ravel(), lengths)
            return columns, at + rows.nbytes
    if not lists:
        raise ValueError("it ends too early")
    return _columns_of_unlike_rows(body, at, element, order)


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


def _columns_of_unlike_rows(body: bytes, at: int, element: _Element, order: str) -> tuple[_Columns, int]:
    """The same where lists differ in length, so that only a row says where the next one begins."""
    properties = []
    for _, kind, length in element.properties:
        lead = struct.Struct((order or "=") + np.dtype(length if order else "f8").char) if length else None
        properties.append((lead, np.dtype(order + kind if order else "f8")))
    starts, lengths, end = _walked(body, at, element.count, properties)
    octets, columns = np.frombuffer(body, np.uint8), {}
    for i, (name, said, _) in enumerate(element.properties):
        stored, many = properties[i][1], lengths[:, i]
        first = starts[:, i] - stored.itemsize * (np.cumsum(many) - many)  # as if all of the values stood together
        places = np.repeat(first, many) + stored.itemsize * np.arange(many.sum())
        values = octets[places[:, None] + np.arange(stored.itemsize)].view(stored).ravel()
        columns[name] = _Column(values.astype(said), many)
    return columns, end


def _walked(
    body: bytes, at: int, count: int, properties: list[tuple[struct.Struct | None, np.dtype]]
) -> tuple[np.ndarray, np.ndarray, int]:
    """Where the values of each property of each row start, how many they are, both [count, properties], and the end."""
    starts, lengths = [], []
    for _ in range(count):
        for lead, kind in properties:
            size = 1
            if lead is not None:
                if at + lead.size > len(body):
                    raise ValueError("it ends too early")
                size, at = int(lead.unpack_from(body, at)[0]), at + lead.size
            starts.append(at)
            lengths.append(size)
            at += size * kind.itemsize
            if size < 0 or at > len(body):
                raise ValueError("it ends too early" if size > 0 else "a list has a negative length")
    shape = (count, len(properties))
    return np.array(starts, np.int64).reshape(shape), np.array(lengths, np.int64).reshape(shape), at
