"""Measurements in a process of their own: one that nothing else has warmed up, filled or set differently."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from warpcloth.errors import SimulationError

PATIENCE = 3600.0  # [s]


def in_child(module: str, arguments: dict[str, Any]) -> Any:
    """Runs ``python -m`` of a module of this package whose last line is ``serve(function)``.

    Args:
        module: its name in this package. arguments: of the function, ready for JSON.

    Returns:
        What the function returned.

    Raises:
        SimulationError: the process failed; its last words are in the sentence.
    """
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.json"
        command = [sys.executable, "-m", f"{__package__}.{module}", json.dumps(arguments), str(answer)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
        if done.returncode != 0 or not answer.is_file():
            words = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
            raise SimulationError(f"The part of the benchmark in {module}.py failed: {words[-1]}")
        return json.loads(answer.read_text(encoding="utf-8"))


def serve(function: Callable[..., Any]) -> None:
    """Calls ``function`` with the arguments that :func:`in_child` gave, and hands back what it returns."""
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    result = function(**json.loads(sys.argv[1]))
    Path(sys.argv[2]).write_text(json.dumps(result), encoding="utf-8")
