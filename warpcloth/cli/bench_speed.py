"""``warpcloth bench speed``: how fast cloth is, beside other tools and plain C++."""

from pathlib import Path

from .bench_options import names, output_folder, progress_bar, whole
from .report import Report, to_json
from .terminal import messages, start_warp


def bench_speed(
    schemes: str | None,
    problems: str | None,
    frames: str | None,
    resolution: str | None,
    quick: bool,
    earlier: Path | None,
    output: Path,
) -> Report:
    """Measures it; arguments as on the command line. Exit code 3 if a result of ours is not sound."""
    from ..benchmarks.speed import comparison, earlier_results, effort, measurements, run_parts
    from ..benchmarks.speed.tables import tables

    chosen = effort(names(problems), names(schemes), whole(resolution), whole(frames), quick)
    before = None if earlier is None else earlier_results(earlier)
    path = output_folder(output) / "results.json"
    start_warp()
    with progress_bar(measurements(chosen)) as report:
        results = run_parts(chosen, report)
    if before is not None:
        results["comparison"] = comparison(results, before)
    path.write_text(to_json(results) + "\n", encoding="utf-8")
    messages().print(f"Wrote {path}")
    return Report({**results, "files": [path]}, tables(results), 3 if results["failures"] else 0)
