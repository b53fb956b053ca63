"""What glTF needs besides trimesh: its axes, and texture coordinates, which trimesh keeps only beside loaded images."""

import importlib.util
import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MeshError

TEXTURE = "_WARPCLOTH_ST"  # trimesh hands attributes that begin with an underscore through
Y_UP_TO_Z_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])

# How the extensions begin that a file may require: they change how a mesh looks, not its shape, or trimesh reads them.
_READ_EXTENSIONS = (
    "KHR_mesh_quantization",
    *("KHR_materials_", "ADOBE_materials_", "NV_materials_", "KHR_techniques_webgl"),
    *("KHR_texture_", "EXT_texture_", "GOOGLE_texture_", "MSFT_texture_", "MSFT_packing_"),
    *("KHR_lights_", "EXT_lights_", "KHR_animation_pointer", "KHR_xmp"),
)
_DRACO = "KHR_draco_mesh_compression"
_READ = ("POSITION", "TEXCOORD_0", "indices")
_HEADER = struct.Struct("<4sII")  # magic, version, length
_CHUNK = struct.Struct("<I4s")  # length, type


def with_texture_attribute(path: Path) -> io.BytesIO:
    """The file with each TEXCOORD_0 also under the name ``TEXTURE``; origin at the upper left, as glTF has it.

    Raises:
        MeshError: when it needs an extension that trimesh does not read, such as a compression, or holds what trimesh
            would read wrongly: a node below two others, which it puts below one of them, or a mesh in a sparse
            accessor, of which it reads all but what makes it sparse, or in fractions noted as whole numbers.
        ValueError, KeyError, …: when the file is not glTF.
    """
    content = path.read_bytes()
    if path.suffix.lower() == ".gltf":
        return io.BytesIO(_renamed(content, path.name))
    magic, version, _ = _HEADER.unpack_from(content)
    length, kind = _CHUNK.unpack_from(content, _HEADER.size)
    if magic != b"glTF" or kind != b"JSON":
        raise ValueError("incorrect header on GLB file")
    start = _HEADER.size + _CHUNK.size
    text = _renamed(content[start : start + length], path.name)
    text += b" " * (-len(text) % 4)
    rest = content[start + length :]
    total = start + len(text) + len(rest)
    return io.BytesIO(_HEADER.pack(magic, version, total) + _CHUNK.pack(len(text), kind) + text + rest)


def gltf_texture(mesh: Any) -> np.ndarray | None:
    """Texture coordinates [n, 2] that :func:`with_texture_attribute` kept, origin at the lower left, or None."""
    uvs = getattr(mesh, "vertex_attributes", {}).get(TEXTURE)
    if uvs is None or np.ndim(uvs) != 2:
        return None
    scale = np.iinfo(uvs.dtype).max if np.issubdtype(uvs.dtype, np.integer) else 1.0
    u, v = np.array(uvs, float).T[:2] / scale
    return np.stack([u, 1.0 - v], axis=1)


def _renamed(text: bytes, file: str) -> bytes:
    tree = json.loads(text)
    _refuse_extensions(tree.get("extensionsRequired", []), file)
    _refuse_second_parents(tree.get("nodes", []), file)
    for number, mesh in enumerate(tree.get("meshes", [])):
        for primitive in mesh["primitives"]:
            _refuse_accessors(primitive, tree, f"The mesh file '{file}' holds mesh {mesh.get('name', number)!r}")
            attributes = primitive["attributes"]
            if "TEXCOORD_0" in attributes:
                attributes[TEXTURE] = attributes["TEXCOORD_0"]
    return json.dumps(tree).encode()


def _refuse_extensions(required: list[str], file: str) -> None:
    for name in required:
        if name.startswith(_READ_EXTENSIONS) or (name == _DRACO and importlib.util.find_spec("DracoPy")):
            continue
        if name.endswith("_compression"):
            how, rule = f"is compressed with {name}", "compression"
        else:
            how, rule = f"needs the glTF extension {name}", "it"
        raise MeshError(f"The mesh file '{file}' {how}, which is not read here; export it without {rule}.")


def _refuse_second_parents(nodes: list[dict[str, Any]], file: str) -> None:
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            first = parents.setdefault(child, number)
            if first != number:
                below, one, other = (repr(nodes[each].get("name", each)) for each in (child, first, number))
                raise MeshError(
                    f"The mesh file '{file}' has node {below} below both {one} and {other}, but nodes must form a tree."
                )


def _refuse_accessors(primitive: dict[str, Any], tree: dict[str, Any], where: str) -> None:
    """What only lists its differences from other values, or from zeros: trimesh would take these for the values.

    And points of which each number is to be divided by the largest of its type, which trimesh does not do.
    """
    for name, accessor in {**primitive["attributes"], "indices": primitive.get("indices")}.items():
        if name not in _READ or accessor is None:
            continue
        if "sparse" in tree["accessors"][accessor]:
            raise MeshError(
                f"{where} in part in a sparse accessor ({name}), which is not read; export it without these."
            )
        if name == "POSITION" and tree["accessors"][accessor].get("normalized"):
            raise MeshError(f"{where} in normalized numbers (POSITION), which are not read; export it unquantized.")
