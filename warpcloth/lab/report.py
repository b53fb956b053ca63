"""All results on one Markdown page."""

from collections.abc import Sequence
from pathlib import Path

from .result import Check, Result, cell_text


def write_page(results: Sequence[tuple[Result, Sequence[Path]]], folder: Path) -> Path:
    """Writes ``report.md`` with the tables of all results, and the pictures among the files of each; its path."""
    setup = results[0][0].setup
    mesh = f"{setup['mesh']} mesh" + (f" at {setup['angle']:g}°" if setup["angle"] else "")
    lines = [f"# Laboratory report: {setup['fabric']}", "", f"Integrator {setup['integrator']}, {mesh}.", ""]
    lines += ["| test | checks passed |", "|---|---|"]
    lines += [f"| [{r.title}](#{r.test}) | {_passed(r)} |" for r, _ in results]
    for result, files in results:
        lines += ["", *_section(result, files)]
    path = folder / "report.md"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _passed(result: Result) -> str:
    """How many checks, in bold where some did not."""
    count = f"{sum(check.passed for check in result.checks)} of {len(result.checks)}"
    return count if result.passed else f"**{count}**"


def _section(result: Result, files: Sequence[Path]) -> list[str]:
    lines = [f'<a id="{result.test}"></a>', f"## {result.title}", "", result.method, ""]
    lines += [f"| {' | '.join(result.columns)} |", f"|{'---|' * len(result.columns)}"]
    lines += [f"| {' | '.join(cell_text(value) for value in row)} |" for row in result.rows]
    if result.checks:
        lines += ["", "| check | value | expected | error | |", "|---|---|---|---|---|"]
        lines += [_check(check) for check in result.checks]
    for picture in files:
        if picture.suffix == ".png":
            lines += ["", f"![{result.title}]({picture.name})"]
    return lines


def _check(check: Check) -> str:
    error = f"{check.error:+.3g}" if check.absolute else f"{100.0 * check.error:+.2f} %"
    verdict = "ok" if check.passed else "**out of tolerance**"
    return f"| {check.what} | {check.value:.5g} | {check.expected:.5g} | {error} | {verdict} |"
