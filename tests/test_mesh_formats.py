"""What writers of mesh files do besides what everybody does."""

import struct

import numpy as np
import pytest

from warpcloth.errors import MeshError
from warpcloth.meshes import ply as ply_file
from warpcloth.meshes import read_mesh

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def area(mesh) -> float:
    a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def test_a_byte_order_mark_does_not_hide_the_first_vertex(tmp_path):
    """Without that vertex all others have the numbers of those before them, and some faces still find theirs."""
    (tmp_path / "square.obj").write_text(f"{SQUARE}v 9 9 9\nf 1 2 3 4\n", encoding="utf-8-sig")
    mesh = read_mesh(tmp_path / "square.obj")
    np.testing.assert_array_equal(mesh.points, [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])


@pytest.mark.parametrize("between", ["\n", "\r\n", "\r"])
def test_only_ends_of_lines_end_the_lines_of_an_obj_file(tmp_path, between):
    """In a comment there may be anything, also what Unicode calls a line separator."""
    lines = ["# caf\x85 v 9 9 9 \u2028 v 8 8 8", *SQUARE.splitlines(), "f 1 2 3 4", ""]
    (tmp_path / "square.obj").write_bytes(between.join(lines).encode())
    assert read_mesh(tmp_path / "square.obj").points.max() == 1.0


def test_solids_of_an_stl_file_are_one_mesh(tmp_path):
    """There is no way to choose one of them, nor need there be."""
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 {z}\nvertex 1 0 {z}\nvertex 1 1 {z}\nendloop\nendfacet\n"
    solids = [f"solid part{z}\n{facet.format(z=z)}endsolid part{z}\n" for z in (0, 1)]
    (tmp_path / "parts.stl").write_text("".join(solids))
    mesh = read_mesh(tmp_path / "parts.stl")
    assert (mesh.name, len(mesh.points), area(mesh)) == ("parts", 6, 1.0)


POINTS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 0.5, 0), (0, 2, 0), (3, 0, 0), (3, 1, 0)]
FACES = [(0, 1, 2, 3, 4), (1, 5, 2), (5, 6, 2)]  # an arrow, which is concave, and two triangles

COLOURS = ("", " 0.5 0.5 0.5", " 255 0 0 255")  # of faces, in OFF files


def ply(faces, kind: str) -> bytes:
    """As Blender writes it, with texture coordinates of vertices, and with an element that nobody asked for."""
    header = f"ply\nformat {kind} 1.0\ncomment made by hand\nelement vertex {len(POINTS)}\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "s", "t"))
    header += "element edge 1\nproperty int vertex1\nproperty int vertex2\n"
    header += f"element face {len(faces)}\nproperty uchar flags\nproperty list uchar uint vertex_indices\nend_header\n"
    if kind == "ascii":
        rows = [(*p, p[0] / 4, p[1] / 4) for p in POINTS] + [(0, 1)] + [(7, len(face), *face) for face in faces]
        return (header + "".join(" ".join(map(str, row)) + "\n" for row in rows)).encode()
    order = "<" if kind == "binary_little_endian" else ">"
    body = b"".join(struct.pack(f"{order}5f", *p, p[0] / 4, p[1] / 4) for p in POINTS) + struct.pack(f"{order}2i", 0, 1)
    faced = (struct.pack(f"{order}BB{len(face)}I", 7, len(face), *face) for face in faces)
    return header.encode() + body + b"".join(faced)


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(
    "faces",
    [FACES, FACES[:1], FACES[1:], FACES * 3, FACES[::-1], FACES[:2] * 40],
    ids=["mixed", "arrow", "threes", "again", "back", "in turn"],
)
def test_polygons_of_ply_files_are_cut_as_those_of_obj_files(tmp_path, kind, faces):
    (tmp_path / "a.ply").write_bytes(ply(faces, kind))
    lines = [f"v {x} {y} {z}\nvt {x / 4} {y / 4}\n" for x, y, z in POINTS]
    lines += ["f " + " ".join(f"{i + 1}/{i + 1}" for i in face) + "\n" for face in faces]
    (tmp_path / "a.obj").write_text("".join(lines))
    got, wanted = read_mesh(tmp_path / "a.ply"), read_mesh(tmp_path / "a.obj")
    for name in ("points", "triangles", "uvs", "uv_indices"):
        np.testing.assert_array_equal(getattr(got, name), getattr(wanted, name))


