"""Damaged and missing mesh files: each kind of damage has its own sentence."""

import os
import shutil

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from usd_files import SQUARE, write_usd

from warpcloth.cloth import Cloth
from warpcloth.errors import InputError, MeshError
from warpcloth.meshes import read_mesh

TRIANGLE = "0 0 0\n1 0 0\n0 1 0\n"


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.obj", "", "'a.obj' is empty: it has 0 bytes"),
        ("a.obj", "# nothing", "is empty: it has 0 vertices and 0 faces"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "is empty: it has 3 vertices and 0 faces"),
        ("a.obj", "o cube\nmtllib a.mtl\n", "is empty: it has 0 vertices and 0 faces"),
        (
            "a.obj",
            f"OFF\n3 1 0\n{TRIANGLE}3 0 1 2\n",
            "'a.obj' is damaged or not OBJ: no line of it gives a vertex, as",
        ),
        ("a.obj", "\0" * 80 + "\1\0\0\0" + "\0\0\200?" * 12 + "\0\0", "'a.obj' is damaged or not OBJ: no line of it"),
        ("a.obj", "solid a\nfacet normal 0 0 1\nvertex 0 0 0\n", "'a.obj' is damaged or not OBJ: no line of it gives"),
        ("a.obj", "v 0 0\n", "a.obj, line 1: cannot read 'v 0 0'"),
        ("a.obj", "v 0 0 0\nf 1 1\n", "line 2: cannot read 'f 1 1'"),
        ("a.obj", "v 0 0 0\nf 1 x 2\n", "line 2: cannot read 'f 1 x 2'"),
        ("a.obj", "v 0 0 0\nf 0 1 1\n", "line 2"),
        ("a.obj", "v 0 0 0\nf -2 -1 -1\n", "line 2"),
        ("a.obj", "v 0 0 0\nf 1 1 5\n", "refers to vertex 5, which is not one of 1 to 1"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n", "1 vertex is not finite .* first vertex 2"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 inf 0\nf 1 2 3\n", "1 vertex is not finite"),
        (
            "a.obj",
            "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n",
            "1 triangle has no area, first triangle 0 with vertices 0, 1, 2",
        ),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 3\n", "1 triangles repeat others, first triangle 1"),
        ("a.ply", "ply", "'a.ply' is damaged or not PLY"),
        ("a.stl", "solid a\nendsolid a\n", "'a.stl' holds no triangle that can be read: it is cut off or not STL"),
        ("a.stl", "\0" * 80 + "\2\0\0\0" + "\0" * 50, "'a.stl' holds no triangle that can be read: it is cut off"),
        ("a.off", "OFF", "'a.off' is damaged or not OFF"),
        ("a.glb", "x", "'a.glb' is damaged or not GLB"),
        ("a.gltf", "{", "'a.gltf' is damaged or not GLTF"),
        ("a.usda", "#usda 1.0\n(", "'a.usda' cannot be read"),
        ("a.usda", "#usda 1.0\n", "'a' holds no triangle mesh"),
        ("a.usdc", "PXR-USDC", "'a.usdc' cannot be read"),
        ("a.usdz", "PK", "'a.usdz' cannot be read"),
        ("a.usd", "x", "'a.usd' cannot be read"),
        ("a.fbx", "", "is of no known kind; known are OBJ, PLY"),
    ],
)
def test_damaged_files(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(MeshError, match=words) as caught:
        Cloth.from_mesh(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_obj_files_in_another_encoding_are_not_said_to_be_empty(tmp_path, encoding):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding=encoding)
    words = r"no line of it gives a vertex, as 'v 0 0 1' does in UTF-8 text\.$"
    with pytest.raises(MeshError, match=f"^The mesh file 'a.obj' is damaged or not OBJ: {words}"):
        read_mesh(tmp_path / "a.obj")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"points": []}, "is empty"),
        ({"counts": []}, "is empty: it has 4 vertices and 0 faces"),
        ({"counts": [3]}, "its faces have 3 corners, but 4 vertex indices are given"),
        ({"counts": [2, 2]}, "face 0 has 2 corners"),
        ({"indices": [0, 1, 2, 9]}, "refers to vertex 9"),
        ({"points": [(0, 0, float("nan")), *SQUARE[1:]]}, "1 vertex is not finite"),
        ({"points": np.zeros((4, 3))}, "2 triangles have no area"),
    ],
)
def test_damaged_usd_meshes(tmp_path, change, words):
    stage, _ = write_usd(tmp_path / "a.usda", **change)
    stage.Save()
    with pytest.raises(MeshError, match=words):
        Cloth.from_mesh(tmp_path / "a.usda")


