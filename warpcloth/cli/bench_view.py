"""``warpcloth bench view``: how often the page of a simulation changes, and how soon it obeys."""

from pathlib import Path

from .. import validate
from .bench_options import output_folder, progress_bar, whole
from .report import Report, to_json
from .terminal import messages, start_warp

SCENE, RESOLUTION, SECONDS = "drape_sphere", 64, 20.0


def bench_view(scene: str | None, resolution: str | None, budget: float | None, output: Path) -> Report:
    """Measures it; arguments as on the command line."""
    from ..benchmarks.view import run_view
    from ..benchmarks.view.tables import table
    from ..scenes import load_scene
    from ..view.server import viser

    viser()
    seconds = validate.number(SECONDS if budget is None else budget, "budget", minimum=1.0, maximum=1e4)
    changes = []
    if scene is None or resolution is not None:
        count = RESOLUTION if resolution is None else whole(resolution)
        count = validate.integer(count, "resolution", minimum=2, maximum=1000)
        changes = [f"cloth.0.resolution=[{count}, {count}]"]
    loaded = load_scene(scene or SCENE, changes)
    path = output_folder(output) / "results.json"
    start_warp()
    with progress_bar(3) as report:
        results = run_view(loaded, seconds, report)
    path.write_text(to_json(results) + "\n", encoding="utf-8")
    messages().print(f"Wrote {path}")
    return Report({**results, "files": [path]}, table(results))
