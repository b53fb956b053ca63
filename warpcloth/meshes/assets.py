"""Where a mesh file is: on disk, or among the assets that ship in Warp's wheel."""

import os
from pathlib import Path
from typing import Any

from ..errors import MeshError
from ..validate import at_home, did_you_mean

PREFIX = "warp:"


def resolve_asset(source: Any) -> Path:
    """The file for a path, or for a name like ``"warp:bunny.usd"`` that means an asset of Warp's examples.

    Raises:
        MeshError: when there is no such file, and the message proposes the closest name; or what is there is none.
    """
    try:
        text = os.fspath(source)
    except TypeError:
        raise MeshError(
            f"A mesh must be a file name, a mesh or a trimesh.Trimesh, got {type(source).__name__}."
        ) from None
    if not isinstance(text, str) or not text.strip() or not text.isprintable():
        raise MeshError(f"A mesh must be given by a file name, got {text!r}.")
    if text.startswith(PREFIX):
        return _existing(warp_assets() / text.removeprefix(PREFIX), text, f"No asset '{text}' ships with Warp")
    path = at_home(text)
    return _existing(path, text, f"No mesh file '{path.name}' in {path.parent.absolute()}")


def warp_assets() -> Path:
    """The folder of example assets in the installed Warp."""
    import warp

    return Path(warp.__file__).parent / "examples" / "assets"


def _existing(path: Path, text: str, complaint: str) -> Path:
    try:
        if path.is_file():
            return path
        if path.is_dir():
            raise MeshError(f"'{text}' is a folder; name a mesh file in it.")
        if path.exists():
            raise MeshError(f"'{text}' is a pipe or device; save the mesh to a file and name that.")
        if path.is_symlink():
            raise MeshError(f"The mesh file '{text}' is a link that leads nowhere: it says {os.readlink(path)!r}.")
        neighbours = [entry.name for entry in path.parent.iterdir() if entry.is_file()] if path.parent.is_dir() else []
    except OSError as error:
        raise MeshError(f"The mesh file '{text}' cannot be reached: {error.strerror}.") from None
    if not path.parent.is_dir():
        raise MeshError(f"No mesh file '{text}': its folder {path.parent.absolute()} does not exist.")
    raise MeshError(f"{complaint}{did_you_mean(path.name, neighbours)}.")
