"""What a command has to say, for people and for programs."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from rich.console import RenderableType

from ..errors import InputError
from .terminal import is_unicode, plain_console

INTERRUPTED = 130  # the shells' convention for Ctrl-C
TABLE_WIDTH = 120  # columns where no terminal says how many there are


@dataclass(frozen=True)
class Report:
    """The outcome of a command.

    Args:
        data: What ``--json`` prints.
        text: What people are shown.
        exit_code: 0 done, 2 bad input, 3 the simulation failed, 130 interrupted.
    """

    data: Mapping[str, Any]
    text: RenderableType
    exit_code: int = 0


def print_report(report: Report, stream: TextIO, *, as_json: bool) -> None:
    """Write a report to a stream, as one JSON object or as text.

    Raises:
        BrokenPipeError: whoever read the stream has gone. InputError: it cannot be written to, as on a full disk.
    """
    try:
        _print(report, stream, as_json)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise InputError(f"The result cannot be written to standard output: {error.strerror}.") from None


def _print(report: Report, stream: TextIO, as_json: bool) -> None:
    if as_json:
        write_json(report.data, stream)
    else:
        # In a pipe there is no width to wrap sentences at; tables have their own, and room for it.
        console = plain_console(file=stream)
        if not console.is_terminal:
            console.width = max(console.width, TABLE_WIDTH)
        console.print(report.text, soft_wrap=isinstance(report.text, str))
    stream.flush()


def write_json(data: Mapping[str, Any], stream: TextIO) -> None:
    """Write one JSON object and a line's end; to streams that lack characters, with these escaped, as JSON can."""
    stream.write(to_json(data, escaped=not is_unicode(stream)) + "\n")


def to_json(data: Mapping[str, Any], *, escaped: bool = False) -> str:
    """JSON as the standard has it: what is not finite becomes ``null``; arrays and paths become lists and text."""
    return json.dumps(_plain(data), indent=2, ensure_ascii=escaped, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
