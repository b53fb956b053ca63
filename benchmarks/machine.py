"""What a benchmark ran on."""

import os
import platform
from importlib.metadata import version
from pathlib import Path

import warp as wp


def describe_machine() -> dict[str, str | int | float]:
    """Processor, cores, load, operating system, and the versions of what matters."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "load_per_core": _load(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "warp": wp.config.version,
        "numpy": version("numpy"),
        "warpcloth": version("warpcloth"),
        "device": str(wp.get_device()),
    }


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.is_file():
        for line in information.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _load() -> float:
    """Average of the last minute; above 1 timings mean little."""
    return round(os.getloadavg()[0] / (os.cpu_count() or 1), 2) if hasattr(os, "getloadavg") else 0.0
