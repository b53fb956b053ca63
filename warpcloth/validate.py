"""Checks of user-supplied values: each returns the value in its final type or raises one clear :class:`InputError`.

``what`` names the value for the reader, e.g. ``"cloth 'flag': size"``; it begins the message.
"""

import difflib
import operator
import os
import reprlib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
import warp as wp

from .errors import InputError

# Annotates fields that take any array-like (or None) and then hold a read-only array: static types cannot say both.
Array: TypeAlias = Any
Kind = TypeVar("Kind")

LARGEST = 1e12  # beyond this no SI quantity of cloth is meant, and products would overflow
SMALLEST = 1e-12  # and closer to 0 than this, they would vanish


class ReadOnly:
    """What has read-only arrays, unpickled or copied, too: neither keeps numpy's flag."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        self.__dict__.update(state)


def number(
    value: Any, what: str, *, above: float | None = None, minimum: float | None = None, maximum: float = LARGEST
) -> float:
    """A finite float, ``> above`` or ``>= minimum``, and ``<= maximum``."""
    low = -LARGEST if minimum is None else minimum
    try:
        result = float(value) if _may_be_real(value) else float("nan")
    except (TypeError, ValueError, OverflowError):
        result = float("nan")
    if not low <= result <= maximum or (above is not None and not result > above):
        limits = _range(above, minimum, maximum, spoken=maximum < LARGEST or LARGEST < result < float("inf"))
        raise InputError(f"{sentence(what)} must be {limits}, got {shown(value)}.")
    if above == 0.0 and result < SMALLEST:
        raise InputError(f"{sentence(what)} must not be closer to 0 than {SMALLEST:g}, got {shown(value)}.")
    return result


def integer(value: Any, what: str, *, minimum: int, maximum: int) -> int:
    """An int in [minimum, maximum]; floats and booleans are refused rather than rounded."""
    try:
        result = minimum - 1 if isinstance(value, bool | np.bool_) else operator.index(value)
    except TypeError:
        result = minimum - 1
    if not minimum <= result <= maximum:
        got = shown(value)
        raise InputError(f"{sentence(what)} must be a whole number from {minimum:,} to {maximum:,}, got {got}.")
    return result


def array(value: Any, what: str, shape: tuple[int | None, ...], dtype: Any = np.float64) -> np.ndarray:
    """A read-only, C-contiguous, finite copy with the given shape (``None``: any length)."""
    kind = "integers" if np.issubdtype(dtype, np.integer) else "numbers"
    try:
        raw = np.asarray(value)
        if (raw.dtype.kind not in "iuf" and raw.size) or np.ma.is_masked(value):
            raise TypeError
    except (TypeError, ValueError, RuntimeError):  # the last: a list of Warp arrays
        raise InputError(f"{sentence(what)} must be {_layout(shape, kind)}, got {shown(value)}.") from None
    if raw.size == 0 and None in shape:
        raw = np.zeros([0 if n is None else n for n in shape], dtype)
    if raw.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, raw.shape, strict=True)):
        raise InputError(f"{sentence(what)} must be {_layout(shape, kind)}, got an array of shape {raw.shape}.")
    return _converted(raw, what, dtype)


def axes(value: Any) -> int:
    """How many axes numpy gives it; −1 where it can give none, as to rows of unequal lengths, and ``array`` refuses."""
    try:
        return np.ndim(value)
    except (ValueError, RuntimeError):  # the latter: a list of Warp arrays
        return -1


def device_array(value: Any, what: str, dtype: type, shape: tuple[int, ...], device: wp.Device) -> wp.array:
    """A contiguous Warp array, taken as it is."""
    name = sentence(what)
    if not isinstance(value, wp.array):
        raise InputError(f"{name} must be a warp.array, got {type(value).__name__}.")
    if value.device != device:
        raise InputError(f"{name} must be on device {device}, got an array on {value.device}.")
    if not wp.types.types_equal(value.dtype, dtype):
        raise InputError(f"{name} must be of dtype {_type_name(dtype)}, got {_type_name(value.dtype)}.")
    if value.shape != shape:
        raise InputError(f"{name} must have shape {shape}, got {value.shape}.")
    if not value.is_contiguous:
        raise InputError(f"{name} must be contiguous, got strides {value.strides}.")
    return value


def _type_name(dtype: type) -> str:
    return str(wp.types.type_repr(dtype)).rpartition(".")[2]


def vector(value: Any, what: str) -> np.ndarray:
    """Three finite numbers, read-only float64 [3]."""
    return array(value, what, (3,))


def color(value: Any, what: str) -> tuple[float, float, float]:
    """Linear red, green, blue, each in [0, 1]."""
    red, green, blue = vector(value, what).tolist()
    if min(red, green, blue) < 0.0 or max(red, green, blue) > 1.0:
        raise InputError(f"{sentence(what)} must be red, green, blue from 0 to 1, got {shown(value)}.")
    return red, green, blue


def text(value: Any, what: str) -> str:
    """A non-empty printable string."""
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise InputError(f"{sentence(what)} must be a non-empty printable text, got {shown(value)}.")
    return value


def flag(value: Any, what: str) -> bool:
    """True or False, nothing that merely behaves like it."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{sentence(what)} must be true or false, got {shown(value)}.")
    return bool(value)


def choice(value: Any, options: Iterable[str], what: str) -> str:
    """One of ``options``; the message proposes the closest."""
    names = list(options)
    if isinstance(value, str) and value in names:
        return value
    known = ", ".join(f"'{name}'" for name in names)
    raise InputError(f"{sentence(what)} must be one of {known}, got {shown(value)}{did_you_mean(value, names)}.")


