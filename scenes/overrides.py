"""Changes to a scene from outside: ``cloth.0.fabric.areal_density=0.3``."""

import re
import tomllib
from collections.abc import Callable, Iterable
from typing import Any

from warpcloth.errors import SceneError

from .schema.paths import assign, find, is_number, shorten

BARE_WORD = re.compile(r"[A-Za-z_][\w./:\-]*")
DEEPEST = 32


Complete = Callable[[dict[str, Any]], dict[str, Any]]


def apply_overrides(data: dict[str, Any], assignments: Iterable[str], complete: Complete | None = None) -> None:
    """Change the raw tables of a scene in place, before they are validated.

    Args:
        data: The scene as read from TOML.
        assignments: ``path=value`` each. The path is dotted; tables in lists go by their number or their name
            (``cloth.0.size``, ``cloth.flag.size``). The value is a TOML value; a single word needs no quotes.
        complete: Makes tables with all defaults of the tables it is given; an item can only be changed in a list that
            is there.

    Raises:
        SceneError: The path leads nowhere or the value is not TOML.
    """
    for assignment in assignments:
        path, equals, value = assignment.partition("=")
        keys = [key.strip() for key in path.split(".")]
        if not equals or not all(keys) or len(keys) > DEEPEST:
            raise SceneError(f"{shorten(assignment)!r} is not of the form path=value, e.g. cloth.0.size=[1, 1]")
        parsed = parse_value(value, path.strip())
        if complete is not None:
            _write_out_lists(data, keys, complete)
        assign(data, ".".join(keys), parsed)


def _write_out_lists(data: dict[str, Any], keys: list[str], complete: Complete) -> None:
    """Gives the tables the lists that a path enters by number, where they leave these to their defaults."""
    for depth in range(1, len(keys)):
        if is_number(keys[depth]) and find(data, keys[:depth]) is None:
            default = find(complete(data), keys[:depth])
            if isinstance(default, list):
                assign(data, ".".join(keys[:depth]), default)


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
