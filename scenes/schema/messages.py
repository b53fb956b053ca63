"""pydantic's errors as one sentence: which key, what is wrong with it, and what would be right."""

import datetime
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import ValidationError

from .cloth import CLOTHS
from .obstacle import OBSTACLES

KINDS = {"cloth": CLOTHS, "obstacle": OBSTACLES}  # lists whose tables are told apart by their ``shape``
LONGEST_VALUE = 40


def explain(error: ValidationError, whole: str = "the scene") -> str:
    """One sentence on the first problem, and how many others there are.

    Args:
        error: What validating raised.
        whole: What was validated.
    """
    problems = error.errors(include_url=False)
    count = len(problems) - 1 + sum(p.get("ctx", {}).get("more", 0) for p in problems)
    more = f" (and {count} more {'problem' if count == 1 else 'problems'})" if count else ""
    return _sentence(problems[0], whole) + more


def suggest(word: Any, known: Sequence[str]) -> str:
    """The closest of the known names, or all of them where none is close and they are few."""
    close = get_close_matches(str(word), known, n=1, cutoff=0.5)
    if close:
        return f"; did you mean {close[0]!r}?"
    return f"; known are {', '.join(known)}" if known else ""


def dotted(loc: Sequence[int | str]) -> str:
    """Path of a key as it is written in ``--set``: ``cloth.0.fabric.thickness``."""
    parts = [str(part) for part in loc]
    if len(parts) > 2 and parts[0] in KINDS:
        del parts[2]  # pydantic's name of the shape whose table it tried
    return ".".join(part if part.isprintable() else repr(part) for part in parts)


def shown(value: Any) -> str:
    """A value as TOML writes it, shortened."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, Sequence) and not isinstance(value, str) and len(value) > 6:
        return f"a list of {len(value)} values"
    if isinstance(value, datetime.date | datetime.time):
        return f"the date or time {value}"
    try:
        text = str(value) if isinstance(value, int | float) else repr(value)
    except ValueError:  # an integer of thousands of digits, which Python refuses to print
        return "a very long number"
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 1] + "…"


def _sentence(problem: Mapping[str, Any], whole: str) -> str:
    kind, found, context = problem["type"], problem["input"], problem.get("ctx", {})
    where = dotted(problem["loc"])
    if kind == "unknown_key":
        path = ".".join(part for part in (where, dotted([context["key"]])) if part)
        return f"the key {path[:200]!r} is unknown{suggest(context['key'], context['known'])}"
    if kind == "choice":
        return f"{where} must have exactly one of {_listed(context['choices'])}{_but(context['given'])}"
    if kind == "missing":
        return f"the key {where!r} is missing"
    if kind.startswith("union_tag"):
        return _wrong_shape(where, problem["loc"][0], found)
    subject = where or whole
    if kind == "scene_value":
        return f"{subject} {context['phrase']}{_unlike(found, problem['loc'], context['but'])}{context['hint']}"
    hint = f"; write [[{where}]] above it" if kind == "list_type" and where in KINDS else _closest(kind, found, context)
    return f"{subject} must be {_wanted(kind, context)}, not {shown(found)}{hint}"


def _unlike(found: Any, loc: Sequence[int | str], but: str) -> str:
    """How a value is not what it must be: of a table the phrase before has said it; a single value it helps to see."""
    if but:
        return f", but {but}"
    return "" if isinstance(found, Mapping) or not loc else f", not {shown(found)}"


def _wrong_shape(where: str, table: str, found: Any) -> str:
    shapes = [get_args(kind.model_fields["shape"].annotation)[0] for kind in KINDS[table]]
    if not isinstance(found, Mapping) or "shape" not in found:
        return f"the key '{where}.shape' is missing; choose {_listed(shapes)}"
    shape = found["shape"]
    hint = suggest(shape, shapes) if _near(shape, shapes) else ""
    return f"{where}.shape must be {_listed(shapes)}, not {shown(shape)}{hint}"


def _wanted(kind: str, context: Mapping[str, Any]) -> str:
    """What was expected, by the type of pydantic's error."""
    if kind == "literal_error":
        return str(context["expected"])
    if kind == "too_short":
        return f"a list of at least {context['min_length']}"
    if kind == "too_long":
        return f"a list of at most {context['max_length']:,}"
    words = {
        "bool_type": "true or false",
        "string_type": "text in quotes",
        "list_type": "a list",
        "model_type": "a table",
        "model_attributes_type": "a table",
        "dict_type": "a table",
        "int_type": "a whole number",
        "float_type": "a number",
    }
    return words.get(kind, f"valid ({kind.replace('_', ' ')})")


def _closest(kind: str, found: Any, context: Mapping[str, Any]) -> str:
    if kind != "literal_error":
        return ""
    known = [part.strip("'") for part in str(context["expected"]).replace(" or ", ", ").split(", ")]
    return suggest(found, known) if _near(found, known) else ""


def _near(word: Any, known: Sequence[str]) -> bool:
    return bool(get_close_matches(str(word), known, n=1, cutoff=0.5)) if isinstance(word, str) else False


def _listed(names: Sequence[str]) -> str:
    quoted = [repr(name) for name in names]
    return " or ".join([", ".join(quoted[:-1]), quoted[-1]]) if len(quoted) > 1 else quoted[0]


def _but(given: Sequence[str] | None) -> str:
    return f", not {' and '.join(repr(name) for name in given)}" if given else ", and has none"
