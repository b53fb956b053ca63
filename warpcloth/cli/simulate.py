"""``warpcloth simulate``: a scene in, a USD cache out."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from .render import picture_bar
from .report import INTERRUPTED, Report
from .terminal import messages, start_warp

if TYPE_CHECKING:
    from ..scenes import SimulationResult

SceneArgument = Annotated[
    str, typer.Argument(metavar="SCENE", help="A bundled scene (see `scenes`), a .toml file or a USD stage.")
]
Output = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        help="Cache to write: .usd, .usdc, .usda or .usdz.  [default: SCENE.usdc; of a stage SCENE_sim.usda and layer]",
    ),
]
ClothPrims = Annotated[
    list[str] | None,
    typer.Option("--cloth", metavar="PRIM", help="In a USD stage: a mesh that is cloth, or a parent of some."),
]
ColliderPrims = Annotated[
    list[str] | None,
    typer.Option("--collider", metavar="PRIM", help="In a USD stage: what cloth collides with, besides its colliders."),
]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="PATH=VALUE", help="Change any field of the scene, e.g. cloth.0.fabric.areal_density=0.3."
    ),
]
Frames = Annotated[str | None, typer.Option(metavar="N", help="Frames to simulate.")]
Integrator = Annotated[str | None, typer.Option(help="Time integrator (see `integrators`).")]
Substeps = Annotated[str | None, typer.Option(metavar="N|auto", help="Steps per frame, or auto.")]
Device = Annotated[str | None, typer.Option(help="Device, e.g. cpu or cuda:0.")]
Check = Annotated[str, typer.Option(metavar="every|last", help="Frames to check for intersections and penetration.")]
Profile = Annotated[bool, typer.Option("--profile", help="Time the stages of each frame.")]
Untangle = Annotated[bool, typer.Option("--untangle", help="Try to resolve intersections at the start.")]
Threads = Annotated[
    str | None, typer.Option(metavar="N", help="Cores of the CPU to use.  [default: all, but for small scenes]")
]
Precision = Annotated[str | None, typer.Option(help="float32 or float64.")]
Render = Annotated[bool, typer.Option("--render", help="Also make a film of it, beside the cache (see `render`).")]


def command(
    scene: SceneArgument,
    output: Output = None,
    changes: Changes = None,
    frames: Frames = None,
    integrator: Integrator = None,
    substeps: Substeps = None,
    device: Device = None,
    precision: Precision = None,
    check: Check = "last",
    profile: Profile = False,
    render: Render = False,
    untangle: Untangle = False,
    threads: Threads = None,
    cloth: ClothPrims = None,
    collider: ColliderPrims = None,
) -> Report:
    """Simulate SCENE and write it as a USD cache."""
    from ..scenes import load_scene, simulate

    loaded = load_scene(scene, changes or (), cloth=cloth or (), collider=collider or ())
    if render:
        _check_renderer()
    start_warp()
    options: dict[str, Any] = {"integrator": integrator, "device": device, "precision": precision, "check": check}
    options |= {"profile": profile, "untangle": untangle, "threads": _whole(threads)}
    with progress_bar(loaded.name) as on_frame:
        result = simulate(
            loaded, output, frames=_whole(frames), substeps=_whole(substeps), on_frame=on_frame, **options
        )
    data, text = result.as_dict(), _summary(result)
    if render and not result.interrupted:
        film = _film(result.output)
        data["film"], text = film, f"{text}\n{film}"
    return Report(data, text, INTERRUPTED if result.interrupted else 0)


def _check_renderer() -> None:
    """Finds out before the simulation, not after it, that a library is missing."""
    from ..render.paint import pyvista

    pyvista()


def _film(cache: Path) -> Path:
    """Renders a film beside a cache."""
    from ..render import render

    with picture_bar(cache.name) as on_picture:
        return render(cache, on_picture=on_picture).output


@contextmanager
def progress_bar(name: str) -> Iterator[Any]:
    """A bar on stderr; yields what to call after each frame."""
    columns = (
        TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TimeRemainingColumn(),
    )  # fmt: skip
    console = messages()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(f"{name}: preparing", total=None)

        def on_frame(frame: int, frames: int, simulation: Any) -> None:
            progress.update(task, description=name, completed=frame, total=frames)

        yield on_frame


def _whole(text: str | None) -> Any:
    """The whole number where the text is one; the scene's own rules judge that, and whatever else it is."""
    return int(text) if text is not None and re.fullmatch("-?[0-9]{1,30}", text) else text


def _summary(result: "SimulationResult") -> str:
    """What people want to know at the end."""
    head = f"{result.output}: frames 0 to {result.frames} at {result.fps:g} per second"
    if result.interrupted:
        head += " (interrupted)"
    lines = [
        head,
        f"{result.particles:,} particles, {result.springs:,} springs, {result.triangles:,} triangles",
        f"{result.integrator} with {result.substeps} substeps a frame, {result.precision} on {result.device}",
        f"{result.ms_per_frame:.1f} ms per frame, {result.compile_s:.1f} s to prepare, {result.wall_s:.1f} s in all",
        f"strain {100 * result.mean_strain:.2g} % on average and {100 * result.max_strain:.2g} % at most; "
        f"{'at rest' if result.settled else 'still moving'}",
        f"deepest penetration {1e3 * result.max_penetration_m:.3g} mm, {result.intersections} crossing triangle pairs, "
        f"{result.obstacle_intersections} with obstacles ({'every' if result.checked_frames > 1 else 'last'} frame)",
    ]
    if result.untangled:
        done = result.untangled
        left = " in part" if done["after"] or done["inside_after"] else ""
        lines.append(
            f"start untangled{left}: {done['before']} crossing pairs became {done['after']}, "
            f"{done['inside_before']} particles deep in solids {done['inside_after']}, in {done['rounds']} rounds; "
            f"particles moved up to {1e3 * done['moved_m']:.3g} mm"
        )
    if result.profile_ms:
        stages = (f"{name} {spent:.2f}" for name, spent in result.profile_ms.items())
        lines.append(f"ms per frame: {', '.join(stages)}")
    return "\n  ".join(lines)
