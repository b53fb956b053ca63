"""Values of a scene file: numbers within limits, vectors, lists of vectors, names. Each refuses with a full phrase.

The phrases start with "must be" and are completed by :mod:`warpcloth.scenes.schema.messages`, which puts the key in
front of them and what was found behind them.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

FARTHEST = 1.0e4  # m; beyond, single precision resolves less than a millimetre
MOST_VERTICES = 4_000_000
MOST_FRAMES = 1_000_000


def refuse(phrase: str, hint: str = "", but: str = "") -> PydanticCustomError:
    """The error of a value that is not what it must be.

    Args:
        phrase: reads on from the name of the key.
        hint: what goes after the value that was found, such as ``; did you mean 'denim'?``.
        but: what is wrong with the value, where that says more than the value itself.
    """
    return PydanticCustomError("scene_value", "{phrase}", {"phrase": phrase, "hint": hint, "but": but})


def is_number(value: Any) -> bool:
    """Whether a TOML value is a finite number (a boolean is not)."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return -1e300 < value < 1e300  # false for inf and NaN; TOML's whole numbers may have any number of digits


def _written(limit: float) -> str:
    return f"{limit:,.0f}" if float(limit).is_integer() else f"{limit:g}"


class Checked:
    """Base of annotations that check, and convert, a value before pydantic sees it."""

    def check(self, value: Any) -> Any:
        """The value in its final form, or an error from :func:`refuse`."""
        raise NotImplementedError

    @property
    def label(self) -> str:
        """What may stand here, for the tables of ``scenes/README.md``."""
        raise NotImplementedError

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self.check, handler(source))


@dataclass(frozen=True)
class Number(Checked):
    """A finite number within limits, in a unit."""

    unit: str
    low: float
    high: float
    above: bool = False  # whether ``low`` itself is excluded
    whole: bool = False

    def accepts(self, value: Any) -> bool:
        """Whether the value is such a number."""
        if not is_number(value) or (self.whole and not isinstance(value, int)):
            return False
        return (self.low < value if self.above else self.low <= value) and value <= self.high

    def check(self, value: Any) -> int | float:
        if not self.accepts(value):
            raise refuse(f"must be {self.label}")
        return value if self.whole else float(value)

    @property
    def limits(self) -> str:
        """The limits in words, e.g. ``above 0 and at most 10,000 m``."""
        unit = f" {self.unit}" if self.unit else ""
        if self.above:
            return f"above {_written(self.low)} and at most {_written(self.high)}{unit}"
        return f"from {_written(self.low)} to {_written(self.high)}{unit}"

    @property
    def label(self) -> str:
        return f"{'a whole number' if self.whole else 'a number'} {self.limits}".strip()


@dataclass(frozen=True)
class Vector(Checked):
    """A fixed count of numbers, written as a TOML array."""

    components: str
    number: Number

    @property
    def names(self) -> list[str]:
        """The components' names."""
        return self.components.split()

    def accepts(self, value: Any) -> bool:
        """Whether the value is such a vector."""
        return (
            isinstance(value, list | tuple)
            and len(value) == len(self.names)
            and all(self.number.accepts(item) for item in value)
        )

    def check(self, value: Any) -> tuple[int | float, ...]:
        if not self.accepts(value):
            raise refuse(f"must be {self.label}")
        return tuple(self.number.check(item) for item in value)

    @property
    def label(self) -> str:
        kind = "whole numbers" if self.number.whole else "numbers"
        return f"{len(self.names)} {kind} [{', '.join(self.names)}], each {self.number.limits}".strip()


@dataclass(frozen=True)
class Rows(Checked):
    """A list of numbers, vectors or texts of one kind, of any length from ``least`` up."""

    item: "Number | Vector | Text"
    least: int = 1
    most: int = MOST_VERTICES

    def check(self, value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple) or not self.least <= len(value) <= self.most:
            raise refuse(f"must be {self.label}")
        for position, item in enumerate(value):
            if not self.item.accepts(item):
                raise refuse(f"must be {self.label}", f" (see its item {position})")
        return tuple(self.item.check(item) for item in value)

    @property
    def label(self) -> str:
        return f"a list{f' of at least {self.least}' if self.least else ''}, each item {self.item.label}"


