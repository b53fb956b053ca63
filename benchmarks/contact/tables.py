"""Results as tables for the terminal."""

from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table

from .suite import summarise

COLUMNS = ("clean", "crossing", "penetrating", "stopped", "torn", "unfinished", "locked", "pinched")


def tables(results: dict[str, Any]) -> RenderableType:
    """How many scenes of each integrator are how, and then all that failed, with the command that shows each again."""
    rows = results["rows"]
    table = Table("integrator", "scenes", *COLUMNS, title="Contact, every frame checked", title_justify="left")
    for scheme in sorted({row["integrator"] for row in rows}):
        found = summarise(row for row in rows if row["integrator"] == scheme)
        table.add_row(scheme, str(found["scenes"]), *[str(found[name]) for name in COLUMNS])
    total = results["summary"]
    table.add_section()
    table.add_row("all", str(total["scenes"]), *[str(total[name]) for name in COLUMNS])
    return Group(table, *[line for row in rows if row["failures"] for line in _told(row)])


def _told(row: dict[str, Any]) -> list[str]:
    """What happened in a scene, and how to see it again."""
    again = f"warpcloth bench contact {row['arguments']}"
    return [f"{row['title']} ({row['integrator']}): {'; '.join(row['failures'])}", f"    {again}"]
