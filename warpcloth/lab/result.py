"""What a laboratory test found: numbers, whether they are what they should be, and curves to draw."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

LINE, POINTS, AREA = "line", "points", "area"


@dataclass(frozen=True)
class Check:
    """A measured value beside the expected one; the tolerance is relative, or absolute where ``absolute``."""

    what: str
    value: float
    expected: float
    tolerance: float
    absolute: bool = False

    @property
    def error(self) -> float:
        """Relative error, or absolute where so asked."""
        difference = self.value - self.expected
        return difference if self.absolute else difference / abs(self.expected)

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance; never for what is not a number."""
        return abs(self.error) <= self.tolerance

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        names = ("what", "value", "expected", "tolerance", "absolute", "error", "passed")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, eq=False)
class Curve:
    """A line of a reference, points of a measurement, or what an outline encloses; ``style`` says which."""

    label: str
    x: Sequence[float] | np.ndarray
    y: Sequence[float] | np.ndarray
    style: str = LINE


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves over common axes; ``log`` has "x", "y", both or none; ``equal`` draws both axes to one scale."""

    xlabel: str
    ylabel: str
    curves: Sequence[Curve]
    log: str = ""
    equal: bool = False


@dataclass(frozen=True, eq=False)
class Result:
    """The outcome of a test.

    Args:
        test: its name. title: one line. method: a sentence on what was done and where the reference comes from.
        setup: what was tested, see :meth:`warpcloth.lab.setup.Setup.summary`.
        columns, rows: the table; numbers are shown with four digits.
        values: results by name, for JSON. checks: what can be judged.
        panels: what is drawn, side by side.
    """

    test: str
    title: str
    method: str
    setup: dict[str, Any]
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    values: dict[str, Any] = field(default_factory=dict)
    checks: Sequence[Check] = ()
    panels: Sequence[Panel] = ()

    @property
    def passed(self) -> bool:
        """Whether all checks passed."""
        return all(check.passed for check in self.checks)

    def as_dict(self, files: Sequence[Path] = ()) -> dict[str, Any]:
        """For JSON."""
        rows = [dict(zip(self.columns, row, strict=True)) for row in self.rows]
        return {
            "test": self.test, "title": self.title, "method": self.method, "setup": self.setup, "rows": rows,
            "values": self.values, "checks": [check.as_dict() for check in self.checks], "passed": self.passed,
            "files": list(files),
        }  # fmt: skip


def cell_text(value: Any) -> str:
    """A table cell."""
    return f"{value:.4g}" if isinstance(value, float | np.floating) else str(value)
