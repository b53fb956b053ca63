"""``warpcloth check``: whether a cache is what it should be."""

from pathlib import Path
from typing import Annotated

import typer

from .report import Report
from .terminal import start_warp

Cache = Annotated[Path, typer.Argument(metavar="CACHE", help="A USD cache written by `simulate`.")]
Every = Annotated[bool, typer.Option("--every", help="Count intersections at every frame, not at the last one only.")]


def command(cache: Cache, every: Every = False) -> Report:
    """Check a USD cache: topology, finite values, velocities, strain, penetration, intersections, validator errors."""
    from ..scenes import check_cache

    start_warp()
    report = check_cache(cache, every=every)
    return Report(report.as_dict(), str(report), 0 if report.ok else 3)
