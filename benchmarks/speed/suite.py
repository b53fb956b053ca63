"""All parts, one after the other, as one dictionary ready for JSON."""

import time
from collections.abc import Callable
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

from warpcloth.errors import SimulationError

from ..machine import describe_machine
from .effort import Effort
from .output import output
from .profile import profile
from .race import race, races
from .scaling import scaling
from .scenes import DRAPE, HANG
from .startup import startup
from .throughput import throughput

Report = Callable[[str], None]
MEASURES: dict[str, Callable[[Effort, Report], dict[str, Any]]] = {
    "hang": lambda effort, report: race(HANG, effort, report),
    "drape": lambda effort, report: race(DRAPE, effort, report),
    "throughput": throughput,
    "output": output,
    "profile": profile,
    "scaling": scaling,
    "startup": startup,
}


def measurements(effort: Effort) -> int:
    """How often :func:`run_parts` reports."""
    runs = len(effort.resolutions) * effort.repeats
    counts = {
        "hang": races(HANG, effort),
        "drape": races(DRAPE, effort),
        "throughput": len(effort.networks),
        "output": runs,
        "profile": 3,
        "scaling": sum(map(len, effort.sizes.values())),
        "startup": 3,
    }
    return sum(counts[part] for part in effort.parts)


def run_parts(effort: Effort, report: Report = lambda text: None) -> dict[str, Any]:
    """Measures the parts; ``report`` hears before each measurement.

    Returns:
        ``benchmark``, ``date``, ``machine``, ``effort``, ``parts`` (with the ``rows`` and the ``seconds`` of each), and
        ``failures``: sentences on what is not sound.
    """
    parts: dict[str, Any] = {}
    machine, date = describe_machine(), datetime.now(UTC).isoformat(timespec="seconds")
    for name in effort.parts:
        begun = time.perf_counter()
        try:
            parts[name] = MEASURES[name](effort, report)
        except SimulationError as error:
            parts[name] = {"rows": [], "failures": [f"{name}: {error}"]}  # the other parts are worth having
        parts[name]["seconds"] = time.perf_counter() - begun
    return {
        "benchmark": "speed",
        "date": date,
        "machine": machine,
        "effort": asdict(effort),
        "parts": parts,
        "failures": [failure for part in parts.values() for failure in part.get("failures", [])],
    }
