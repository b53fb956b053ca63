"""``warpcloth bench``: measurements of schemes, speed, contact under stress, many worlds, the page under load."""

from pathlib import Path
from typing import Annotated, Any

import typer

from .. import validate
from ..errors import InputError
from .bench_contact import bench_contact
from .bench_integrators import bench_integrators
from .bench_speed import bench_speed
from .bench_view import bench_view
from .bench_worlds import bench_worlds
from .report import Report

BENCHMARKS = ("integrators", "contact", "worlds", "view", "speed")
# Which of the benchmarks have an option that not all have.
HAVE = {
    **dict.fromkeys(("problems", "quick"), ("integrators", "speed")),
    "no_plots": ("integrators",),
    "compare": ("speed",),
    "budget": ("integrators", "contact", "worlds", "view"),
    **dict.fromkeys(("count", "seed", "resume"), ("contact",)),
    "schemes": ("integrators", "contact", "worlds", "speed"),
    "scene": ("integrators", "contact", "view"),
    "frames": ("integrators", "contact", "speed"),
    "resolution": ("contact", "worlds", "view", "speed"),
    "worlds": ("worlds",),
}

What = Annotated[
    str, typer.Argument(metavar="WHAT", help="What to measure: integrators, contact, worlds, view or speed.")
]
Schemes = Annotated[
    str | None,
    typer.Option(
        "--integrators",
        metavar="A,B,…",
        help="Only these (see `integrators`).  "
        "[default: all; contact: those of the scenes; worlds: two; speed: xpbd and peers]",
    ),
]
Problems = Annotated[
    str | None,
    typer.Option(
        "--problems",
        metavar="A,B,…",
        help="Only these test problems; speed: parts.  [default: all; speed: all but scaling and startup]",
    ),
]
SceneOption = Annotated[
    str | None,
    typer.Option("--scene", help="Measure on this scene instead of the test problems; contact: on these, A,B,…"),
]
Frames = Annotated[str | None, typer.Option(metavar="N", help="Frames of the scene; speed: of each.  [default: all]")]
Quick = Annotated[bool, typer.Option("--quick", help="Half a minute instead of minutes: fewer, coarser runs.")]
Count = Annotated[str | None, typer.Option(metavar="N", help="contact: how many random scenes.  [default: 20]")]
Seed = Annotated[str | None, typer.Option(metavar="N", help="contact: seed of the first random scene.  [default: 0]")]
Resolution = Annotated[
    str | None,
    typer.Option(
        metavar="N",
        help="contact, worlds, view, speed: N² vertices in each cloth.  [default: the scene's; 16; 64; 64 and 128]",
    ),
]
Resume = Annotated[bool, typer.Option("--resume", help="contact: leave out what DIR/results.json has already.")]
Worlds = Annotated[
    str | None, typer.Option(metavar="N,N,…", help="worlds: how many at once.  [default: 1,4,16,64,256]")
]
Budget = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        help="Time for one scheme on one problem; contact: for one scene; worlds: for one number; view: to count.",
    ),
]
Compare = Annotated[
    Path | None,
    typer.Option("--compare", metavar="FILE", help="speed: results.json of an earlier run, for ratios to it."),
]
Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="DIR", help="Folder for results.json and the plots.  [default: bench_WHAT]"),
]
NoPlots = Annotated[bool, typer.Option("--no-plots", help="Write no plots, so that matplotlib is not needed.")]


def command(
    what: What,
    schemes: Schemes = None,
    problems: Problems = None,
    scene: SceneOption = None,
    frames: Frames = None,
    quick: Quick = False,
    count: Count = None,
    seed: Seed = None,
    resolution: Resolution = None,
    resume: Resume = False,
    worlds: Worlds = None,
    budget: Budget = None,
    compare: Compare = None,
    output: Output = None,
    no_plots: NoPlots = False,
) -> Report:
    """Compare the integrators: accuracy, cost, energy, stability. Or measure speed, contact, worlds, the page."""
    given: dict[str, Any] = {
        "problems": problems, "quick": quick, "no_plots": no_plots,
        "count": count, "seed": seed, "resolution": resolution, "resume": resume,
        "scene": scene, "frames": frames, "worlds": worlds, "schemes": schemes, "budget": budget, "compare": compare,
    }  # fmt: skip
    validate.choice(what, BENCHMARKS, "what to measure")
    _check_options(what, given)
    folder = Path(f"bench_{what}") if output is None else output
    if what == "contact":
        return bench_contact(schemes, scene, frames, count, seed, resolution, budget, resume, folder)
    if what == "view":
        return bench_view(scene, resolution, budget, folder)
    if what == "worlds":
        return bench_worlds(schemes, worlds, resolution, budget, folder)
    if what == "speed":
        return bench_speed(schemes, problems, frames, resolution, quick, compare, folder)
    return bench_integrators(schemes, problems, scene, frames, quick, budget, folder, no_plots)


def _check_options(what: str, given: dict[str, Any]) -> None:
    """Refuses options that the benchmark does not have.

    Raises:
        InputError: one of them is given.
    """
    for name, owners in HAVE.items():
        if what not in owners and given[name] not in (None, False):
            flag = "integrators" if name == "schemes" else name.replace("_", "-")
            option, have = f"--{flag}", " and ".join(f"`bench {owner}`" for owner in owners)
            raise InputError(f"{option} is an option of {have}, not of `bench {what}`.")
