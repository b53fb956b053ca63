"""``warpcloth bench worlds``: how many worlds' steps a second."""

from pathlib import Path
from typing import Any

from rich.table import Table

from .. import validate
from .bench_options import names, output_folder, progress_bar, whole
from .report import Report, to_json
from .terminal import messages, start_warp

SECONDS = 2.0
COLUMNS = ("particles", "substeps", "step_ms", "cpu_ms", "world_steps_per_s", "particle_steps_per_s")


def bench_worlds(
    schemes: str | None, worlds: str | None, resolution: str | None, budget: float | None, output: Path
) -> Report:
    """Measures throughput; arguments as on the command line. Exit code 3 if numbers end up not finite."""
    from ..benchmarks.worlds import cases, run_cases

    counts = None if worlds is None else [whole(number) for number in names(worlds) or []]
    todo = cases(names(schemes), counts, whole(resolution))
    seconds = SECONDS if budget is None else validate.number(budget, "budget", above=0.0, maximum=1e6)
    path = output_folder(output) / "results.json"
    start_warp()
    with progress_bar(len(todo)) as report:
        results = run_cases(todo, seconds, report)
    path.write_text(to_json(results) + "\n", encoding="utf-8")
    messages().print(f"Wrote {path}")
    failed = not all(row["finite"] for row in results["rows"])
    return Report({**results, "files": [path]}, _table(results["rows"]), 3 if failed else 0)


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table("integrator", title="Worlds stepped together", title_justify="left")
    for name in ("worlds", *COLUMNS):
        table.add_column(name.replace("_per_s", "/s").replace("_", " "), justify="right")
    for row in rows:
        table.add_row(row["integrator"], *[_figure(row[name]) for name in ("worlds", *COLUMNS)])
    return table


def _figure(value: float) -> str:
    return f"{value:,}" if isinstance(value, int) else f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"
