"""Entry point: run a command, and turn every error into one sentence and an exit code."""

import contextlib
import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeGuard

import typer
import warp as wp

from ..errors import WarpclothError
from .app import build_app
from .report import INTERRUPTED, write_json
from .terminal import messages, open_streams

BAD_INPUT = 2
UNEXPECTED = 1
# typer has carried its own copy of click's exceptions since 0.2x, so the base class is reached by way of its public one
ClickError: Any = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")


def main() -> None:
    """Run the command that the process was started with, and exit."""
    open_streams()
    sys.exit(run(sys.argv[1:]))


def run(arguments: Sequence[str]) -> int:
    """Run a command.

    Args:
        arguments: What follows ``warpcloth`` on the command line.

    Returns:
        The exit code: 0 done, 1 a defect of warpcloth, 2 bad input, 3 the simulation failed, 130 interrupted.
    """
    try:
        return build_app()(list(arguments) or ["--help"], prog_name="warpcloth", standalone_mode=False) or 0
    except WarpclothError as error:
        return _fail(arguments, str(error), error.exit_code)
    except ClickError as error:
        return _fail(arguments, _usage_sentence(error), BAD_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        return _fail(arguments, "interrupted", INTERRUPTED)
    except BrokenPipeError:  # whoever read our output has gone, e.g. `| head`
        sys.stderr.close()
        return 0
    except MemoryError:
        return _fail(arguments, "there is not enough memory for this scene; lower its resolution", 3)
    except Exception as error:
        if _is_of_kernel_cache(error):
            sentence = f"Kernels cannot be kept in {wp.config.kernel_cache_dir} ({str(error.strerror).lower()})"
            return _fail(arguments, f"{sentence}; set WARP_CACHE_PATH to a folder that can be written to", BAD_INPUT)
        sentence = f"warpcloth has a defect ({type(error).__name__}: {error})"
        return _fail(arguments, f"{sentence}; please report it with what --debug shows", UNEXPECTED)


def _is_of_kernel_cache(error: Exception) -> TypeGuard[OSError]:
    """Whether it is that Warp cannot make the folder of its kernel cache, or write to it."""
    if not isinstance(error, OSError) or not error.filename or not wp.config.kernel_cache_dir:
        return False
    place, cache = Path(os.fsdecode(error.filename)), Path(wp.config.kernel_cache_dir)
    return place == cache or cache in place.parents or place in cache.parents


def _fail(arguments: Sequence[str], sentence: str, exit_code: int) -> int:
    """Say what is wrong on stderr, and under ``--json`` on stdout too."""
    if "--debug" in arguments:
        traceback.print_exc()
    sentence = " ".join(sentence.split())
    sentence = sentence if sentence.endswith((".", "?")) else f"{sentence}."
    messages().print(f"warpcloth: {sentence}")
    if "--json" in arguments:
        with contextlib.suppress(OSError):  # where stdout cannot be written to, stderr has said what is wrong
            write_json({"error": sentence, "exit_code": exit_code}, sys.stdout)
            sys.stdout.flush()
    return exit_code


def _usage_sentence(error: Any) -> str:
    """One sentence of a usage error, with the way to the help."""
    text = error.format_message().strip().rstrip(".?")
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "warpcloth"
    return f"{text.replace('. Did you mean', '; did you mean')}; see `{command} --help`"
