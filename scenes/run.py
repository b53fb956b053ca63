"""From a scene to a USD cache: build, step, write, measure."""

import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import warp as wp

from warpcloth.diagnostics import penetration_depths
from warpcloth.intersections import Triangles
from warpcloth.model import YARNS
from warpcloth.simulation import Simulation
from warpcloth.validate import choice, file_path, function

from .built import BuiltScene, by_cloth, make_model, make_simulation
from .interrupt import StopRequest, stop_on_interrupt
from .load import load_scene
from .result import SimulationResult
from .schema import Scene

if TYPE_CHECKING:
    from .usd.frames import FrameWriter

OnFrame = Callable[[int, int, Simulation], None]


def simulate(
    scene: Scene | str | Path,
    output: str | Path | None = None,
    *,
    frames: int | None = None,
    integrator: str | None = None,
    substeps: int | str | None = None,
    device: str | wp.Device | None = None,
    precision: str | None = None,
    check: str = "last",
    profile: bool = False,
    untangle: bool = False,
    threads: int | None = None,
    on_frame: OnFrame | None = None,
) -> SimulationResult:
    """Simulate a scene and write it as a USD cache.

    The file grows under another name and gets its own once it is complete. Ctrl-C ends it after the frame in hand;
    a simulation that diverges leaves no file.

    Args:
        scene: A scene, the name of a bundled one, or the path of a scene file or USD stage.
        output: File to write, ``.usd``, ``.usdc``, …; by default the scene's name in the current folder,
            of a stage with ``_sim`` behind it: see :class:`warpcloth.scenes.shots.layers.ShotWriter`.
        frames: Frames to simulate; by default as many as the scene says. Likewise the following.
        integrator: Name of the integrator.
        substeps: Integration steps per frame, or ``"auto"``.
        device: Warp device or its name, e.g. ``"cpu"`` or ``"cuda:0"``; ``"auto"`` for Warp's default.
        precision: ``"float32"`` or ``"float64"``.
        check: "every" counts intersections and measures penetration at every frame, "last" at the last one only.
        profile: Time the stages of each frame, which costs time itself.
        untangle: Try to resolve intersections at the start.
        threads: Cores of the CPU to use; by default all, but for small scenes. The result is the same with any number.
        on_frame: Called after each frame with its number, the number of frames, and the simulation.

    Raises:
        InputError: The scene, an option or the output is not valid.
        BadStartError: Cloth starts inside an obstacle.
        DivergedError: The simulation diverged.
        KeyboardInterrupt: Interrupted before there was a first frame to keep.
    """
    options: dict[str, Any] = {"frames": frames}
    options |= {
        f"simulation.{key}": value
        for key, value in (
            ("integrator", integrator), ("substeps", substeps), ("precision", precision),
            ("device", str(device) if isinstance(device, wp.Device) else device),
        )
    }  # fmt: skip
    loaded = scene if isinstance(scene, Scene) else load_scene(scene)
    chosen = loaded.changed({key: value for key, value in options.items() if value is not None})
    every = choice(check, ("every", "last"), "check") == "every"
    usual = f"{chosen.name}.usdc" if chosen.stage is None else f"{chosen.name}_sim.usda"
    path = file_path(usual if output is None else output, "output")
    function(on_frame, "on_frame")
    return _Run(chosen, path, every, profile=profile, untangled=untangle, threads=threads).result(on_frame)


