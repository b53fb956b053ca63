"""``warpcloth fabrics``: the library of fabrics, and where each number comes from."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from .report import Report

if TYPE_CHECKING:
    from ..fabric_library import LibraryFabric

UNITS = {
    "areal_density": "kg/m²", "thickness": "m", "stretch_stiffness": "N/m", "stretch_stiffness_weft": "N/m",
    "shear_stiffness": "N/m", "bending_rigidity": "N m", "bending_rigidity_weft": "N m", "twist_ratio": "",
    "bending_hysteresis": "N", "bend_stiffness": "N/m", "damping_time": "s", "friction": "", "air_drag": "",
    "air_friction": "", "strain_limit": "", "limit_stiffness": "N/m",
}  # fmt: skip
NameArgument = Annotated[str | None, typer.Argument(metavar="[NAME]", help="A fabric: the source of each value.")]


def command(name: NameArgument = None) -> Report:
    """List the fabrics that scenes can name."""
    from .. import validate
    from ..fabric_library import fabrics

    library = fabrics()
    if name is not None:
        entry = library[validate.choice(name, library, "fabric")]
        return Report(_row(entry), _details(entry))
    text = "\n".join(_entry(entry) for entry in library.values())
    return Report({"fabrics": [_row(entry) for entry in library.values()]}, text)


def _entry(entry: "LibraryFabric") -> str:
    fabric = entry.fabric
    numbers = (
        f"{1e3 * fabric.areal_density:.0f} g/m²",
        f"{1e3 * fabric.thickness:.2f} mm",
        f"stretch {_pair(fabric.stretch)} N/m",
        f"shear {fabric.shear_stiffness:g} N/m",
        f"bending {_pair([1e6 * b for b in fabric.bending])} µN m",
        f"hysteresis {1e3 * fabric.bending_hysteresis:.2g} mN",
    )
    return f"{fabric.name}: {', '.join(numbers)}\n    {entry.description}"


def _pair(values: Any) -> str:
    """Warp and weft, or one number where they are equal."""
    warp, weft = (f"{value:.0f}" if value >= 1000.0 else f"{value:.3g}" for value in values)
    return warp if warp == weft else f"{warp} / {weft}"


def _row(entry: "LibraryFabric") -> dict[str, Any]:
    sources = dict(entry.sources)
    return asdict(entry.fabric) | {"description": entry.description, "units": UNITS, "sources": sources}


def _details(entry: "LibraryFabric") -> Table:
    table = Table(box=None, pad_edge=False, title=f"{entry.fabric.name}: {entry.description}", title_justify="left")
    for heading in ("property", "value", "unit", "source"):
        table.add_column(heading, justify="right" if heading == "value" else "left", overflow="fold")
    for field, source in entry.sources.items():
        table.add_row(field, f"{getattr(entry.fabric, field):g}", UNITS[field], source)
    return table
