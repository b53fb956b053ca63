"""``warpcloth bench``: measurements that compare schemes."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from .. import validate
from ..errors import InputError
from .report import Report, to_json
from .terminal import messages, start_warp

BENCHMARKS = ("integrators",)

What = Annotated[str, typer.Argument(metavar="WHAT", help="What to measure: integrators.")]
Schemes = Annotated[
    str | None, typer.Option("--integrators", metavar="A,B,…", help="Only these (see `integrators`).  [default: all]")
]
Problems = Annotated[
    str | None, typer.Option("--problems", metavar="A,B,…", help="Only these test problems.  [default: all]")
]
SceneOption = Annotated[str | None, typer.Option("--scene", help="Measure on this scene instead of the test problems.")]
Frames = Annotated[str | None, typer.Option(metavar="N", help="Frames of the scene.  [default: all]")]
Quick = Annotated[bool, typer.Option("--quick", help="Half a minute instead of minutes: fewer, coarser runs.")]
Budget = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="Time for the runs of one scheme on one problem.")
]
Output = Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for results.json and the plots.")]
NoPlots = Annotated[bool, typer.Option("--no-plots", help="Write no plots, so that matplotlib is not needed.")]


def command(
    what: What,
    schemes: Schemes = None,
    problems: Problems = None,
    scene: SceneOption = None,
    frames: Frames = None,
    quick: Quick = False,
    budget: Budget = None,
    output: Output = Path("bench_integrators"),
    no_plots: NoPlots = False,
) -> Report:
    """Compare the integrators: accuracy against cost, energy drift, largest stable steps."""
    from ..benchmarks.integrators import measurements, run_suite
    from ..benchmarks.integrators.plots import write_plots
    from ..benchmarks.integrators.style import pyplot
    from ..benchmarks.integrators.tables import tables

    validate.choice(what, BENCHMARKS, "what to measure")
    if not no_plots:
        pyplot()
    start_warp()
    selection = _selection(schemes, problems, scene, frames, quick, budget)
    folder = output_folder(output)
    with _progress(measurements(selection)) as report:
        results = run_suite(selection, report)
    path = folder / "results.json"
    path.write_text(to_json(results) + "\n", encoding="utf-8")
    plots = [] if no_plots else write_plots(results, folder)
    files = [path, *plots]
    messages().print(f"Wrote {', '.join(str(file) for file in files)}", markup=False)
    return Report({**results, "files": files}, tables(results))


def _selection(
    schemes: str | None, problems: str | None, scene: str | None, frames: str | None, quick: bool, budget: float | None
) -> Any:
    from dataclasses import replace

    from ..benchmarks.integrators import QUICK, Effort, select, select_scene

    effort = QUICK if quick else Effort()
    if budget is not None:
        effort = replace(effort, sweep=validate.number(budget, "budget", above=0.0, maximum=1e6))
    if scene is None:
        if frames is not None:
            raise InputError("--frames says how much of a --scene to run; the test problems have their own durations.")
        return select(_names(schemes), _names(problems), effort)
    if problems is not None:
        raise InputError("Give either --problems or --scene, not both.")
    return select_scene(scene, _names(schemes), effort, _whole(frames))


def _names(text: str | None) -> list[str] | None:
    """The names in a list with commas."""
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()] or [text]


def _whole(text: str | None) -> Any:
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
def _progress(count: int) -> Iterator[Callable[[str], None]]:
    """A bar on stderr; yields what to call before each of ``count`` measurements."""
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    console = messages()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("preparing", total=count, completed=-1)
        yield lambda text: progress.update(task, description=text, advance=1)
