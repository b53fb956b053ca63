"""Results as tables for the terminal."""

import math
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table

from .work_precision import cheapest

GOALS = (5e-2, 1e-2, 1e-4)  # looks right, is right, is precise


def tables(results: dict[str, Any]) -> RenderableType:
    """All results: one table a problem, then energy, stability, iterations."""
    parts: list[RenderableType] = [_precision_table(results, name) for name in results["problems"]]
    parts += [_drift_table(results)] if results["drift"] else []
    parts += [_stability_table(results)] if results["stability"] else []
    parts += [_iterations_table(results)] if results["iterations"] else []
    return Group(*[item for part in parts for item in (part, "")])


def _precision_table(results: dict[str, Any], problem: str) -> Table:
    found = results["problems"][problem]
    truth = found["reference"]
    known = "closed form" if truth["uncertainty"] == 0.0 else f"{truth['method']}, known to {truth['uncertainty']:.0e}"
    title = f"{found['title']}: largest steps and wall times, in ms, that bring the error at {found['end']:g} s,\n"
    title += f"relative to the way moved, down to so much (reference: {known})"
    goals = [text for goal in GOALS for text in (f"{100 * goal:g} %\nstep", "\ntime")]
    table = _table(title, "integrator", "order\n(theory)", *goals, "least\nerror")
    for name, row in found["schemes"].items():
        runs, cells, theory = row["runs"], [], results["schemes"][name]["order"]
        for goal in GOALS:
            run = cheapest(runs, goal)
            cells += ["–", "–"] if run is None else [_milliseconds(run["step"]), _milliseconds(run["wall_s"])]
        least = min((run["position_error"] for run in runs), default=math.inf)
        order = f"{row['order']:.2f} ({theory})" if row["order"] is not None else f"({theory})"
        table.add_row(name, order, *cells, _short(least) if runs else "too slow")
    return table


def _drift_table(results: dict[str, Any]) -> Table:
    problems = results["drift"]
    heads = [f"{found['title']}\n{found['end']:g} s" for found in problems.values()]
    title = "Energy of undamped motion, changes in % of the energy in play: the largest / the mean at the end"
    table = _table(title, "integrator", *heads)
    for name in results["schemes"]:
        cells = []
        for found in problems.values():
            row = found["schemes"][name]
            cut = "" if row["complete"] else f" at {row['times'][-1]:.2g} s"
            cells.append(f"{_percent(row['largest'])} / {_percent(row['trend'])}{cut}")
        table.add_row(name, *cells)
    return table


def _stability_table(results: dict[str, Any]) -> Table:
    systems = results["stability"]
    title = "Largest stable step, as ω·dt: measured / theory"
    table = _table(title, "integrator", *systems)
    for name in results["schemes"]:
        cells = []
        for rows in systems.values():
            row = rows.get(name)
            limits = row and [row["omega_dt"], row["omega"] * row["theory"]]
            cells.append(" / ".join(_limit(value) for value in limits) if limits else "adapts its step")
        table.add_row(name, *cells)
    return table


def _iterations_table(results: dict[str, Any]) -> Table:
    found = results["iterations"]
    title = f"One implicit step of {1e3 * found['step']:.3g} ms, {found['title']}: distance from Newton's solution"
    counts = [4**k for k in range(7)]
    table = _table(title, "iterations", *[str(n) for n in counts])
    for name, rows in found["schemes"].items():
        errors = {row["iterations"]: row["error"] for row in rows}
        table.add_row(name, *[_short(errors[n]) if n in errors else "–" for n in counts])
    return table


def _table(title: str, first: str, *heads: str) -> Table:
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, title_style="bold")
    table.add_column(first, no_wrap=True)
    for head in heads:
        table.add_column(head, justify="right")
    return table


def _short(value: float) -> str:
    return f"{value:.1e}" if math.isfinite(value) else "diverged"


def _milliseconds(seconds: float) -> str:
    value = 1e3 * seconds
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"


def _percent(value: float) -> str:
    return f"{100.0 * value:+.2g}" if abs(value) < 0.995 else "lost" if value < 0.0 else "> 100"


def _limit(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "none"