def instance(value: Any, kind: type[Kind], what: str) -> Kind:
    """An object of that kind, such as ``warpcloth.Model``."""
    if not isinstance(value, kind):
        raise InputError(f"{what} must be a warpcloth.{kind.__name__}, got {type(value).__name__}.")
    return value


def instances(values: Any, kind: type[Kind], what: str) -> list[Kind]:
    """A list of objects of that kind, such as ``warpcloth.Hook``."""
    if not isinstance(values, Sequence):
        raise InputError(f"{sentence(what)} must be a list of warpcloth.{kind.__name__}, got {type(values).__name__}.")
    return [instance(value, kind, f"{what}[{k}]") for k, value in enumerate(values)]


def listed(values: Any) -> list[Any]:
    """What was given as a list of things, of which one alone needs no list."""
    if isinstance(values, Iterable) and not (isinstance(values, np.ndarray) and values.ndim == 0):
        return list(values)
    return [values]


def texts(values: Any, what: str) -> list[str]:
    """A list of texts; one text alone is no list of its letters."""
    items: list[Any] = [None] if isinstance(values, str | bytes) else listed(values)
    if not all(isinstance(item, str) for item in items):
        raise InputError(f"{sentence(what)} must be a list of texts, got {shown(values)}.")
    return items


def function(value: Any, what: str) -> Callable[..., Any] | None:
    """A function, or None for none."""
    if value is not None and not callable(value):
        raise InputError(f"{sentence(what)} must be a function or None, got {shown(value)}.")
    return value


def file_path(value: Any, what: str) -> Path:
    """The path of a file: a text, or what has one."""
    path = os.fspath(value) if isinstance(value, os.PathLike) else value
    if not isinstance(path, str):
        raise InputError(f"{sentence(what)} must be the path of a file, got {shown(value)}.")
    return Path(path)


def at_home(path: str | os.PathLike[str]) -> Path:
    """A path with a home folder in place of ``~`` or ``~user``; where there is no such user, as shells do, as it is."""
    return Path(os.path.expanduser(path))


def shown(value: Any) -> str:
    """A value as messages show it: short, and in one line."""
    return _BRIEF.repr(value).replace("\n", " ")


def did_you_mean(value: Any, options: Sequence[str]) -> str:
    """``"; did you mean 'x'?"`` without the question mark, or nothing when no option is close."""
    close = difflib.get_close_matches(str(value), list(options), n=1)
    return f" (did you mean '{close[0]}'?)" if close else ""


def sentence(label: str) -> str:
    """The label as a sentence begins."""
    return label[:1].upper() + label[1:]


def is_utf8(path: Any) -> bool:
    """Whether a path can be passed on as UTF-8 text, as USD and JSON need it; on Linux any bytes may name a file."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


class _Brief(reprlib.Repr):
    """Goes by the names of classes, of which Warp's has the one of Python's own arrays."""

    def repr_array(self, x: Any, level: int) -> str:
        return self.repr_instance(x, level)


_BRIEF = _Brief()


def _may_be_real(value: Any) -> bool:
    """Not what ``float`` only makes a number of: texts, truth values, complex numbers, arrays with axes."""
    if isinstance(value, np.ndarray):
        return value.ndim == 0 and value.dtype.kind in "iuf"
    return not isinstance(value, str | bytes | bytearray | bool | np.bool_ | np.complexfloating)


def _converted(raw: np.ndarray, what: str, dtype: Any) -> np.ndarray:
    if np.issubdtype(dtype, np.integer):
        bounds = np.iinfo(dtype)
        if raw.dtype.kind == "f" and raw.size:
            raise InputError(f"{sentence(what)} must be integers, got {shown(raw.flat[0])}.")
        if raw.size and (raw.min() < bounds.min or raw.max() > bounds.max):
            raise InputError(f"{sentence(what)} must fit {bounds.bits}-bit integers, got {raw.min()} to {raw.max()}.")
    else:
        bad = np.flatnonzero(~(np.abs(raw.astype(np.float64)) <= LARGEST))  # also catches NaN
        if bad.size:
            where = f" at index {bad[0] // max(1, raw[0].size)}" if raw.ndim > 1 else ""
            raise InputError(f"{sentence(what)} must be finite numbers up to 1e12, got {raw.flat[bad[0]]}{where}.")
    result = np.array(raw, dtype=dtype, order="C")
    result.flags.writeable = False
    return result


def _layout(shape: tuple[int | None, ...], kind: str) -> str:
    """(3,) → "3 numbers", (None, 3) → "rows of 3 numbers"."""
    if len(shape) == 1:
        return f"a list of {kind}" if shape[0] is None else f"{shape[0]} {kind}"
    if len(shape) == 2:
        return f"rows of {shape[1]} {kind}" if shape[0] is None else f"{shape[0]} rows of {shape[1]} {kind}"
    return f"{' × '.join(map(str, shape))} {kind}"


def _range(above: float | None, minimum: float | None, maximum: float, *, spoken: bool) -> str:
    """A range in words; its end only if that is ``spoken`` of, as nobody comes near to the largest of all."""
    upper = f" and at most {maximum:g}" if spoken else ""
    if above is not None:
        return f"a number greater than {above:g}{upper}"
    return f"a number of at least {minimum:g}{upper}" if minimum is not None else f"a finite number{upper}"
