"""Changes to a scene from outside: ``cloth.0.fabric.areal_density=0.3``."""

import re
import tomllib
from collections.abc import Iterable
from typing import Any

from warpcloth.errors import SceneError

from .schema import suggest

BARE_WORD = re.compile(r"[A-Za-z_][\w./:\-]*")
DEEPEST = 32


def apply_overrides(data: dict[str, Any], assignments: Iterable[str]) -> None:
    """Change the raw tables of a scene in place, before they are validated.

    Args:
        data: The scene as read from TOML.
        assignments: ``path=value`` each. The path is dotted; tables in lists go by their number or their name
            (``cloth.0.size``, ``cloth.flag.size``). The value is a TOML value; a single word needs no quotes.

    Raises:
        SceneError: The path leads nowhere or the value is not TOML.
    """
    for assignment in assignments:
        path, equals, value = assignment.partition("=")
        keys = [key.strip() for key in path.split(".")]
        if not equals or not all(keys) or len(keys) > DEEPEST:
            raise SceneError(f"{shorten(assignment)!r} is not of the form path=value, e.g. cloth.0.size=[1, 1]")
        assign(data, ".".join(keys), parse_value(value, path.strip()))


def assign(data: dict[str, Any], path: str, value: Any) -> None:
    """Put a value at a dotted path of the raw tables of a scene.

    Raises:
        SceneError: The path leads nowhere.
    """
    keys = path.split(".")
    parent = data
    for depth, key in enumerate(keys[:-1]):
        parent = _step(parent, key, keys[: depth + 1])
    _assign(parent, keys, value)


def parse_value(text: str, path: str) -> Any:
    """A TOML value, or a bare word as text.

    Raises:
        SceneError: The text is neither.
    """
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        parsed = {}
    if set(parsed) == {"value"}:
        return parsed["value"]
    if BARE_WORD.fullmatch(text.strip()):
        return text.strip()
    raise SceneError(
        f'the value {shorten(text)!r} of {shorten(path)!r} is not TOML; write for example 0.3, true, [1, 2] or "text"'
    )


def shorten(text: str, length: int = 80) -> str:
    """The text, cut where it is too long for a message."""
    return text if len(text) <= length else text[: length - 1] + "…"


def _step(parent: Any, key: str, path: list[str]) -> Any:
    """The table or list below ``parent``; a table that is not there yet is made."""
    if isinstance(parent, list):
        return parent[_index(parent, key, path)]
    if not isinstance(parent, dict):
        raise SceneError(f"{shorten('.'.join(path[:-1]))!r} is a single value and has no {key[:80]!r} in it")
    if key == "fabric" and isinstance(parent.get(key), str):  # given by its name alone, which the table begins with
        parent[key] = {"name": parent[key]}
    return parent.setdefault(key, {})


def _assign(parent: Any, keys: list[str], value: Any) -> None:
    if isinstance(parent, list):
        parent[_index(parent, keys[-1], keys)] = value
    elif isinstance(parent, dict):
        parent[keys[-1]] = value
    else:
        _step(parent, keys[-1], keys)


def _index(items: list[Any], key: str, path: list[str]) -> int:
    """Position of a list's item given by number, or by the name that its table has."""
    where = shorten(".".join(path[:-1]))
    if re.fullmatch("[0-9]{1,9}", key):
        if int(key) >= len(items):
            raise SceneError(f"{where!r} is a list of {len(items)}, counted from 0, so it has no {key}")
        return int(key)
    names = [item.get("name") if isinstance(item, dict) else None for item in items]
    if key in names:
        return names.index(key)
    known = [name for name in names if isinstance(name, str)]
    raise SceneError(f"{where!r} is a list and has no item {key[:80]!r}{suggest(key, known) or '; use its number'}")
