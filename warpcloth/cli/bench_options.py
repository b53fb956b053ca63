"""What the benchmarks' commands have in common."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from ..errors import InputError
from .terminal import messages


def names(text: str | None) -> list[str] | None:
    """The names in a list with commas."""
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()] or [text]


def whole(text: str | None) -> Any:
    """The whole number where the text is one; what it must be is said elsewhere."""
    return int(text) if text is not None and re.fullmatch("-?[0-9]{1,30}", text) else text


def output_folder(output: Path) -> Path:
    """The folder, made if need be.

    Raises:
        InputError: it cannot be made.
    """
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"The folder {output} cannot be made: {error.strerror}.") from error
    return output


@contextmanager
def progress_bar(count: int) -> Iterator[Callable[[str], None]]:
    """A bar on stderr; yields what to call before each of ``count`` measurements."""
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    console = messages()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("preparing", total=count, completed=-1)
        yield lambda text: progress.update(task, description=text, advance=1)
