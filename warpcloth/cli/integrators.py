"""``warpcloth integrators``: the time integrators and their properties."""

from dataclasses import asdict

from rich.table import Table

from .report import Report


def command() -> Report:
    """List the time integrators."""
    import warpcloth as wc

    rows = [asdict(info) for info in wc.integrators().values()]
    table = Table(box=None, pad_edge=False)
    for heading in ("integrator", "order", "kind", "symplectic", "reference"):
        table.add_column(heading)
    for row in rows:
        kind = "implicit" if row["implicit"] else "explicit"
        table.add_row(row["name"], str(row["order"]), kind, "yes" if row["symplectic"] else "no", row["reference"])
    return Report({"integrators": rows}, table)
