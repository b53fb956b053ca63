"""How long it takes until cloth moves: import, first run ever, any later run."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from warpcloth.errors import SimulationError

from .effort import Effort

SCENE = "drape_sphere"
MAIN = "from warpcloth.cli import main; main()"


def startup(effort: Effort, report: Callable[[str], None]) -> dict[str, Any]:
    """Whole processes, from their start to their end.

    Returns:
        ``rows``: ``what``, ``seconds`` (median), ``repeats``. ``python`` is an interpreter that does
        nothing, ``import`` is ``import warpcloth``; ``cold`` is ``warpcloth simulate drape_sphere --set frames=1`` with
        an empty cache of kernels, once, ``warm`` the same again; ``prepare`` is what ``warm`` itself says of its time
        before the first step (``compile_s``).
    """
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        report("startup, python and import")
        for what, code in (("python", "pass"), ("import", "import warpcloth")):
            rows.append(_row(what, [_seconds([sys.executable, "-c", code], {})[0] for _ in range(effort.repeats)]))
        command = [sys.executable, "-c", MAIN, "simulate", SCENE, "--set", "frames=1", "--json"]
        command += ["-o", str(Path(folder) / "out.usdc")]
        cache = {"WARP_CACHE_PATH": str(Path(folder) / "cache")}
        report("startup, cold")
        rows.append(_row("cold", [_seconds(command, cache)[0]]))
        report("startup, warm")
        runs = [_seconds(command, cache) for _ in range(effort.repeats)]
        rows.append(_row("warm", [seconds for seconds, _ in runs]))
        rows.append(_row("prepare", [json.loads(text)["compile_s"] for _, text in runs]))
    return {"rows": rows}


def _row(what: str, seconds: list[float]) -> dict[str, Any]:
    return {"what": what, "seconds": statistics.median(seconds), "repeats": len(seconds)}


def _seconds(command: list[str], environment: dict[str, str]) -> tuple[float, str]:
    """How long a process takes [s], and what it prints."""
    begun = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **environment})
    spent = time.perf_counter() - begun
    if done.returncode != 0:
        words = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise SimulationError(f"The start of a simulation failed: {words[-1]}")
    return spent, done.stdout
