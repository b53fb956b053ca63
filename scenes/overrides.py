"""Changes to a scene from outside: ``cloth.0.fabric.areal_density=0.3``."""

import re
import tomllib
from collections.abc import Iterable
from typing import Any

from warpcloth.errors import SceneError

from .schema.paths import assign, shorten

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