def test_missing_files_propose_the_closest_name(tmp_path):
    (tmp_path / "shirt.obj").write_text("#")
    with pytest.raises(MeshError, match=r"No mesh file 'shrt.obj' in .* \(did you mean 'shirt.obj'\?\)"):
        read_mesh(tmp_path / "shrt.obj")
    with pytest.raises(MeshError, match=r"No asset 'warp:buny.usd' ships with Warp \(did you mean 'bunny.usd'\?\)"):
        read_mesh("warp:buny.usd")
    for source, words in (
        (tmp_path, "is a folder"),
        (tmp_path / "no" / "a.obj", "folder .* does not exist"),
        (3, "got int"),
    ):
        with pytest.raises(MeshError, match=words):
            read_mesh(source)
    with pytest.raises(MeshError, match="cannot be chosen"):
        read_mesh(tmp_path / "shirt.obj", prim="/shirt")


def test_links_that_lead_nowhere_are_said_to_be(tmp_path):
    (tmp_path / "shirt2.obj").write_text("#")  # which nobody means
    (tmp_path / "shirt.obj").symlink_to("gone.obj")
    (tmp_path / "ring.obj").symlink_to("ring.obj")
    for name, target in (("shirt", "gone"), ("ring", "ring")):
        with pytest.raises(MeshError, match=rf"{name}.obj' is a link that leads nowhere: it says '{target}.obj'\.$"):
            read_mesh(tmp_path / f"{name}.obj")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_pipes_and_devices_are_no_mesh_files(tmp_path):
    os.mkfifo(tmp_path / "pipe.obj")
    for path in (tmp_path / "pipe.obj", os.devnull):
        with pytest.raises(
            MeshError, match=rf"^'{path}' is a pipe or device; save the mesh to a file and name that\.$"
        ):
            read_mesh(path)


FACTORY = trimesh.creation.icosphere(1)


@pytest.fixture(scope="module")
def sound_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sound")
    for suffix in ("obj", "ply", "stl", "off", "glb"):
        FACTORY.export(folder / f"a.{suffix}")
    gltf = trimesh.exchange.gltf.export_gltf(trimesh.Scene(FACTORY))
    for name, data in gltf.items():
        (folder / name).write_bytes(data)
    shutil.move(folder / "model.gltf", folder / "a.gltf")
    for suffix in ("usda", "usdc"):
        stage, _ = write_usd(
            folder / f"a.{suffix}", points=FACTORY.vertices, counts=[3] * 80, indices=FACTORY.faces.ravel().tolist()
        )
        stage.Save()
    return folder


@given(data=st.data())
def test_damaged_or_truncated_files_load_or_say_why(sound_files, data):
    suffix = data.draw(st.sampled_from(["obj", "ply", "stl", "off", "glb", "gltf", "usda", "usdc"]))
    content = bytearray((sound_files / f"a.{suffix}").read_bytes())
    flips = 0 if suffix == "usdc" else data.draw(st.integers(0, 4))  # OpenUSD itself can die of flipped bytes in .usdc
    for _ in range(flips):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    end = data.draw(st.one_of(st.just(len(content)), st.integers(0, len(content))))
    path = sound_files / f"damaged.{suffix}"
    path.write_bytes(bytes(content[:end]))
    message = "."
    try:
        Cloth.from_mesh(path)
    except InputError as error:
        message = str(error)
    assert message.endswith(".")
    assert "\n" not in message