class _Run:
    """One scene on its way to a file."""

    def __init__(self, scene: Scene, output: Path, every: bool, **options: Any):
        self.begun = time.perf_counter()
        self.every, self.options = every, options
        self.scene, self.output = scene, output
        self.built_scene = BuiltScene.of(scene)
        self.built = time.perf_counter()
        self.frame_times: list[float] = []
        self.checks: list[tuple[int, int, float]] = []

    def result(self, on_frame: OnFrame | None) -> SimulationResult:
        """Simulate, write, and say how it went."""
        with stop_on_interrupt() as stop, self.built_scene.result_writer(self.output) as writer:
            self.model = make_model([self.built_scene])
            self.triangles = Triangles(self.model) if self.model.tri_count > 0 else None
            simulation = make_simulation([self.built_scene], self.model, **self.options)
            self.ready = time.perf_counter()
            try:
                self._frames(writer, simulation, on_frame, stop)
            except KeyboardInterrupt:
                if writer.frames < 2:
                    writer.abort()  # of the start alone there is nothing to keep
                raise
        if not self.every:
            self._check(simulation, last=True)
        return self._figures(simulation)

    def _frames(
        self, writer: "FrameWriter", simulation: Simulation, on_frame: OnFrame | None, stop: StopRequest
    ) -> None:
        """Simulate and write frame after frame, until the last one or until it is asked to stop."""
        self._write(writer, 0, simulation)
        self._check(simulation, last=False)
        for number in range(1, self.scene.frames + 1):
            self._step(simulation)
            if number == 1:
                writer.note({"substeps": simulation.substeps, "device": str(self.model.device)})
            self._write(writer, number, simulation)
            self._check(simulation, last=False)
            stop.waits = True
            if on_frame is not None:
                on_frame(number, self.scene.frames, simulation)
            if stop.made:
                break

    def _check(self, simulation: Simulation, *, last: bool) -> None:
        """Intersections and penetration, if every frame is checked or it is the last."""
        if self.every or last:
            pairs = (0, 0) if self.triangles is None else self.triangles.count(simulation.state).sum(axis=0)
            depth = penetration_depths(self.model, simulation.state).max(initial=0.0)
            self.checks.append((int(pairs[0]), int(pairs[1]), float(depth)))

    def _step(self, simulation: Simulation) -> None:
        if len(self.frame_times) == 1:
            simulation.watch.seconds.clear()  # the first frame, which loads kernels, counts only where it is alone
        begun = time.perf_counter()
        simulation.step(1.0 / self.scene.fps)
        wp.synchronize_device(self.model.device)
        self.frame_times.append(time.perf_counter() - begun)

    def _write(self, writer: "FrameWriter", frame: int, simulation: Simulation) -> None:
        state = simulation.state
        arrays = (state.particle_q.numpy(), state.particle_qd.numpy())
        points, velocities = (by_cloth([self.built_scene], self.model, values)[0] for values in arrays)
        writer.write(frame, points, velocities)

    def _figures(self, simulation: Simulation) -> SimulationResult:
        model, measured = self.model, simulation.metrics()
        among, solid, depths = zip(*self.checks, strict=True)
        later = max(1, len(self.frame_times) - 1)
        typical = statistics.median(self.frame_times[1:] or self.frame_times)
        return SimulationResult(
            scene=self.scene.name,
            integrator=self.scene.simulation.integrator,
            precision=self.scene.simulation.precision,
            device=str(model.device),
            threads=simulation.threads,
            frames=len(self.frame_times),
            fps=self.scene.fps,
            substeps=simulation.substeps,
            particles=model.particle_count,
            springs=model.spring_count + YARNS * model.woven_count,
            triangles=model.tri_count,
            ms_per_frame=1e3 * typical,
            compile_s=max(0.0, self.ready - self.built + self.frame_times[0] - typical),
            wall_s=time.perf_counter() - self.begun,
            mean_strain=measured["mean_strain"],
            max_strain=measured["max_strain"],
            intersections=max(among),
            obstacle_intersections=max(solid),
            max_penetration_m=max(depths),
            checked_frames=len(self.checks),
            bad_frames=sum(pairs > 0 for pairs in among),
            contact=simulation.contact.metrics(),
            untangled={} if simulation.untangled is None else simulation.untangled.as_dict(),
            profile_ms={name: 1e3 * spent / later for name, spent in simulation.watch.seconds.items()},
            settled=measured["settled"],
            solver=dict(simulation.integrator.metrics()),
            interrupted=len(self.frame_times) < self.scene.frames,
            output=self.output.absolute(),
        )
