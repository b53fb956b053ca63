"""Time and memory against the number of particles, each size in a process of its own."""

import gc
import mmap
import statistics
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warpcloth.errors import StabilityWarning

from .child import in_child, serve
from .effort import Effort
from .scenes import DT, PROBLEMS, simulation

EXPLICIT_SUBSTEPS = 16
START_FRAMES = 3  # before those that count
FRAMES = 7  # of the drape: all, as they differ
SMALL = 8  # vertices along an edge of what loads the kernels, so that their memory is not counted


def scaling(effort: Effort, report: Callable[[str], None]) -> dict[str, Any]:
    """Cost of the explicit step, of hanging and of draping with XPBD, for 16² to 512² particles, on one thread.

    Returns:
        ``rows``: ``problem``, ``resolution``, ``particles``, ``substeps``, ``frame_ms`` and ``cpu_ms`` (medians of
        wall and processor time; of the drape, means over all of it), ``particle_step_ns`` (of a particle in a substep,
        in processor time if the device is the CPU, which other processes may use, too), ``bytes_per_particle`` (by
        which resident memory is more than before, with all that contact needs) and ``peak_bytes_per_particle`` (by
        which its peak, while the model was built, rose; None where the system does not say); ``exponents``: by problem,
        of that time of a frame (``frame``) and of a step (``step``) in the number of particles, least squares of
        logarithms.
    """
    rows = []
    for problem, sizes in effort.sizes.items():
        for n in sizes:
            report(f"scaling, {problem}, {n}²")
            frames = PROBLEMS["drape"].frames if problem == "drape" else max(FRAMES, effort.repeats)
            rows.append(in_child("scaling", {"problem": problem, "n": n, "frames": frames}))
    failures = [f"scaling, {r['problem']}, {r['resolution']}²: not finite" for r in rows if not r["finite"]]
    return {"rows": rows, "exponents": _exponents(rows), "failures": failures}


def _exponents(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = {}
    for problem in dict.fromkeys(row["problem"] for row in rows):
        own = [row for row in rows if row["problem"] == problem]
        if len(own) > 1:
            particles, substeps, one = np.log([[r["particles"], r["substeps"], r["particle_step_ns"]] for r in own]).T
            step = float(np.polyfit(particles, one, 1)[0]) + 1.0
            found[problem] = {"frame": step + float(np.polyfit(particles, substeps, 1)[0]), "step": step}
    return found


def measure(problem: str, n: int, frames: int) -> dict[str, Any]:
    """A row, in this process; in one that has done other things its memory means nothing."""
    warnings.simplefilter("ignore", StabilityWarning)  # the explicit step is timed for a few frames, not used
    _run(problem, SMALL, 2)
    before, empty = _peak_memory(), _memory()
    sim, times = _run(problem, n, frames)
    gc.collect()
    after, full, count = _peak_memory(), _memory(), n * n
    average = statistics.fmean if problem == "drape" else statistics.median
    wall, cpu = (average(values) for values in zip(*times, strict=True))
    cost = (sim.model.device.is_cpu and cpu) or wall
    return {
        "problem": problem,
        "resolution": n,
        "particles": count,
        "substeps": sim.substeps,
        "frame_ms": 1e3 * wall,
        "cpu_ms": 1e3 * cpu,
        "particle_step_ns": 1e9 * cost / (count * sim.substeps),
        "bytes_per_particle": None if empty is None or full is None else (full - empty) / count,
        "peak_bytes_per_particle": None if after is None or before is None else (after - before) / count,
        "finite": bool(np.isfinite(sim.state.particle_q.numpy()).all()),
    }


def _run(problem: str, n: int, frames: int) -> tuple[Any, list[tuple[float, float]]]:
    """A simulation, and wall and processor times of its last ``frames`` frames [s].

    Substeps are automatic, and the same rule chooses them for all sizes.
    """
    if problem == "explicit":
        # So short a frame that networks of all sizes are stable: what it costs does not depend on its length.
        sim, dt = simulation(PROBLEMS["hang"], n, "symplectic_euler", substeps=EXPLICIT_SUBSTEPS, threads=1), 1e-6
    else:
        sim, dt = simulation(PROBLEMS[problem], n, "xpbd", substeps="auto", threads=1), DT
    times = []
    for number in range(START_FRAMES + frames):
        begun = time.perf_counter(), time.process_time()
        sim.step(dt)
        wp.synchronize_device(sim.model.device)
        if number >= START_FRAMES:
            times.append((time.perf_counter() - begun[0], time.process_time() - begun[1]))
    return sim, times


def _memory() -> int | None:
    """Resident memory of this process [bytes]."""
    pages = Path("/proc/self/statm")
    return int(pages.read_text().split()[1]) * mmap.PAGESIZE if pages.is_file() else None


def _peak_memory() -> int | None:
    """The most memory that this process has had in use [bytes]."""
    if sys.platform == "win32":
        return None
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


if __name__ == "__main__":
    serve(measure)
