"""Where the time of a drape's frame goes: by stage, and by kernel."""

import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

import warp as wp

from .effort import Effort
from .scenes import DRAPE, DT, simulation

MOST_KERNELS = 15


def profile(effort: Effort, report: Callable[[str], None]) -> dict[str, Any]:
    """Three runs of the drape: as it is, with its stages timed, with its launches timed.

    Returns:
        ``rows``: ``what`` (``frame`` is a whole frame from its graph; the stages, and ``rest``, are those of a frame
        without a graph, which takes longer), ``frame_ms`` (mean over all frames); ``kernels``: the most expensive
        ones, with ``frame_ms``, ``calls`` in a frame and ``call_us``, each less ``launch_us``, the shortest launch of
        all, which a recorded frame does not have.
    """
    n = effort.resolutions[0]
    frames = DRAPE.frames if effort.frames is None else effort.frames
    report(f"profile, {n}², as it is")
    plain, _ = _mean_frame(n, frames)
    report(f"profile, {n}², stages")
    slow, seconds = _mean_frame(n, frames, profile=True)
    stages = {name: spent / frames for name, spent in seconds.items()}
    stages["rest"] = slow - sum(stages.values())
    where = {"resolution": n, "frames": frames}
    rows = [{"what": name, **where, "frame_ms": 1e3 * value} for name, value in {"frame": plain, **stages}.items()]
    report(f"profile, {n}², kernels")
    return {**where, "rows": rows, **_kernels(n, frames)}


def _mean_frame(n: int, frames: int, **options: Any) -> tuple[float, dict[str, float]]:
    """Mean time of a frame [s], and the seconds of each stage over all of them."""
    sim = simulation(DRAPE, n, "xpbd", **options)
    for _ in range(2):  # loads kernels, and records a graph
        sim.step(DT)
    sim.reset()
    sim.watch.seconds.clear()
    begun = time.perf_counter()
    for _ in range(frames):
        sim.step(DT)
    wp.synchronize_device(sim.model.device)
    return (time.perf_counter() - begun) / frames, dict(sim.watch.seconds)


def _kernels(n: int, frames: int) -> dict[str, Any]:
    sim = simulation(DRAPE, n, "xpbd", graph=False)
    sim.step(DT)
    sim.reset()
    with timed_launches() as seconds:
        for _ in range(frames):
            sim.step(DT)
    shortest = min(min(times) for times in seconds.values())
    rows: list[dict[str, Any]] = [
        {
            "kernel": name,
            "frame_ms": 1e3 * (sum(times) - len(times) * shortest) / frames,
            "calls": len(times) / frames,
            "call_us": 1e6 * (statistics.fmean(times) - shortest),
        }
        for name, times in seconds.items()
    ]
    rows.sort(key=lambda row: row["frame_ms"], reverse=True)
    return {"kernels": rows[:MOST_KERNELS], "launch_us": 1e6 * shortest}


@contextmanager
def timed_launches() -> Iterator[dict[str, list[float]]]:
    """Times [s] of all launches, copies and refits of trees inside, by name of kernel."""
    seconds: dict[str, list[float]] = defaultdict(list)

    def timed(call: Callable[..., Any], name: Callable[..., str]) -> Callable[..., Any]:
        def instead(*arguments: Any, **options: Any) -> Any:
            begun = time.perf_counter()
            result = call(*arguments, **options)
            wp.synchronize()
            seconds[name(*arguments, **options)].append(time.perf_counter() - begun)
            return result

        return instead

    with ExitStack() as stack:
        launch = timed(wp.launch, lambda *arguments, **options: (options.get("kernel") or arguments[0]).key)
        stack.enter_context(patch.object(wp, "launch", launch))
        stack.enter_context(patch.object(wp, "copy", timed(wp.copy, lambda *_, **__: "copy")))
        stack.enter_context(patch.object(wp.Bvh, "refit", timed(wp.Bvh.refit, lambda *_, **__: "refit")))
        yield seconds