@dataclass(frozen=True)
class OneOrEach(Checked):
    """One number for all, or a list with one for each."""

    number: Number

    def check(self, value: Any) -> float | tuple[float, ...]:
        if self.number.accepts(value):
            return float(value)
        if not isinstance(value, list | tuple) or not value or not all(self.number.accepts(item) for item in value):
            raise refuse(f"must be {self.label}")
        return tuple(float(item) for item in value)

    @property
    def label(self) -> str:
        return f"{self.number.label}, or a list of such numbers"


@dataclass(frozen=True)
class Text(Checked):
    """A short piece of text, optionally of one shape."""

    pattern: str = ""
    what: str = "text"
    most: int = 2000

    def accepts(self, value: Any) -> bool:
        """Whether it is such a text."""
        if not isinstance(value, str) or len(value) > self.most or "\0" in value:
            return False
        return not self.pattern or re.fullmatch(self.pattern, value) is not None

    def check(self, value: Any) -> str:
        if not self.accepts(value):
            raise refuse(f"must be {self.what}" + ("" if isinstance(value, str) else ", in quotes"))
        return value

    @property
    def label(self) -> str:
        return self.what


@dataclass(frozen=True)
class Or(Checked):
    """A word, or what another annotation takes: ``"auto"`` or a number."""

    word: str
    other: Number

    def check(self, value: Any) -> Any:
        if value == self.word:
            return value
        if not self.other.accepts(value):
            raise refuse(f"must be {self.label}")
        return self.other.check(value)

    @property
    def label(self) -> str:
        return f'"{self.word}" or {self.other.label}'


@dataclass(frozen=True)
class OneOf(Checked):
    """A name out of a registry that is looked up anew each time."""

    what: str
    names: Callable[[], Iterable[str]]

    def check(self, value: Any) -> str:
        known = list(self.names())
        if not isinstance(value, str) or value not in known:
            closest = get_close_matches(str(value), known, n=1, cutoff=0.0) or known
            raise refuse(f"must be {self.what} such as {closest[0]!r}")
        return value

    @property
    def label(self) -> str:
        return self.what


@dataclass(frozen=True)
class Options(Checked):
    """A table of options whose names and limits belong to somebody else: numbers, booleans and words."""

    def check(self, value: Any) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            raise refuse("must be a table such as { iterations = 10 }")
        for key, item in value.items():
            if not (isinstance(item, bool | str) or is_number(item)):
                raise refuse(f"must have a number, true, false or a word as its {key[:80]!r}")
        return dict(value)

    @property
    def label(self) -> str:
        return "table"


def positive(unit: str, high: float = FARTHEST) -> Number:
    """A number above zero."""
    return Number(unit, low=0.0, high=high, above=True)


def at_least_zero(unit: str, high: float = FARTHEST) -> Number:
    """A number of zero or more."""
    return Number(unit, low=0.0, high=high)


ANY_LENGTH = Number("m", -FARTHEST, FARTHEST)
ANY_ANGLE = Number("°", -1e6, 1e6)
FRACTION = Number("", 0.0, 1.0)

Point = Annotated[tuple[float, float, float], Vector("x y z", ANY_LENGTH)]
Turn = Annotated[tuple[float, float, float], Vector("x y z", ANY_ANGLE)]
Speed = Annotated[tuple[float, float, float], Vector("x y z", Number("m/s", -1e4, 1e4))]
Color = Annotated[tuple[float, float, float], Vector("red green blue", FRACTION)]
Name = Annotated[
    str, Text(r"[A-Za-z_][A-Za-z0-9_]*", "a name of letters, digits and _ that does not start with a digit", 64)
]