def test_faces_whose_sizes_take_turns_are_not_read_each_by_itself(tmp_path, monkeypatch):
    """Types of rows, which are slow to make, are made once for each element, however often sizes change."""
    made = []
    monkeypatch.setattr(ply_file, "_row", lambda *given, row=ply_file._row: made.append(given) or row(*given))
    (tmp_path / "a.ply").write_bytes(ply(FACES[:2] * 40, "binary_little_endian"))
    read_mesh(tmp_path / "a.ply")
    assert len(made) == 3  # vertices, edges and faces


def test_texture_coordinates_of_corners_of_ply_files(tmp_path):
    """A list of pairs for each face, as MeshLab writes them."""
    text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    text += "element face 1\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
    (tmp_path / "a.ply").write_text(text + "0 0 0\n1 0 0\n1 1 0\n3 2 0 1 6 0.5 0.25 0 1 1 0\n")
    mesh = read_mesh(tmp_path / "a.ply")
    np.testing.assert_array_equal(mesh.uvs[mesh.uv_indices][0], [(0.5, 0.25), (0, 1), (1, 0)])
    np.testing.assert_array_equal(mesh.triangles, [(2, 0, 1)])


@pytest.mark.parametrize(
    ("faces", "words"),
    [
        ([(0, 1)], "face 0 has 2 corners, but needs 3 or more"),
        ([(0, 1, 9)], "a face refers to vertex 9, which is not one of 0 to 6"),
        ([], "holds no triangle mesh"),
    ],
)
def test_faces_of_ply_files_that_are_none(tmp_path, faces, words):
    for kind in ("ascii", "binary_little_endian"):
        (tmp_path / "a.ply").write_bytes(ply(faces, kind))
        with pytest.raises(MeshError, match=words):
            read_mesh(tmp_path / "a.ply")
    (tmp_path / "cut.ply").write_bytes(ply(FACES, "binary_little_endian")[:-3])
    with pytest.raises(MeshError, match="it ends too early"):
        read_mesh(tmp_path / "cut.ply")


@pytest.mark.parametrize("keyword", ["OFF\n", "# by hand\n\nCOFF ", "NOFF\n", "\ufeffSTOFF\n"])
def test_polygons_of_off_files_are_cut_as_those_of_obj_files(tmp_path, keyword):
    """trimesh cuts concave ones into triangles that overlap."""
    lines = [f"{x} {y} {z} 0.5 0.5 0.5 1  # {x}\n" for x, y, z in POINTS]
    lines += [f"{len(face)} {' '.join(map(str, face))}{colour}\n" for face, colour in zip(FACES, COLOURS, strict=True)]
    (tmp_path / "a.off").write_text(f"{keyword}{len(POINTS)} {len(FACES)} 0\n{''.join(lines)}", encoding="utf-8")
    lines = [f"v {x} {y} {z}\n" for x, y, z in POINTS]
    lines += ["f " + " ".join(str(i + 1) for i in face) + "\n" for face in FACES]
    (tmp_path / "a.obj").write_text("".join(lines))
    got, wanted = read_mesh(tmp_path / "a.off"), read_mesh(tmp_path / "a.obj")
    for name in ("points", "triangles"):
        np.testing.assert_array_equal(getattr(got, name), getattr(wanted, name))
    assert area(got) == pytest.approx(4.0)


CORNERS = "0 0 0\n1 0 0\n0 1 0\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"4OFF\n3 1 0\n{CORNERS}3 0 1 2\n", "it does not begin with OFF"),
        ("OFF BINARY\n", "it is binary, and only text is read"),
        (f"OFF\n3 2 0\n{CORNERS}3 0 1 2\n", "it has 4 lines for 3 vertices and 2 faces"),
        (f"OFF\n3 -1 0\n{CORNERS}", "it has 3 lines for 3 vertices and -1 faces"),
        (f"OFF\n3 1 0\n{CORNERS}4 0 1 2\n", "is damaged or not OFF"),
        (f"OFF\n3 1 0\n{CORNERS}-1 0 1 2\n", "face 0 has -1 corners, but needs 3 or more"),
        (f"OFF\n3 1 0\n{CORNERS}3 0 1 3\n", "a face refers to vertex 3, which is not one of 0 to 2"),
        (f"OFF\n3 0 0\n{CORNERS}", "is empty: it has 3 vertices and 0 triangles"),
        ("OFF\n0 0 0\n", "is empty"),
    ],
)
def test_damaged_off_files(tmp_path, text, words):
    (tmp_path / "a.off").write_text(text)
    with pytest.raises(MeshError, match=words):
        read_mesh(tmp_path / "a.off")
