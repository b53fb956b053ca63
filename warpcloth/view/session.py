"""A simulation in its own thread, which takes orders and shows snapshots; it outlives whatever goes wrong in it."""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, WarpclothError
from ..scenes import CacheWriter, Scene
from ..scenes.built import by_cloth
from .pace import Pace
from .settings import Settings
from .snapshot import Snapshot
from .stage import Stage

HISTORY = 300  # of energies
IDLE = 0.02  # [s] between looks for orders while nothing moves
ENERGY_EVERY = 3  # frames


class Session:
    """Orders may be given from any thread; each is carried out between two frames, or parts of one.

    A frame that takes long is simulated in two, four or eight parts, so that the cloth is seen to move, and is pulled,
    at a good rate even where the simulation is slower than the time it simulates.

    Args:
        scene: what to simulate. fps: frames per simulated second.

    Attributes:
        snapshot: what there is to see. changes: how many changes of settings have been ordered.

    Raises:
        WarpclothError: the scene cannot be simulated at all.
    """

    def __init__(self, scene: Scene, fps: float = 30.0):
        scene = scene.changed({"fps": fps})
        options = scene.simulation
        substeps = 0 if options.substeps == "auto" else int(options.substeps)
        self.stage = Stage(scene, Settings(options.integrator, substeps, options.gravity, scene.air.wind))
        self.first = self.stage.settings
        self._orders: queue.Queue[Callable[[], None] | None] = queue.Queue()
        self._status, self._error, self._message = "paused", "", ""
        self._number, self._frames, self._substeps = 0, 0, 0
        self._pace = Pace()
        self._wanted: dict[str, Any] = {}
        self.changes, self._taken = 0, 0
        self._wanted_lock = threading.Lock()
        self._plotted: dict[str, np.ndarray] = {}
        self._energies: deque[dict[str, float]] = deque(maxlen=HISTORY)
        self._writer: CacheWriter | None = None
        self._recorded, self._path = 0, Path()
        self.snapshot = Snapshot()
        self._show()
        self._thread = threading.Thread(target=self._work, name="warpcloth session", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends the thread, and a recording."""
        self._orders.put(None)
        self._thread.join()

    def play(self) -> None:
        """Lets time run."""
        self._order(lambda: self._set_status("playing"))

    def pause(self) -> None:
        """Stops time."""
        self._order(lambda: self._set_status("paused"))

    def toggle(self) -> None:
        """Play, or pause."""
        self._order(lambda: self._set_status("paused" if self._status == "playing" else "playing"))

    def single_step(self) -> None:
        """Pauses, one frame later."""
        self.pause()
        self._order(self._frame)

    def reset(self) -> None:
        """Back to the start and to the scene's own settings, whatever has happened."""
        self._order(self._reset)

    def change(self, **values: Any) -> None:
        """Changes :class:`Settings`; the cloth goes on from where it is."""
        with self._wanted_lock:
            ordered, self._wanted = bool(self._wanted), self._wanted | values
            self.changes += 1
        if not ordered:  # else the order that is under way takes these along: a slider gives many
            self._order(self._change)

    def grab(self, who: Hashable, ray: tuple[Any, Any]) -> None:
        """Somebody takes the cloth where a ray (origin, direction) meets it."""
        self._order(lambda: self._grab(who, ray))

    def move(self, who: Hashable, target: Any) -> None:
        """... leads it to ``target`` [m] ..."""
        self._order(lambda: self.stage.hands[who].move(target) if who in self.stage.hands else None)

    def release(self, who: Hashable) -> None:
        """... and lets go, whether or not there was anything to let go of."""
        self._order(lambda: self._release(who))

    def toggle_pin(self, ray: tuple[Any, Any]) -> None:
        """Pins the vertex nearest to where a ray meets cloth, or lets it go."""
        self._order(lambda: self._toggle_pin(ray))

    def lead(self, name: str, displacement: Any, rotation: Any = (0.0, 0.0, 0.0)) -> None:
        """Leads an obstacle: displacement [m] and rotation vector [rad] relative to where the scene has it."""
        self._order(lambda: self._lead(name, np.concatenate([displacement, rotation]).astype(float)))

    def record(self, path: Path) -> None:
        """Begins to write frames to a USD cache."""
        self._order(lambda: self._record(path))

    def stop_recording(self) -> None:
        """Completes the cache."""
        self._order(self._stop_recording)

    def wait(self, timeout: float = 60.0) -> None:
        """Returns when all orders given so far have been carried out.

        Raises:
            TimeoutError: they have not been, in time.
        """
        done = threading.Event()
        self._order(done.set)
        if not done.wait(timeout):
            raise TimeoutError("the session is busy")

    def _order(self, act: Callable[[], Any]) -> None:
        self._orders.put(act)

    def _work(self) -> None:
        due = time.perf_counter()
        while True:
            playing = self._status == "playing"
            wait = max(0.0, due - time.perf_counter()) if playing else IDLE
            try:
                act = self._orders.get(timeout=wait) if wait > 0.0 else self._orders.get_nowait()
            except queue.Empty:
                if playing:
                    begun, parts = time.perf_counter(), self._pace.slices
                    self._guarded(self._part)
                    due = max(due + 1.0 / (self.stage.fps * parts), begun)  # when behind, no frames are saved up
                continue
            if act is None:
                self._guarded(self._stop_recording)
                return
            self._guarded(act)
            if not playing or self._status != "playing":
                due = time.perf_counter()
                self._guarded(self._show)

    def _guarded(self, act: Callable[[], Any]) -> None:
        """Whatever goes wrong is told; the thread goes on."""
        try:
            act()
        except WarpclothError as error:
            self._fail(str(error))
        except Exception as error:
            self._fail(f"warpcloth has a defect ({type(error).__name__}: {error}).")

    def _fail(self, error: str) -> None:
        self._error = error
        if self._broken():
            self._status = "failed"
        self._show()

    def _broken(self) -> bool:
        return not np.isfinite(self.stage.simulation.state.particle_q.numpy()).all()

    def _set_status(self, status: str) -> None:
        if self._status != "failed":
            self._status, self._error = status, ""
            self._pace.interrupt()

    def _frame(self) -> None:
        """All that is left of a frame."""
        self._part()
        while self._pace.slice and self._status != "failed":
            self._part()

    def _part(self) -> None:
        """A slice of a frame; the last one completes it."""
        if self._status == "failed":
            return
        begun, simulation = time.perf_counter(), self.stage.simulation
        self.stage.step(self._pace.slices)
        self._substeps = self._pace.slices * simulation.substeps
        if self._pace.done(begun, time.perf_counter(), simulation.time):
            self._complete()
        self._show()

    def _complete(self) -> None:
        self._frames += 1
        if self._frames % ENERGY_EVERY == 0:
            self._energies.append({"time": self.stage.simulation.time, **self.stage.simulation.energy()})
            names = list(self._energies[-1])
            self._plotted = {name: np.array([row.get(name, 0.0) for row in self._energies]) for name in names}
        if self._writer is not None:
            self._write()

    def _reset(self) -> None:
        self._stop_recording()
        stage = self.stage
        stage.settings, stage.pinned, stage.unpinned = self.first, {}, {}
        stage.build(keep=False)
        self._status, self._error, self._message = "paused", "", "back to the start"
        self._energies.clear()
        self._plotted, self._pace.slice = {}, 0
        self._pace.restart()

    def _change(self) -> None:
        with self._wanted_lock:
            values, self._wanted = self._wanted, {}
            self._taken = self.changes
        before = self.stage.settings
        wanted = before.changed(**values)
        if wanted == before:
            return
        if self._status == "failed":
            raise InputError("Reset before changing anything.")
        self.stage.change(wanted)
        self._error = ""
        self._pace.restart()

    def _grab(self, who: Hashable, ray: tuple[Any, Any]) -> None:
        self._release(who)
        self.stage.hands[who] = self.stage.simulation.grab(ray)

    def _release(self, who: Hashable) -> None:
        grab = self.stage.hands.pop(who, None)
        if grab is not None:
            grab.release()

    def _toggle_pin(self, ray: tuple[Any, Any]) -> None:
        grab = self.stage.simulation.grab(ray)
        grab.release()
        particle = int(grab.hold.particles[int(np.argmax(grab.hold.weights))])
        pinned = self.stage.toggle_pin(particle)
        self._pace.restart()
        self._message = f"vertex {particle} is {'pinned' if pinned else 'free'}"

    def _lead(self, name: str, hand: np.ndarray) -> None:
        if name in self.stage.led and np.isfinite(hand).all():
            self.stage.led[name].hand = hand

    def _record(self, path: Path) -> None:
        self._stop_recording()
        if self._pace.slice:  # a recording has whole frames
            self._frame()
        self._writer, self._recorded, self._path = self.stage.built.writer(path), 0, path
        self._write()
        self._message = f"recording {path.name}"

    def _write(self) -> None:
        assert self._writer is not None
        state, model = self.stage.simulation.state, self.stage.simulation.model
        arrays = (state.particle_q.numpy(), state.particle_qd.numpy())
        points, velocities = (by_cloth([self.stage.built], model, values)[0] for values in arrays)
        self._writer.write(self._recorded, points, velocities, self.stage.simulation.time)
        self._recorded += 1

    def _stop_recording(self) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            written = writer.close()
            self._message = f"recorded {self._recorded} frames to {written}"

    def _show(self) -> None:
        stage = self.stage
        state, model = stage.simulation.state, stage.simulation.model
        self._number += 1
        with np.errstate(all="ignore"):  # what has diverged is shown, too
            points = state.particle_q.numpy().astype(np.float32)
            speeds = np.linalg.norm(state.particle_qd.numpy(), axis=1).astype(np.float32)
        held = model.particle_inv_mass.numpy() == 0.0
        self.snapshot = Snapshot(
            number=self._number,
            time=stage.simulation.time,
            status=self._status,
            error=self._error,
            points=by_cloth([stage.built], model, points)[0],
            speeds=by_cloth([stage.built], model, speeds)[0],
            obstacles={name: item.pose(stage.simulation.time) for name, item in stage.led.items()},
            pace=self._pace.factor,
            substeps=self._substeps,
            slices=self._pace.slices,
            energies=self._plotted,
            recording=self._path.name if self._writer is not None else "",
            settings=stage.settings,
            changes=self._taken,
            pinned=points[held],
            message=self._message,
        )
