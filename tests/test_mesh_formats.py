"""What writers of mesh files do besides what everybody does."""

import numpy as np

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


def test_solids_of_an_stl_file_are_one_mesh(tmp_path):
    """There is no way to choose one of them, nor need there be."""
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 {z}\nvertex 1 0 {z}\nvertex 1 1 {z}\nendloop\nendfacet\n"
    solids = [f"solid part{z}\n{facet.format(z=z)}endsolid part{z}\n" for z in (0, 1)]
    (tmp_path / "parts.stl").write_text("".join(solids))
    mesh = read_mesh(tmp_path / "parts.stl")
    assert (mesh.name, len(mesh.points), area(mesh)) == ("parts", 6, 1.0)
