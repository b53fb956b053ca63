"""``warpcloth integrators``: the time integrators and their properties."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from .report import Report


def command() -> Report:
    """List the time integrators."""
    import warpcloth as wc

    rows = [asdict(info) for info in wc.integrators().values()]
    return Report({"integrators": rows}, "\n".join(_entry(row) for row in rows))


def _entry(row: Mapping[str, Any]) -> str:
    order = f"order {row['order']}" if row["order"] else "no order"
    return f"{row['name']}: {order}, {_kind(row)}, {_limit(row)}; {row['cost']}\n    {row['use']}"


def _kind(row: Mapping[str, Any]) -> str:
    words = [name for name in ("implicit", "symplectic", "adaptive") if row[name]]
    return ", ".join(words if row["implicit"] else ["explicit", *words])


def _limit(row: Mapping[str, Any]) -> str:
    """Of the undamped oscillator."""
    limit = row["stability_limit"]
    if limit is None:
        return "any step"
    return f"stable to ω dt = {limit:.2f}" if limit > 0.0 else "stable with damping only"
