"""Finding and reading scenes: bundled ones by name, others by the path of their TOML file."""

import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from warpcloth.errors import SceneError

from .overrides import apply_overrides, shorten
from .schema import Scene, explain, suggest

BUNDLED = Path(__file__).parent / "bundled"
LARGEST_FILE = 64 * 2**20  # bytes; a scene file is text that a person writes


def bundled_scenes() -> list[str]:
    """Names of the scenes that come with warpcloth."""
    return sorted(path.stem for path in BUNDLED.glob("*.toml"))


def load_scene(name_or_path: str | Path, overrides: Iterable[str] = ()) -> Scene:
    """Read and validate a scene.

    Args:
        name_or_path: Name of a bundled scene, or path of a ``.toml`` file.
        overrides: Changes ``path=value``, e.g. ``cloth.0.fabric.areal_density=0.3``; see
            :func:`warpcloth.scenes.overrides.apply_overrides`.

    Raises:
        SceneError: There is no such scene, or it is not valid; the message says where and what would be right.
    """
    path = find_scene(name_or_path)
    return scene_from_toml(read_text(path), name=path.stem, folder=path.parent, source=path.name, overrides=overrides)


def find_scene(name_or_path: str | Path) -> Path:
    """Path of a scene file.

    Raises:
        SceneError: There is no such scene; the message has the closest bundled name.
    """
    wanted = str(name_or_path)
    if wanted in bundled_scenes():
        return BUNDLED / f"{wanted}.toml"
    path = Path(wanted).expanduser() if wanted.startswith("~/") else Path(wanted)
    try:
        if path.suffix == ".toml" and path.is_file():
            return path
        exists = bool(wanted) and path.exists()
        neighbours = [p.name for p in path.parent.glob("*.toml")] if path.suffix == ".toml" else bundled_scenes()
    except (OSError, ValueError):  # names that no file can have
        exists, neighbours = False, bundled_scenes()
    if exists:
        raise SceneError(f"{shorten(wanted)!r} is not a scene: a scene is a TOML file whose name ends in .toml")
    what = "scene file" if path.suffix == ".toml" else "scene"
    raise SceneError(f"there is no {what} {shorten(wanted)!r}{suggest(path.name, neighbours)}")


def read_text(path: Path) -> str:
    """Text of a scene file.

    Raises:
        SceneError: It cannot be read.
    """
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise SceneError(f"{path.name}: the file is larger than {LARGEST_FILE >> 20} MiB, so it is not a scene")
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise SceneError(f"{path.name}: the file is not UTF-8 text (byte {error.start})") from None
    except OSError as error:
        raise SceneError(f"{path.name}: the file cannot be read: {error.strerror}") from None


def scene_from_toml(
    text: str, *, name: str = "scene", folder: Path | None = None, source: str = "", overrides: Iterable[str] = ()
) -> Scene:
    """A scene from the text of a scene file.

    Args:
        text: TOML.
        name: Name to give the scene.
        folder: Folder that relative mesh paths start from; by default the current one.
        source: Name of the file, for messages.
        overrides: Changes ``path=value``.

    Raises:
        SceneError: The text is not TOML or not a scene.
    """
    try:
        data = parse_toml(text)
        apply_overrides(data, overrides)
    except SceneError as error:
        raise SceneError(_prefixed(source, str(error))) from None
    return scene_from_data(data, name=name, folder=folder, source=source)


def scene_from_data(
    data: Mapping[str, Any], *, name: str = "scene", folder: Path | None = None, source: str = ""
) -> Scene:
    """A scene from its tables, as TOML is read into them; see :func:`scene_from_toml`."""
    try:
        scene = Scene.model_validate(data)
    except ValidationError as error:
        raise SceneError(_prefixed(source, explain(error))) from None
    return scene.placed(name, Path() if folder is None else folder)


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        SceneError: The text is not TOML; the message has the line.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        last = text.count("\n") + 1
        where = str(error).replace("at end of document", f"at line {last}, the end")
        raise SceneError(f"this is not TOML: {where}") from None
    except RecursionError:
        raise SceneError("this is not a scene: its lists or tables are nested too deeply") from None
    except ValueError:
        raise SceneError("this is not a scene: it has a number of thousands of digits") from None


def _prefixed(source: str, message: str) -> str:
    return f"{source}: {message}" if source else message
