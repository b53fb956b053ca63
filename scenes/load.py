"""Finding and reading scenes: bundled ones by name, others by the path of their TOML file or of a USD stage."""

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from warpcloth.errors import SceneError
from warpcloth.validate import at_home, is_utf8, texts

from .overrides import apply_overrides
from .schema import Scene, explain, suggest
from .schema.paths import shorten
from .schema.values import is_number

BUNDLED = Path(__file__).parent / "bundled"
STAGES = (".usd", ".usda", ".usdc", ".usdz")
BYTE_ORDER_MARK = "\ufeff"
LARGEST_FILE = 64 * 2**20  # bytes; a scene file is text that a person writes


def bundled_scenes() -> list[str]:
    """Names of the scenes that come with warpcloth."""
    return sorted(path.stem for path in BUNDLED.glob("*.toml"))


def load_scene(
    name_or_path: str | Path,
    overrides: Iterable[str] = (),
    *,
    cloth: Sequence[str] = (),
    collider: Sequence[str] = (),
) -> Scene:
    """Read and validate a scene.

    Args:
        name_or_path: Name of a bundled scene, or path of a ``.toml`` file or of a USD stage.
        overrides: Changes ``path=value``, e.g. ``cloth.0.fabric.areal_density=0.3``; see
            :func:`warpcloth.scenes.overrides.apply_overrides`.
        cloth: In a stage, paths of prims that are cloth; by default those that say so themselves.
        collider: In a stage, paths of prims that cloth collides with, besides those that say so themselves.

    Raises:
        SceneError: There is no such scene, or it is not valid; the message says where and what would be right.
        UsdError: The stage cannot be read.
    """
    path, overrides = find_scene(name_or_path), texts(overrides, "overrides")
    prims = {"cloth": texts(cloth, "cloth"), "collider": texts(collider, "collider")}
    if path.suffix in STAGES:
        return _scene_of_stage(path, overrides, prims)
    if any(prims.values()):
        raise SceneError(f"{path.name} is not a USD stage, so no prims of it can be chosen as cloth or collider")
    try:
        text = read_text(path)
    except SceneError as error:
        raise SceneError(_prefixed(path.name, str(error))) from None
    return scene_from_toml(text, name=path.stem, folder=path.parent, source=path.name, overrides=overrides)


def find_scene(name_or_path: str | Path) -> Path:
    """Path of a scene file.

    Raises:
        SceneError: There is no such scene; the message has the closest bundled name.
    """
    wanted = str(name_or_path)
    if wanted in bundled_scenes():
        return BUNDLED / f"{wanted}.toml"
    if not is_utf8(wanted):
        raise SceneError(f"{shorten(wanted)!r} is not UTF-8 text, so it cannot name a scene")
    path = Path(wanted).expanduser() if wanted.startswith("~/") else Path(wanted)
    try:
        if path.suffix in (".toml", *STAGES) and path.is_file():
            return path
        exists = bool(wanted) and path.exists()
        file = path.suffix in (".toml", *STAGES)
        neighbours = [p.name for p in path.parent.glob(f"*{path.suffix}")] if file else bundled_scenes()
    except (OSError, ValueError):  # names that no file can have
        exists, neighbours = False, bundled_scenes()
    if exists:
        raise SceneError(f"{shorten(wanted)!r} is not a scene: a scene is a .toml file or a USD stage")
    what = "scene file" if path.suffix in (".toml", *STAGES) else "scene"
    raise SceneError(f"there is no {what} {shorten(wanted)!r}{suggest(path.name, neighbours)}")


def read_text(path: Path) -> str:
    """Text of a scene file, without the mark that some editors put before it.

    Raises:
        SceneError: It cannot be read; the message leaves it to the caller to name the file.
    """
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise SceneError(f"the file is larger than {LARGEST_FILE >> 20} MiB, so it is not a scene")
        return path.read_text(encoding="utf-8").removeprefix(BYTE_ORDER_MARK)
    except UnicodeDecodeError as error:
        raise SceneError(f"the file is not UTF-8 text (byte {error.start})") from None
    except OSError as error:
        raise SceneError(f"the file cannot be read: {error.strerror}") from None


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
        apply_overrides(data, overrides, partial(_complete, folder=Path() if folder is None else folder))
    except SceneError as error:
        raise SceneError(_prefixed(source, str(error))) from None
    return scene_from_data(data, name=name, folder=folder, source=source)


def scene_from_data(
    data: Mapping[str, Any], *, name: str = "scene", folder: Path | None = None, source: str = ""
) -> Scene:
    """A scene from its tables, as TOML is read into them; see :func:`scene_from_toml`."""
    place = Path() if folder is None else folder
    try:
        scene = Scene.model_validate(_with_stage(data, place))
    except ValidationError as error:
        raise SceneError(_prefixed(source, explain(error))) from None
    return scene.placed(name, place, source)


def _scene_of_stage(path: Path, overrides: Iterable[str], prims: dict[str, Any]) -> Scene:
    """The scene that a stage is by itself."""
    data: dict[str, Any] = {"stage": {"path": path.name, **prims}}
    try:
        apply_overrides(data, overrides, partial(_complete, folder=path.parent))
    except SceneError as error:
        raise SceneError(_prefixed(path.name, str(error))) from None
    return scene_from_data(data, name=path.stem, folder=path.parent, source=path.name)


def _complete(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The tables of a scene with every field that has a value; empty where they are no scene yet."""
    try:
        scene = Scene.model_validate(_with_stage(data, folder))
    except ValidationError:
        return {}
    tables = scene.model_dump(mode="json", exclude_none=True)
    for holder, table in [*zip(scene.cloth, tables["cloth"], strict=True), (scene.stage, tables.get("stage"))]:
        if holder is not None and holder.fabric is not None:  # its name says what its colour is
            table["fabric"]["color"] = list(holder.fabric.build().color)
    return tables


def _with_stage(data: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    """The tables of a scene, completed by what its stage says, if it has one."""
    table = data.get("stage")
    path = table.get("path") if isinstance(table, Mapping) else None
    if not isinstance(path, str) or Path(path).suffix not in STAGES:
        return data  # what is wrong with it the schema says
    from .shots.opening import open_shot, stage_tables

    fps: Any = data.get("fps")
    rate = float(fps) if is_number(fps) and 0.0 < fps <= 1e5 else None  # what else it may be the schema refuses
    said = stage_tables(open_shot(folder / at_home(path)), rate)
    both = {key: {**value, **data[key]} for key, value in said.items() if _is_table(value) and _is_table(data.get(key))}
    return {**said, **data, **both}


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


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
