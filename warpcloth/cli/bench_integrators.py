"""``warpcloth bench integrators``: accuracy against cost, energy drift, largest stable steps."""

from pathlib import Path
from typing import Any

from .. import validate
from ..errors import InputError
from .bench_options import names, output_folder, progress_bar, whole
from .report import Report, to_json
from .terminal import messages, start_warp


def bench_integrators(
    schemes: str | None,
    problems: str | None,
    scene: str | None,
    frames: str | None,
    quick: bool,
    budget: float | None,
    output: Path,
    no_plots: bool,
) -> Report:
    """Runs the comparison; arguments as on the command line."""
    from ..benchmarks.integrators import measurements, run_suite
    from ..benchmarks.integrators.plots import write_plots
    from ..benchmarks.integrators.style import pyplot
    from ..benchmarks.integrators.tables import tables

    if not no_plots:
        pyplot()
    start_warp()
    selection = _selection(schemes, problems, scene, frames, quick, budget)
    folder = output_folder(output)
    with progress_bar(measurements(selection)) as report:
        results = run_suite(selection, report)
    path = folder / "results.json"
    path.write_text(to_json(results) + "\n", encoding="utf-8")
    plots = [] if no_plots else write_plots(results, folder)
    files = [path, *plots]
    messages().print(f"Wrote {', '.join(str(file) for file in files)}")
    return Report({**results, "files": files}, tables(results))


def _selection(
    schemes: str | None, problems: str | None, scene: str | None, frames: str | None, quick: bool, budget: float | None
) -> Any:
    from dataclasses import replace

    from ..benchmarks.integrators import QUICK, Effort, select, select_scene

    effort = QUICK if quick else Effort()
    if budget is not None:
        budget = validate.number(budget, "budget", above=0.0, maximum=1e6)
        effort = replace(effort, sweep=budget, reference=max(effort.reference, 10.0 * budget))
    if scene is None:
        if frames is not None:
            raise InputError("--frames says how much of a --scene to run; the test problems have their own durations.")
        return select(names(schemes), names(problems), effort)
    if problems is not None:
        raise InputError("Give either --problems or --scene, not both.")
    return select_scene(scene, names(schemes), effort, whole(frames))
