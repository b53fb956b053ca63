"""Dotted paths to the values of a scene: ``cloth.0.fabric.areal_density``."""

import re
from typing import Any

from warpcloth.errors import SceneError

from .messages import suggest


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


def find(data: Any, keys: list[str]) -> Any:
    """What is at a path of the raw tables of a scene; None where nothing is.

    Raises:
        SceneError: A list on the way has no such item.
    """
    for depth, key in enumerate(keys):
        if isinstance(data, list):
            data = data[_index(data, key, keys[: depth + 1])]
        else:
            data = data.get(key) if isinstance(data, dict) else None
    return data


def shorten(text: str, length: int = 80) -> str:
    """The text, cut where it is too long for a message."""
    return text if len(text) <= length else text[: length - 1] + "…"


def is_number(key: str) -> bool:
    """Whether a key of a path is the number of a list's item."""
    return re.fullmatch("[0-9]{1,9}", key) is not None


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
    if is_number(key):
        if int(key) >= len(items):
            raise SceneError(f"{where!r} is a list of {len(items)}, counted from 0, so it has no {key}")
        return int(key)
    names = [item.get("name") if isinstance(item, dict) else None for item in items]
    if key in names:
        return names.index(key)
    known = [name for name in names if isinstance(name, str)]
    raise SceneError(f"{where!r} is a list and has no item {key[:80]!r}{suggest(key, known) or '; use its number'}")
