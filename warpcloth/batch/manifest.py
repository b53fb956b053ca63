"""The table of all samples, rebuilt from their folders whenever it is wanted."""

import csv
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .extra import needed
from .folder import BatchFolder, flush, write_whole

CSV, PARQUET = "manifest.csv", "manifest.parquet"


def rows(folder: BatchFolder) -> list[dict[str, Any]]:
    """One row for each complete sample: number, status, reason, folder, parameters, metrics, hashes of its files."""
    result = []
    for index in folder.finished():
        facts = folder.metrics(index)
        row = {"sample": index, "status": facts["status"], "reason": facts.get("reason")}
        row["folder"] = folder.place(index).relative_to(folder.path).as_posix()
        row |= {path: _cell(value) for path, value in facts["parameters"].items()}
        row |= {f"metrics.{name}": value for name, value in facts.get("metrics", {}).items()}
        row |= {f"sha256.{name}": value for name, value in facts["files"].items()}
        result.append(row)
    return result


def write_manifest(folder: BatchFolder) -> list[Path]:
    """Writes ``manifest.csv`` and ``manifest.parquet``; returns their paths."""
    table = rows(folder)
    columns = list(dict.fromkeys(name for row in table for name in row)) or ["sample", "status", "reason", "folder"]
    write_whole(folder.path / CSV, _as_csv(table, columns))
    _write_parquet(folder.path / PARQUET, table, columns)
    return [folder.path / CSV, folder.path / PARQUET]


def _as_csv(table: list[dict[str, Any]], columns: list[str]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()


def _write_parquet(path: Path, table: list[dict[str, Any]], columns: list[str]) -> None:
    pyarrow, parquet = needed("pyarrow"), needed("pyarrow.parquet")
    values = {name: _of_one_type([row.get(name) for row in table]) for name in columns}
    partial = path.with_name(f".{path.name}")
    parquet.write_table(pyarrow.table(values), partial)
    flush(partial)
    partial.replace(path)


def _of_one_type(column: list[Any]) -> list[Any]:
    """A column as it is, or as text where its values differ in kind."""
    kinds = {float if isinstance(value, int) and not isinstance(value, bool) else type(value) for value in column}
    return column if len(kinds - {type(None)}) <= 1 else [None if value is None else str(value) for value in column]


def _cell(value: Any) -> Any:
    """A parameter as one cell: a table by its name or as JSON."""
    if isinstance(value, Mapping) and isinstance(value.get("name"), str):
        return value["name"]
    return json.dumps(value, ensure_ascii=False) if isinstance(value, Mapping | list) else value
