"""What writing USD costs beside simulating."""

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import warp as wp
from warpcloth.scenes.usd import CacheWriter

from .effort import Effort
from .scenes import DRAPE, DT, simulation, things


def output(effort: Effort, report: Callable[[str], None]) -> dict[str, Any]:
    """The drape, written frame by frame as ``warpcloth simulate`` does it.

    Returns:
        ``rows``: ``resolution``, ``frames``, ``step_ms`` and ``write_ms`` (mean over the frames of a run, closing the
        file included; medians over ``repeats`` runs), ``bytes_per_frame``, ``share`` (of the time of a run that writing
        takes).
    """
    frames = DRAPE.frames if effort.frames is None else effort.frames
    rows = []
    for n in effort.resolutions:
        runs = []
        for number in range(effort.repeats):
            report(f"output, {n}², run {number + 1}")
            runs.append(_run(n, frames))
        step, write = (statistics.median(values) for values in list(zip(*runs, strict=True))[:2])
        rows.append(
            {
                "resolution": n,
                "frames": frames,
                "repeats": effort.repeats,
                "step_ms": 1e3 * step / frames,
                "write_ms": 1e3 * write / frames,
                "bytes_per_frame": runs[0][2] / frames,
                "share": write / (write + step),
            }
        )
    return {"rows": rows}


def _run(n: int, frames: int) -> tuple[float, float, int]:
    """Seconds of stepping and of writing ``frames`` frames, and the size of the file."""
    sim = simulation(DRAPE, n, "xpbd")
    step, write = 0.0, 0.0
    for _ in range(2):  # loads kernels, and records a graph
        sim.step(DT)
    sim.reset()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drape.usdc"
        begun = time.perf_counter()
        cloth, obstacles = things(DRAPE, n)
        writer = CacheWriter(path, [cloth], obstacles, fps=1.0 / DT)
        with writer:
            write += time.perf_counter() - begun
            for frame in range(frames):
                begun = time.perf_counter()
                sim.step(DT)
                wp.synchronize_device(sim.model.device)
                stepped = time.perf_counter()
                points, velocities = sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()
                writer.write(frame, {cloth.name: points}, {cloth.name: velocities})
                step, write = step + stepped - begun, write + time.perf_counter() - stepped
            begun = time.perf_counter()
        return step, write + time.perf_counter() - begun, path.stat().st_size
