"""``warpcloth bench contact``: random scenes and given ones, every frame checked."""

from pathlib import Path
from typing import Any

from .. import validate
from ..errors import InputError
from .bench_options import names, output_folder, progress_bar, whole
from .report import Report, to_json
from .terminal import messages, start_warp

RANDOM_SCENES = 20


def bench_contact(
    schemes: str | None,
    scene: str | None,
    frames: str | None,
    count: str | None,
    seed: str | None,
    resolution: str | None,
    budget: float | None,
    resume: bool,
    output: Path,
) -> Report:
    """Watches the scenes; arguments as on the command line. Exit code 3 if anything fails in one of them."""
    from ..benchmarks.contact import kept_rows, run_cases
    from ..benchmarks.contact.tables import tables

    cases = _cases(schemes, scene, frames, count, seed, resolution)
    seconds = None if budget is None else validate.number(budget, "budget", above=0.0, maximum=1e6)
    path = output_folder(output) / "results.json"
    kept = kept_rows(path) if resume else []
    start_warp()
    with progress_bar(len(cases)) as report:

        def on_case(results: dict[str, Any], row: dict[str, Any]) -> None:
            # After each, so that whatever ends the run, the next one can go on from here.
            partial = path.with_suffix(".partial")
            partial.write_text(to_json(results) + "\n", encoding="utf-8")
            partial.replace(path)
            report(f"{row['scene']}, {row['integrator']}")

        report(cases[0].scene.name)
        results = run_cases(cases, seconds, kept, on_case)
    messages().print(f"Wrote {path}")
    failed = any(row["failures"] for row in results["rows"])
    return Report({**results, "files": [path]}, tables(results), 3 if failed else 0)


def _cases(
    schemes: str | None,
    scene: str | None,
    frames: str | None,
    count: str | None,
    seed: str | None,
    resolution: str | None,
) -> Any:
    from ..benchmarks.contact import given_cases, random_cases

    common = (names(schemes), whole(frames), whole(resolution))
    if scene is None:
        first, many = whole(seed), whole(count)
        return random_cases(0 if first is None else first, RANDOM_SCENES if many is None else many, *common)
    if seed is not None or count is not None:
        raise InputError("--seed and --count choose random scenes; give either these or --scene.")
    return given_cases(names(scene) or [], *common)
