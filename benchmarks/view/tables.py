"""Results as a table for the terminal."""

from typing import Any

from rich.console import RenderableType
from rich.table import Table


def table(results: dict[str, Any]) -> RenderableType:
    """What a client of the page got."""
    gap, latency = results["gap_ms"], results["latency_s"]
    out = Table("page", "", title=f"{results['scene']}, {results['particles']} particles", title_justify="left")
    rows = {
        "updates per second, median": f"{results['updates_per_second']:.0f} (target {results['target']:.0f})",
        "in the slowest second": f"{results['slowest_second']}",
        "between updates: median, 95 %, longest": f"{gap['median']:.0f}, {gap['p95']:.0f}, {gap['longest']:.0f} ms",
        "size of an update": f"{results['bytes_per_update'] / 1024:.0f} KiB",
        "simulated time over real time": f"{results['real_time_factor']:.2f}",
        "substeps, and parts that are shown, of a frame": f"{results['substeps']}, {results['parts_per_frame']}",
        **{f"latency of {name}": f"{1e3 * found['median']:.0f} ms" for name, found in latency.items()},
        "load per core": f"{results['machine']['load_per_core']}",
    }
    for name, value in rows.items():
        out.add_row(name, value)
    return out
