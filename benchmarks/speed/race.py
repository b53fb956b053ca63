"""The two scenes, tool beside tool: one run that is looked at frame by frame, and then runs that are timed."""

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from warpcloth.errors import SimulationError, WarpclothError
from warpcloth.intersections import count_intersections

from .effort import PEERS, Effort
from .scenes import DRAPE, HANG, Problem, edges, mean_strain, misses, penetration, swing
from .tools import Run, maker, usual

PEER_PATIENCE = 120.0  # [s] for all runs of a peer
TORN = 1.0  # mean strain beyond which there is no cloth left to look at
WARM_FRAMES = 2  # the first loads kernels, the second may record a graph


class Lane:
    """One tool on one problem at one resolution.

    Attributes:
        row: what is known of it so far: its settings, ``frame_ms`` and ``cpu_ms`` (median over ``repeats`` runs of the
            median over frames; where that is 0, of the run that was looked at), ``mean_ms`` (the same of the mean over
            frames: what a whole shot costs), ``compile_s`` (to the end of the second
            frame), ``mean_strain`` of the last frame, ``worst_strain`` of any frame, ``intersections`` (of the drape:
            the most in any frame, of the hang: in the last one), ``penetration_m``, ``swing_m``, ``finite``, ``misses``
            (see :func:`~warpcloth.benchmarks.speed.scenes.misses`; None unless all frames ran); or ``failed``: a
            sentence.
    """

    def __init__(self, problem: Problem, name: str, n: int, frames: int | None):
        self.problem, self.name = problem, name
        self.frames = problem.frames if frames is None else frames
        self.row: dict[str, Any] = {"tool": name, "resolution": n, "frames": self.frames, "repeats": 0}
        self._medians: list[tuple[float, float, float]] = []
        self._spent = 0.0

    def look(self) -> None:
        """The run that is looked at."""
        self._guarded(self._watched)

    def time(self) -> None:
        """A run that is timed, unless the tool failed or has had its time."""
        if "failed" in self.row or (self.name in PEERS and self._spent > PEER_PATIENCE):
            return
        self._guarded(self._timed)

    def _guarded(self, action: Callable[[], None]) -> None:
        begun = time.perf_counter()
        try:
            action()
        except WarpclothError as error:
            self.row["failed"] = str(error)
        except Exception as error:
            if self.name not in PEERS:
                raise
            # Whatever goes wrong in a tool that is not ours is a result of the comparison, not the end of it.
            self.row["failed"] = f"{type(error).__name__}: {error}"
        self._spent += time.perf_counter() - begun

    def _watched(self) -> None:
        begun, times = time.perf_counter(), []
        run, pairs = maker(self.name)(self.problem, self.row["resolution"]), edges(self.row["resolution"])
        strains, crossings, depths = [], [], []
        for number in range(self.frames):
            times.append(_frame(run))
            if number == WARM_FRAMES - 1:
                self.row["compile_s"] = time.perf_counter() - begun
            points = run.points()
            strains.append(mean_strain(points, pairs))
            if not strains[-1] < TORN:
                raise SimulationError(f"The cloth is torn to a mean strain of {strains[-1]:.3g} in frame {number + 1}.")
            depths.append(penetration(points))
            if self.problem is DRAPE or number == self.frames - 1:
                crossings.append(count_intersections(points, run.triangles)[0])
        own = {"swing_m": swing(points)} if self.problem is HANG else {"penetration_m": max(depths)}
        self.row |= {"finite": bool(np.isfinite(points).all()), "intersections": max(crossings), **run.facts, **own}
        self.row |= {"mean_strain": strains[-1], "worst_strain": float(np.max(strains))}
        self.row["misses"] = misses(self.problem, self.row) if self.frames == self.problem.frames else None
        self._note(*_middle(times))

    def _timed(self) -> None:
        run = maker(self.name)(self.problem, self.row["resolution"])
        self._medians.append(_middle([_frame(run) for _ in range(self.frames)]))
        self.row["repeats"] = len(self._medians)
        self._note(*map(statistics.median, zip(*self._medians, strict=True)))

    def _note(self, wall: float, cpu: float, mean: float) -> None:
        self.row |= {"frame_ms": 1e3 * wall, "cpu_ms": 1e3 * cpu, "mean_ms": 1e3 * mean}


def _frame(run: Run) -> tuple[float, float]:
    """Wall and processor time of a frame [s]."""
    begun = time.perf_counter(), run.processor_time()
    run.frame()
    return time.perf_counter() - begun[0], run.processor_time() - begun[1]


def _middle(times: list[tuple[float, float]]) -> tuple[float, float, float]:
    """Median wall time, median processor time and mean wall time of frames that are warm [s]."""
    wall, cpu = zip(*(times[WARM_FRAMES:] or times), strict=True)
    return statistics.median(wall), statistics.median(cpu), statistics.fmean(wall)


def race(problem: Problem, effort: Effort, report: Callable[[str], None]) -> dict[str, Any]:
    """All tools at all resolutions; repeats of those of one resolution take turns.

    Args:
        problem: what they simulate. effort: which of them, and how often. report: told before each run.

    Returns:
        ``rows`` (of :class:`Lane`), ``bars``, and ``failures``: sentences about our own rows that are not sound.
    """
    rows: list[dict[str, Any]] = []
    names = usual(problem) if effort.rows is None else effort.rows
    for n in effort.resolutions:
        lanes = [Lane(problem, name, n, effort.frames) for name in names]
        for lane in lanes:
            report(f"{problem.name}, {lane.name}, {n}²")
            lane.look()
        for number in range(effort.repeats):
            report(f"{problem.name}, {n}², repeat {number + 1}")
            for lane in lanes:
                lane.time()
        rows += [lane.row for lane in lanes]
    return {
        "rows": rows,
        "bars": problem.bars,
        "failures": [f for row in rows if row["tool"] not in PEERS for f in _faults(problem, row)],
    }


def _faults(problem: Problem, row: dict[str, Any]) -> list[str]:
    where = f"{problem.name}, {row['tool']}, {row['resolution']}²"
    if "failed" in row:
        return [f"{where}: {row['failed']}"]
    faults = [] if row["finite"] else [f"{where}: positions are not finite"]
    if problem is DRAPE and row["intersections"]:
        faults.append(f"{where}: {row['intersections']} pairs of triangles intersect")
    return faults


def races(problem: Problem, effort: Effort) -> int:
    """How often :func:`race` reports."""
    names = usual(problem) if effort.rows is None else effort.rows
    return len(effort.resolutions) * (len(names) + effort.repeats)
