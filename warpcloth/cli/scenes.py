"""``warpcloth scenes``: the scenes that come with warpcloth, as a list or as USD stages."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from ..errors import InputError
from .report import Report
from .terminal import start_warp

Action = Annotated[str, typer.Argument(metavar="[list|export]", help="What to do.")]
Name = Annotated[str | None, typer.Argument(metavar="[SCENE]", help="To export: a bundled scene or a .toml file.")]
Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", help="Stage to write: .usd, .usda, .usdc or .usdz.  [default: SCENE.usda]"),
]
Changes = Annotated[
    list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="Change a field of the scene, see `simulate`.")
]


def command(action: Action = "list", scene: Name = None, output: Output = None, changes: Changes = None) -> Report:
    """List the bundled scenes, or export one as a USD stage that `simulate` and other tools take."""
    if action == "export":
        return _export(scene, output, changes or [])
    if action != "list":
        raise InputError(f"There is no `scenes {action}`; use `scenes list` or `scenes export SCENE -o FILE`.")
    if scene is not None or output is not None or changes:
        raise InputError("`scenes list` takes neither a scene nor options; use `scenes export SCENE -o FILE`.")
    return _list()


def _list() -> Report:
    from ..scenes import bundled_scenes, load_scene

    scenes = [load_scene(name) for name in bundled_scenes()]
    table = Table(box=None, pad_edge=False)
    for heading in ("scene", "frames", "what it shows"):
        table.add_column(heading, justify="right" if heading == "frames" else "left")
    for scene in scenes:
        table.add_row(scene.name, str(scene.frames), scene.title)
    rows = [
        {"name": scene.name, "frames": scene.frames, "fps": scene.fps}
        | {"title": scene.title, "description": scene.description, "path": scene.folder / f"{scene.name}.toml"}
        for scene in scenes
    ]
    return Report({"scenes": rows}, table)


def _export(name: str | None, output: Path | None, changes: list[str]) -> Report:
    from ..scenes import export_scene, load_scene

    if name is None:
        raise InputError("`scenes export` needs the scene to export; `scenes list` has the bundled ones.")
    scene = load_scene(name, changes)
    start_warp()
    path = export_scene(scene, Path(f"{scene.name}.usda") if output is None else output).absolute()
    return Report({"scene": scene.name, "frames": scene.frames, "output": path}, f"{path}: {scene.name} as a stage")
