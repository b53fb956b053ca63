"""Results as tables for the terminal."""

from collections.abc import Callable
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table

Row = dict[str, Any]
Column = tuple[str, Callable[[Row], str]]


def tables(results: dict[str, Any]) -> RenderableType:
    """Everything that was measured, and what is not sound."""
    parts = [made for name, part in results["parts"].items() if part["rows"] for made in MAKERS[name](part)]
    if results.get("comparison"):
        parts.append(_ratios(results["comparison"]))
    machine = results["machine"]
    note = f"{machine['processor']}, {machine['cores']} cores, load per core at the start {machine['load_per_core']}"
    return Group(*parts, note, *results["failures"])


def _table(title: str, rows: list[Row], columns: list[Column]) -> Table:
    table = Table(title=title, title_justify="left")
    for number, (head, value) in enumerate(columns):
        name = max([0, *map(len, map(value, rows))]) if number == 0 else None  # names are not cut short
        table.add_column(head, justify="right" if number else "left", min_width=name)
    for row in rows:
        table.add_row(*[value(row) for _, value in columns])
    return table


def _number(name: str, form: str = "{:.1f}", scale: float = 1.0) -> Callable[[Row], str]:
    return lambda row: "–" if row.get(name) is None else form.format(scale * row[name])


def _text(name: str) -> Callable[[Row], str]:
    return lambda row: str(row.get(name, "–"))


def _size(row: Row) -> str:
    return f"{row['resolution']}²"


def _race(title: str, own: Column) -> Callable[[dict[str, Any]], list[RenderableType]]:
    def make(part: dict[str, Any]) -> list[RenderableType]:
        columns: list[Column] = [
            ("tool", _text("tool")), ("n", _size), ("steps", _text("substeps")), ("ms", _number("frame_ms")),
            ("mean", _number("mean_ms")), ("cpu ms", _number("cpu_ms")), ("runs", _text("repeats")),
            ("strain %", _number("mean_strain", "{:.2f}", 100.0)),
            ("worst %", _number("worst_strain", "{:.2f}", 100.0)),
            own, ("pairs", _text("intersections")), ("misses", _verdict),
        ]  # fmt: skip
        return [_table(title, part["rows"], columns)]

    return make


def _verdict(row: Row) -> str:
    if "failed" in row:
        return f"failed: {row['failed']}"
    if row["misses"] is None:
        return "–"
    names = [name.removesuffix("_m").removesuffix("_strain") for name in row["misses"]]
    return ", ".join(names) or "nothing"


def _throughput(part: dict[str, Any]) -> list[RenderableType]:
    columns: list[Column] = [
        ("explicit step of", _text("hand")), ("n", _size), ("springs", _number("springs", "{:,.0f}")),
        ("ms", _number("frame_ms", "{:.2f}")), ("M springs/s", _number("springs_per_s", "{:.1f}", 1e-6)),
        ("to Warp's", _number("ratio", "{:.2f}")), ("to C++", _number("ratio_cpp", "{:.2f}")),
        ("differs by, µm", _number("difference_m", "{:.2g}", 1e6)),
    ]  # fmt: skip
    return [_table(f"Explicit step, 16 in a frame; C++: {part['compiler']}", part["rows"], columns)]


def _scaling(part: dict[str, Any]) -> list[RenderableType]:
    columns: list[Column] = [
        ("problem", _text("problem")), ("n", _size), ("substeps", _text("substeps")),
        ("ms", _number("frame_ms", "{:.2f}")), ("cpu ms", _number("cpu_ms", "{:.2f}")),
        ("ns per particle and step", _number("particle_step_ns")),
        ("bytes per particle", _number("bytes_per_particle", "{:,.0f}")),
        ("at most", _number("peak_bytes_per_particle", "{:,.0f}")),
    ]  # fmt: skip
    exponents = [
        f"{problem}: time of a frame ~ particles^{found['frame']:.2f}, of a step ^{found['step']:.2f}"
        for problem, found in part["exponents"].items()
    ]
    return [_table("Scaling", part["rows"], columns), *exponents]


def _startup(part: dict[str, Any]) -> list[RenderableType]:
    columns: list[Column] = [
        ("start", _text("what")), ("s", _number("seconds", "{:.2f}")), ("runs", _text("repeats")),
    ]  # fmt: skip
    return [_table("Start", part["rows"], columns)]


def _output(part: dict[str, Any]) -> list[RenderableType]:
    columns: list[Column] = [
        ("n", _size), ("frames", _text("frames")), ("step ms", _number("step_ms", "{:.2f}")),
        ("write ms", _number("write_ms", "{:.2f}")), ("kB a frame", _number("bytes_per_frame", "{:,.1f}", 1e-3)),
        ("share %", _number("share", "{:.1f}", 100.0)),
    ]  # fmt: skip
    return [_table("Writing USD", part["rows"], columns)]


def _profile(part: dict[str, Any]) -> list[RenderableType]:
    stages: list[Column] = [("stage", _text("what")), ("ms a frame", _number("frame_ms", "{:.2f}"))]
    kernels: list[Column] = [
        ("kernel", _text("kernel")), ("ms a frame", _number("frame_ms", "{:.2f}")), ("calls", _number("calls")),
        ("µs a call", _number("call_us")),
    ]  # fmt: skip
    head = f"Drape, {part['resolution']}²"
    return [_table(head, part["rows"], stages), _table(f"{head}, without a graph", part["kernels"], kernels)]


def _ratios(rows: list[Row]) -> Table:
    columns: list[Column] = [
        ("cost", _text("what")), ("earlier", _number("earlier", "{:,.4g}")), ("now", _number("now", "{:,.4g}")),
        ("now / earlier", _number("ratio", "{:.2f}")),
    ]  # fmt: skip
    return _table("Compared with the earlier run", rows, columns)


MAKERS: dict[str, Callable[[dict[str, Any]], list[RenderableType]]] = {
    "hang": _race("Hanging by an edge", ("swing m", _number("swing_m", "{:.3f}"))),
    "drape": _race("Drape with contact among itself", ("depth mm", _number("penetration_m", "{:.3f}", 1e3))),
    "throughput": _throughput,
    "scaling": _scaling,
    "startup": _startup,
    "output": _output,
    "profile": _profile,
}
