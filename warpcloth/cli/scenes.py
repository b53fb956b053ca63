"""``warpcloth scenes``: the scenes that come with warpcloth."""

from rich.table import Table

from .report import Report


def command() -> Report:
    """List the bundled scenes."""
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
