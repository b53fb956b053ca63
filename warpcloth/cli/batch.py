"""``warpcloth batch``: a sweep in, a data set of drapes out."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from .. import validate
from ..errors import InputError, SimulationError
from .report import INTERRUPTED, Report
from .terminal import messages, start_warp

if TYPE_CHECKING:
    from ..batch.run import Status
    from ..batch.sweep import Sweep

QUESTIONS = ("status", "index")
SHOWN_REASONS = 5

What = Annotated[
    str, typer.Argument(metavar="SWEEP|status|index", help="A sweep file; or what to do with a batch: status, index.")
]
Folder = Annotated[Path | None, typer.Argument(metavar="[DIR]", help="Folder of the batch, for status and index.")]
Output = Annotated[
    Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder of the batch.  [default: the sweep's name]")
]
Changes = Annotated[
    list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="Change a field of the sweep, e.g. count=10.")
]
Workers = Annotated[int | None, typer.Option(metavar="N", help="Processes.  [default: one for each processor, or GPU]")]
Worlds = Annotated[
    int | None, typer.Option(metavar="N", help="Samples stepped together in a process.  [default: by their size]")
]
Ray = Annotated[str | None, typer.Option("--ray", metavar="ADDRESS", help="Run on a Ray cluster, e.g. auto.")]
Retry = Annotated[bool, typer.Option("--retry-failed", help="Try again what failed before.")]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Check sweep and folder, print the plan and what it will cost.")
]


def command(
    what: What,
    folder: Folder = None,
    output: Output = None,
    changes: Changes = None,
    workers: Workers = None,
    worlds: Worlds = None,
    ray: Ray = None,
    retry_failed: Retry = False,
    dry_run: DryRun = False,
) -> Report:
    """Simulate a SWEEP of one scene: many samples into one folder. The same command again resumes it.

    The exit code is 0 if all samples of the sweep are done, 3 if any failed, or was taken away in the meantime; the
    others are done all the same.
    """
    if what in QUESTIONS:
        _refuse(
            {"--set": changes, "--workers": workers, "--worlds": worlds, "--ray": ray, "--retry-failed": retry_failed}
            | {"--dry-run": dry_run, "-o beside a folder": folder is not None and output is not None},
            f"warpcloth batch {what}",
        )
        return _answer(what, folder or output)
    if folder is not None:
        raise InputError(f"{folder} is one argument too many; the folder to write to is given with -o.")
    from ..batch import load_sweep

    for number, name in ((workers, "workers"), (worlds, "worlds")):
        if number is not None:
            validate.integer(number, name, minimum=1, maximum=100_000)
    sweep = load_sweep(what, changes or ())
    sweep.check()
    start_warp()
    path = output or Path(sweep.name)
    if dry_run:
        _refuse({"--ray": ray}, "--dry-run, which plans for this machine")
        return _plan(sweep, path, workers, worlds, retry_failed)
    return _run(sweep, path, {"workers": workers, "worlds": worlds, "ray": ray, "retry_failed": retry_failed})


def _refuse(options: dict[str, Any], by: str) -> None:
    """Refuses the first option that was given, as there is nothing that it could change."""
    given = next((name for name, value in options.items() if value), None)
    if given is not None:
        raise InputError(f"{given} has no meaning for {by}; leave it out.")


def _run(sweep: "Sweep", path: Path, options: dict[str, Any]) -> Report:
    from ..batch.folder import BatchFolder
    from ..batch.run import run_batch, status_of

    try:
        with _progress(sweep.name) as on_progress:
            status = run_batch(sweep, path, on_progress=on_progress, **options)
        code = 0 if status.done == status.samples else SimulationError.exit_code
    except KeyboardInterrupt:
        if not (BatchFolder(path).path / "sweep.json").exists():
            raise
        status, code = status_of(BatchFolder(path), running=False), INTERRUPTED
    return Report(status.as_dict() | {"interrupted": code == INTERRUPTED}, _summary(status), code)


def _answer(what: str, path: Path | None) -> Report:
    from ..batch.folder import BatchFolder
    from ..batch.run import index_batch, status_of

    if path is None:
        raise InputError(f"Which batch? Give its folder: warpcloth batch {what} DIR.")
    folder = BatchFolder(path)
    status = status_of(folder)
    start_warp()
    files = index_batch(folder) if what == "index" else []
    written = "".join(f"\n  {file}" for file in files)
    return Report(status.as_dict() | {"files": files}, _summary(status) + written)


def _plan(sweep: "Sweep", path: Path, workers: int | None, worlds: int | None, retry_failed: bool) -> Report:
    from ..batch.folder import BatchFolder
    from ..batch.plan import make_plan

    folder = BatchFolder(path)
    folder.check(sweep)
    plan = make_plan(sweep, folder, workers, worlds, estimate=True, retry_failed=retry_failed)
    seconds = plan.seconds or 0.0
    lines = [
        f"{sweep.name}: {plan.samples:,} samples of {plan.particles:,} particles, at most {plan.frames:,} frames each",
        f"{plan.finished:,} are in {path} already"
        + (", and those that failed are tried again" if retry_failed else ""),
        f"{plan.workers} processes, at most {plan.worlds} samples together in each",
        f"about {duration(seconds)} by the cost of the first frames, and {plan.bytes / 2**20:,.0f} MiB; less where "
        "worlds share launches or come to rest, more where contact comes later",
    ]
    lines += [f"{parameter.path}: {parameter.chosen}" for parameter in sweep.table.parameter]
    return Report(plan.as_dict() | {"left": plan.left}, "\n  ".join(lines))


@contextmanager
def _progress(name: str) -> Iterator[Callable[[Any, Any], None]]:
    """A bar on stderr; yields what to call twice a second, and with each outcome."""
    columns = (
        TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"), TimeElapsedColumn(), TimeRemainingColumn(),
    )  # fmt: skip
    console = messages()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(f"{name}: preparing", total=None, rate="")
        failed = 0

        def on_progress(plan: Any, outcome: Any) -> None:
            nonlocal failed
            if progress.tasks[task].total is None:
                progress.update(task, total=plan.samples, completed=plan.finished)
            if outcome is None:
                return
            failed += outcome.reason is not None
            rate = (progress.tasks[task].speed or 0.0) * 60.0
            text = f"{rate:.1f} a minute" + (f", {failed} failed" if failed else "")
            progress.update(task, advance=1, description=name, rate=text)

        yield on_progress


def _summary(status: "Status") -> str:
    lines = [f"{status.folder}: {status.done:,} of {status.samples:,} samples done, {status.failed:,} failed"]
    if status.running:
        lines.append("a batch is at work in it")
    if status.samples_per_minute is not None:
        lines.append(f"{status.samples_per_minute:.1f} samples a minute")
    if status.seconds_left:
        lines.append(f"{duration(status.seconds_left)} left at that rate")
    reasons, changed = list(status.reasons.items()), list(status.changed.items())
    lines += [f"{count} ×: {reason}" for reason, count in reasons[:SHOWN_REASONS]]
    if len(reasons) > SHOWN_REASONS:
        lines.append(f"and {len(reasons) - SHOWN_REASONS} more reasons: see manifest.csv")
    lines += [
        f"{file} has changed since {count} of the samples were made of it" for file, count in changed[:SHOWN_REASONS]
    ]
    return "\n  ".join(lines)


def duration(seconds: float) -> str:
    """A duration as people say it."""
    for unit, name in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 2.0 * unit:
            return f"{seconds / unit:.1f} {name}"
    return f"{seconds:.0f} seconds"
