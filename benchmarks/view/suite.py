"""The measurements: a session with its page, a client beside it."""

import json
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from warpcloth.scenes import Scene

from warpcloth.errors import SimulationError
from warpcloth.view.page import Page
from warpcloth.view.session import Session

from ..machine import describe_machine

FPS = 60.0
WARM_UP = 0.5  # of the time that is counted: frames in as many parts as they need have been captured by then
PORT = 8970  # or the next one that is free
TARGET = 15.0  # updates per second
PATIENCE = 120.0  # [s]
ORDERS: dict[str, tuple[Any, ...]] = {  # by control; the first needs no rebuilding, the others do
    "gravity": tuple((0.0, 0.0, z) for z in (-9.0, -8.0, -9.0, -8.0, -9.81)),
    "stiffness": (1.2, 1.0, 1.2, 1.0),
    "substeps": (100, 90, 0),
}


class _Watched:
    """A client in a process of its own, and what it has told so far: times [s] of updates and orders, and sizes."""

    def __init__(self, address: str):
        command = [sys.executable, "-m", "warpcloth.benchmarks.view.client", address]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.updates: list[float] = []
        self.sent: list[float] = []
        self.sizes: list[int] = []
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            what, when, size = json.loads(line)
            (self.updates if what == "update" else self.sent).append(when)
            if what == "update":
                self.sizes.append(size)

    def order(self, label: str, value: Any) -> None:
        """Sets a control."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{label} {json.dumps(value)}\n")
        self._process.stdin.flush()

    def close(self) -> None:
        """Ends it."""
        self._process.communicate(timeout=PATIENCE)


def run_view(scene: Scene, seconds: float, report: Callable[[str], None] = lambda text: None) -> dict[str, Any]:
    """Measures a scene's page.

    Args:
        scene: what is simulated, at 60 frames per second.
        seconds: how long updates are counted.
        report: told before each measurement.

    Returns:
        Updates per second that a client received (median over whole seconds), gaps between them, the pace of the
        simulation, and the latency of changes: from sending one to the first update of cloth that it has acted on.

    Raises:
        SimulationError: the simulation failed, or the client got nothing in two minutes.
    """
    report("preparing")
    session = Session(scene, FPS)
    page = Page(session, port=PORT)
    client = _Watched(page.url.replace("http", "ws"))
    try:
        session.play()
        _until(lambda: len(client.updates) > 20, session)
        time.sleep(WARM_UP * seconds)
        report("updates")
        begun = time.monotonic()
        time.sleep(seconds)
        found = _rates(client, begun, seconds) | _solver(session)
        report("latency")
        found["latency_s"] = {name: _latency(session, client, name, values) for name, values in ORDERS.items()}
    finally:
        client.close()
        page.close()
        session.close()
    particles = sum(len(points) for points in session.snapshot.points.values())
    head = {"scene": scene.name, "particles": particles, "client": "websocket client, a process of its own"}
    return {"machine": describe_machine(), **head, "seconds": seconds, "target": TARGET, **found}


def _rates(client: _Watched, begun: float, seconds: float) -> dict[str, Any]:
    times = np.array([t for t in client.updates if begun <= t < begun + seconds]) - begun
    per_second = np.bincount(times.astype(int), minlength=max(1, int(seconds)))[: max(1, int(seconds))]
    gaps = np.diff(times) if len(times) > 1 else np.array([np.inf])
    return {
        "updates_per_second": float(np.median(per_second)),
        "slowest_second": int(per_second.min()),
        "gap_ms": {
            "median": 1e3 * float(np.median(gaps)),
            "p95": 1e3 * float(np.percentile(gaps, 95)),
            "longest": 1e3 * float(gaps.max()),
        },
        "bytes_per_update": int(statistics.median(client.sizes[-len(times) :])) if len(times) else 0,
    }


def _solver(session: Session) -> dict[str, Any]:
    now = session.snapshot
    return {"real_time_factor": now.pace, "substeps": now.substeps, "parts_per_frame": now.slices}


def _latency(session: Session, client: _Watched, name: str, values: tuple[Any, ...]) -> dict[str, float]:
    """From an order until the first update [s] after it is in force."""
    found = []
    for value in values:
        number, before = len(client.sent), session.stage.settings
        client.order(name, value)
        _until(lambda: session.snapshot.settings is not before, session)  # noqa: B023
        in_force = time.monotonic()
        _until(lambda: client.updates[-1] > in_force, session)  # noqa: B023
        found.append(next(t for t in client.updates if t > in_force) - client.sent[number])
        time.sleep(0.5)
    return {"median": statistics.median(found), "longest": max(found)}


def _until(condition: Callable[[], bool], session: Session) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        if session.snapshot.status == "failed" or time.monotonic() > end:
            raise SimulationError(f"The page came to nothing: {session.snapshot.error or 'no updates arrived.'}")
        time.sleep(0.002)
