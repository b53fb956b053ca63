"""The commands, and what they have in common."""

import functools
import inspect
from collections.abc import Callable
from importlib.metadata import version
from types import ModuleType
from typing import Annotated, Any

import typer

from .. import command_start
from . import batch, bench, check, compile, fabrics, integrators, lab, render, scenes, simulate, view
from .report import Report, print_report
from .terminal import quiet_warp, stdout_for_results, warnings_as_lines

COMMANDS: tuple[ModuleType, ...] = (
    simulate,
    scenes,
    check,
    render,
    view,
    integrators,
    fabrics,
    bench,
    batch,
    compile,
    lab,
)

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else there.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show Warp's messages and the traceback of an error.")]


def build_app() -> typer.Typer:
    """The application with all commands."""
    app = typer.Typer(
        name="warpcloth",
        help="Cloth simulation on NVIDIA Warp: scenes in, USD caches out.",
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
        rich_markup_mode=None,
    )
    app.callback()(_root)
    for module in COMMANDS:
        app.command(module.__name__.rpartition(".")[2])(with_report(module.command))
    return app


def with_report(command: Callable[..., Report]) -> Callable[..., int]:
    """A command as typer wants it: with ``--json`` and ``--debug``, printing its report, returning its exit code."""

    @functools.wraps(command)
    def run(*arguments: Any, json: bool, debug: bool, **options: Any) -> int:
        with stdout_for_results() as stdout, quiet_warp(not debug), warnings_as_lines():
            try:
                command_start.done()
                report = command(*arguments, **options)
            except KeyboardInterrupt:  # of which typer itself would say nothing
                raise typer.Abort from None
        print_report(report, stdout, as_json=json)
        return report.exit_code

    signature = inspect.signature(command)
    common = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation)
        for name, annotation in (("json", AsJson), ("debug", Debug))
    ]
    run.__signature__ = signature.replace(parameters=[*signature.parameters.values(), *common])  # type: ignore[attr-defined]
    run.__annotations__ = {**command.__annotations__, "json": AsJson, "debug": Debug}
    return run


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"warpcloth {version('warpcloth')}")
        raise typer.Exit


def _root(
    show_version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version.")
    ] = False,
) -> None:
    """Cloth simulation on NVIDIA Warp: scenes in, USD caches out."""
