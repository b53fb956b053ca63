"""All results on one Markdown page."""

from collections.abc import Sequence
from pathlib import Path

from .result import Check, Result, cell_text


def write_page(results: Sequence[Result], folder: Path) -> Path:
    """Writes ``report.md`` with the tables and the pictures that are in ``folder``; its path."""
    setup = results[0].setup
    mesh = f"{setup['mesh']} mesh" + (f" at {setup['angle']:g}°" if setup["angle"] else "")
    lines = [f"# Laboratory report: {setup['fabric']}", "", f"Integrator {setup['integrator']}, {mesh}.", ""]
    lines += ["| test | checks passed |", "|---|---|"]
    lines += [f"| [{r.title}](#{r.test}) | {sum(c.passed for c in r.checks)} of {len(r.checks)} |" for r in results]
    for result in results:
        lines += ["", *_section(result, folder)]
    path = folder / "report.md"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _section(result: Result, folder: Path) -> list[str]:
    lines = [f'<a id="{result.test}"></a>', f"## {result.title}", "", result.method, ""]
    lines += [f"| {' | '.join(result.columns)} |", f"|{'---|' * len(result.columns)}"]
    lines += [f"| {' | '.join(cell_text(value) for value in row)} |" for row in result.rows]
    if result.checks:
        lines += ["", "| check | value | expected | error | |", "|---|---|---|---|---|"]
        lines += [_check(check) for check in result.checks]
    pictures = sorted(folder.glob(f"{result.test}*.png"))
    for picture in pictures:
        lines += ["", f"![{result.title}]({picture.name})"]
    return lines


def _check(check: Check) -> str:
    error = f"{check.error:+.3g}" if check.absolute else f"{100.0 * check.error:+.2f} %"
    verdict = "ok" if check.passed else "**out of tolerance**"
    return f"| {check.what} | {check.value:.5g} | {check.expected:.5g} | {error} | {verdict} |"
