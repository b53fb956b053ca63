"""A run against an earlier one."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from warpcloth.errors import InputError

# Per part, what names a row of it, and which of its numbers cost something.
COSTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "hang": (("tool", "resolution", "frames"), ("frame_ms", "cpu_ms", "mean_ms")),
    "drape": (("tool", "resolution", "frames"), ("frame_ms", "cpu_ms", "mean_ms")),
    "throughput": (("hand", "resolution"), ("frame_ms",)),
    "scaling": (("problem", "resolution"), ("frame_ms", "bytes_per_particle")),
    "startup": (("what",), ("seconds",)),
    "output": (("resolution", "frames"), ("write_ms", "bytes_per_frame")),
    "profile": (("what", "resolution", "frames"), ("frame_ms",)),
}


def earlier_results(path: Path) -> dict[str, Any]:
    """The results of an earlier run.

    Raises:
        InputError: the file is not the result of an earlier run.
    """
    try:
        results = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"The earlier results {path} cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise InputError(f"The earlier results {path} are not JSON: {error}.") from error
    try:
        sound = results["benchmark"] == "speed" and all(isinstance(cost, int | float) for _, cost in _costs(results))
    except (KeyError, TypeError, AttributeError):
        sound = False
    if not sound:
        raise InputError(f"The file {path} is not the results.json of `bench speed`.")
    return dict(results)


def comparison(now: dict[str, Any], earlier: dict[str, Any]) -> list[dict[str, Any]]:
    """What both runs have: ``what``, ``earlier``, ``now`` and ``ratio``, the times by which it costs more now."""
    before = dict(_costs(earlier))
    return [
        {"what": what, "earlier": before[what], "now": cost, "ratio": cost / before[what]}
        for what, cost in _costs(now)
        if before.get(what)
    ]


def _costs(results: dict[str, Any]) -> Iterator[tuple[str, float]]:
    for part, (keys, values) in COSTS.items():
        for row in results["parts"].get(part, {}).get("rows", []):
            name = " ".join(str(row.get(key, "")) for key in keys)
            for value in values:
                if row.get(value) is not None:
                    yield f"{part} {name} {value}", row[value]
