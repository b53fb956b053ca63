"""Springs a second of the explicit step, in turns, in a process of its own (C++ made with ``-ffast-math`` changes
how the whole process rounds the smallest numbers)."""

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .child import in_child, serve
from .effort import Effort
from .explicit import Cpp, Numpy, Ours, Theirs, compiled
from .network import SUBSTEPS, warp_cloth

OURS, THEIRS, CPP, NUMPY = "warpcloth", "warp_benchmark", "cpp", "numpy"
ROUND_SECONDS = 0.25  # of each hand in each round, in whole frames


def throughput(effort: Effort, report: Callable[[str], None]) -> dict[str, Any]:
    """All hands on networks of n² particles.

    Returns:
        ``compiler``; ``rows``: ``hand``, ``resolution``, ``springs``, ``frame_ms`` (median over rounds of the mean over
        a round's frames), ``springs_per_s``, ``ratio`` (of springs a second, to those of Warp's own benchmark),
        ``ratio_cpp`` (to C++; None without a compiler), ``difference_m`` (after one frame, of any coordinate, from
        numpy in double precision), ``tolerance_m``; and ``failures``: hands that do not compute the same.
    """
    found: dict[str, Any] = {"rows": [], "failures": []}
    for n in effort.networks:
        report(f"throughput, {n}²")
        part = in_child("throughput", {"n": n, "rounds": max(3, effort.repeats)})
        found["compiler"] = part["compiler"]
        found["rows"] += part["rows"]
    for row in found["rows"]:
        if not row["difference_m"] <= row["tolerance_m"]:
            found["failures"].append(f"throughput, {row['hand']}, {row['resolution']}²: computes something else")
    return found


def measure(n: int, rounds: int) -> dict[str, Any]:
    """Rows for n² particles, in this process."""
    cloth = warp_cloth(n)
    with tempfile.TemporaryDirectory() as folder:
        library, compiler = compiled(Path(folder))
        hands: dict[str, Any] = {OURS: Ours(cloth), THEIRS: Theirs(cloth), NUMPY: Numpy(cloth)}
        if library is not None:
            hands[CPP] = Cpp(cloth, library)
        differences, tolerance = _differences(cloth, hands)
        seconds = _race(hands, rounds)
    springs = len(cloth.spring_lengths)
    rows = [
        {
            "hand": name,
            "resolution": n,
            "springs": springs,
            "frame_ms": 1e3 * seconds[name],
            "springs_per_s": springs * SUBSTEPS / seconds[name],
            "ratio": seconds[THEIRS] / seconds[name],
            "ratio_cpp": seconds[CPP] / seconds[name] if CPP in seconds else None,
            "difference_m": differences[name],
            "tolerance_m": tolerance,
        }
        for name in hands
    ]
    return {"compiler": compiler, "rows": rows}


def _differences(cloth: Any, hands: dict[str, Any]) -> tuple[dict[str, float], float]:
    """After the first frame, and what rounding explains: one unit in the last place a substep, doubled."""
    truth = Numpy(cloth, np.float64).frame()
    found = {name: float(np.abs(hand.frame() - truth).max()) for name, hand in hands.items()}
    return found, 2.0 * SUBSTEPS * float(np.spacing(np.float32(np.abs(truth).max())))


def _race(hands: dict[str, Any], rounds: int) -> dict[str, float]:
    """Median over rounds of the time of a frame [s]; a second frame, recorded if need be, comes first."""
    frames, times = {}, {name: [] for name in hands}
    for name, hand in hands.items():
        hand.frame()
        begun = time.perf_counter()
        hand.frame()
        frames[name] = max(1, round(ROUND_SECONDS / (time.perf_counter() - begun)))
    for _ in range(rounds):
        for name, hand in hands.items():
            begun = time.perf_counter()
            for _ in range(frames[name]):
                hand.frame()
            times[name].append((time.perf_counter() - begun) / frames[name])
    return {name: statistics.median(values) for name, values in times.items()}


if __name__ == "__main__":
    serve(measure)
