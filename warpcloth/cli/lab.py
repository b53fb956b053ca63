"""``warpcloth lab``: laboratory tests of fabrics on simulated specimens."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Group
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from .. import validate
from ..errors import SimulationError
from .bench_options import output_folder
from .report import Report, to_json
from .terminal import messages, start_warp

if TYPE_CHECKING:
    from ..lab import Result, Setup

Test = Annotated[str, typer.Argument(metavar="TEST", help="A test, or `report` for all of them on one page.")]
FabricName = Annotated[str, typer.Option("--fabric", metavar="NAME", help="What is tested, see `fabrics`.")]
Scheme = Annotated[str, typer.Option("--integrator", metavar="NAME", help="Scheme, see `integrators`.")]
Cells = Annotated[int | None, typer.Option("--resolution", metavar="N", help="Cells along it.  [default: as the test]")]
Mesh = Annotated[str, typer.Option("--mesh", metavar="KIND", help="grid or irregular.")]
Angle = Annotated[float, typer.Option("--angle", metavar="DEGREES", help="Of the grid's lines to the specimen.")]
Seed = Annotated[int, typer.Option("--seed", help="Of irregular meshes and of starts that differ.")]
Output = Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for tables and pictures.")]
NoPlots = Annotated[bool, typer.Option("--no-plots", help="Write no pictures, so that matplotlib is not needed.")]


def command(
    test: Test,
    fabric: FabricName = "cotton",
    integrator: Scheme = "implicit_euler",
    resolution: Cells = None,
    mesh: Mesh = "grid",
    angle: Angle = 0.0,
    seed: Seed = 0,
    output: Output = Path("lab"),
    no_plots: NoPlots = False,
) -> Report:
    """Test a fabric as textile laboratories do: cantilever, drape and others; exit code 3 if a check fails."""
    from ..fabric_library import library_fabric
    from ..lab import TESTS, Setup
    from ..lab.plots import pyplot
    from ..lab.report import write_page

    validate.choice(test, [*TESTS, "report"], "test")
    setup = Setup(library_fabric(fabric), integrator, resolution, mesh, angle, seed)
    if not no_plots:
        pyplot()
    start_warp()
    folder = output_folder(output)
    names = list(TESTS) if test == "report" else [test]
    results, data = [], []
    for name in names:
        result, files = _run(name, setup, folder, not no_plots)
        results.append((result, files))
        data.append(result.as_dict(files))
    code = 0 if all(result.passed for result, _ in results) else SimulationError.exit_code
    if test != "report":
        return Report(data[0], _text(results[0][0]), code)
    page = write_page(results, folder)
    messages().print(f"Wrote {page}")
    return Report({"tests": data, "page": page}, Group(*(_text(result) for result, _ in results)), code)


def _run(name: str, setup: "Setup", folder: Path, pictures: bool) -> tuple["Result", list[Path]]:
    """One test, its JSON file and pictures."""
    from ..lab import TESTS
    from ..lab.plots import write_plot

    with _progress(name) as progress:
        result = TESTS[name].run(setup, progress)
    path = folder / f"{name}.json"
    path.write_text(to_json(result.as_dict()) + "\n", encoding="utf-8")
    files = [path, *(write_plot(result, folder) if pictures else [])]
    messages().print(f"Wrote {', '.join(str(file) for file in files)}")
    return result, files


def _text(result: "Result") -> Group:
    from ..lab.result import cell_text

    table = Table(box=None, pad_edge=False, title=f"{result.title}: {result.setup['fabric']}", title_justify="left")
    for column in result.columns:
        table.add_column(column, justify="right")
    for row in result.rows:
        table.add_row(*(cell_text(value) for value in row))
    return Group(table, *(_sentence(check) for check in result.checks))


def _sentence(check: Any) -> str:
    error = f"{check.error:+.3g}" if check.absolute else f"{100.0 * check.error:+.2f} %"
    verdict = "ok" if check.passed else "OUT OF TOLERANCE"
    return f"{check.what}: {check.value:.5g}, expected {check.expected:.5g} ({error}): {verdict}"


@contextmanager
def _progress(name: str) -> Iterator[Callable[[str], None]]:
    """A line on stderr that says what is being measured."""
    columns = (SpinnerColumn(), TextColumn(f"{name}: {{task.description}}"), TimeElapsedColumn())
    console = messages()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("preparing", total=None)
        yield lambda text: progress.update(task, description=text)
