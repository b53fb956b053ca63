"""``warpcloth render``: pictures and films of a cache."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ..errors import InputError
from .report import Report
from .terminal import messages, start_warp

Cache = Annotated[Path, typer.Argument(metavar="CACHE", help="A USD cache, as `simulate` writes it.")]
Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", help="A film, .mp4 or .gif, or a picture, .png or .jpg.  [default: CACHE.mp4]"),
]
Frame = Annotated[
    int | None, typer.Option(metavar="N", help="A picture of this frame; -1 is the last one.  [default: a film]")
]
Turntable = Annotated[bool, typer.Option("--turntable", help="A film around one frame, by default the last.")]
Sheet = Annotated[int | None, typer.Option(metavar="N", help="One picture of N frames, evenly over time.")]
Size = Annotated[str, typer.Option(metavar="WxH", help="Width and height in pixels.")]
CameraOption = Annotated[
    str,
    typer.Option(
        "--camera", help="auto, front, back, left, right, top, low, high; azimuth,elevation[,zoom]; x,y,z,tx,ty,tz."
    ),
]
USUAL_RATE = "the cache's, up to 60, or 25 in a .gif; 24 around one frame"
Fps = Annotated[float | None, typer.Option(metavar="N", help=f"Pictures per second.  [default: {USUAL_RATE}]")]
Color = Annotated[str, typer.Option(help="What colours show: fabric, strain or speed.")]
Pattern = Annotated[str, typer.Option(help="Pattern of the cloth: plain, weave, gingham, stripes, dots, windowpane.")]


def command(
    cache: Cache,
    output: Output = None,
    frame: Frame = None,
    turntable: Turntable = False,
    sheet: Sheet = None,
    size: Size = "1280x800",
    camera: CameraOption = "auto",
    fps: Fps = None,
    color: Color = "fabric",
    pattern: Pattern = "weave",
) -> Report:
    """Render CACHE: a film, or a picture of a frame, a turntable, a sheet of frames over time."""
    from ..render import render

    start_warp()
    with picture_bar(cache.name) as on_picture:
        result = render(
            cache,
            output,
            frame=frame,
            turntable=turntable,
            sheet=sheet,
            size=parse_size(size),
            camera=camera,
            fps=fps,
            color=color,
            pattern=pattern,
            on_picture=on_picture,
        )
    width, height = result.size
    count = "1 picture" if result.pictures == 1 else f"{result.pictures} pictures"
    what = f"{count} at {result.fps:g} per second" if result.fps else "a picture"
    text = f"{result.output}: {what}, {width} x {height}, in {result.seconds:.1f} s"
    return Report(result.as_dict(), text)


def parse_size(text: str) -> tuple[int, int]:
    """Width and height of ``1280x800``.

    Raises:
        InputError: the text is not of that form.
    """
    match = re.fullmatch(r"([0-9]{1,5})[x×]([0-9]{1,5})", text.strip())
    if match is None:
        raise InputError(f"The size {text!r} must be width and height in pixels, such as 1280x800.")
    return int(match[1]), int(match[2])


@contextmanager
def picture_bar(name: str) -> Iterator[Any]:
    """A bar on stderr; yields what to call after each picture."""
    columns = (
        TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TimeRemainingColumn(),
    )  # fmt: skip
    console = messages()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(f"{name}: rendering", total=None)
        yield lambda number, count: progress.update(task, completed=number, total=count)
