"""What a batch will do: how many processes and worlds, and what it will take."""

import contextlib
import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import warp as wp

from ..errors import WarpclothError
from ..model import find_device
from ..program import cores
from ..scenes.built import BuiltScene, make_model, make_simulation
from .folder import BatchFolder
from .prepared import prepare
from .sweep import Sample, Sweep

# Particles stepped together: enough that launching kernels costs little beside running them, see benchmarks/README.md.
CPU_PARTICLES, GPU_PARTICLES = 4_096, 1_048_576
MOST_WORLDS = 1024
PROBES = 7  # samples, evenly spread, that are looked at; of these one can be simulated, hopefully
PROBE_SECONDS = 2.0
TIMED = ("frames", "fps", "stage")  # what a sample's frames hang on


@dataclass(frozen=True)
class Plan:
    """What a batch will do.

    Attributes:
        samples: number of all. finished: of those that are complete already.
        workers: processes. worlds: most samples stepped together in each. gpus: GPUs divided among the workers.
        particles: of the largest sample that was looked at. frames: of the longest sample, if it does not rest before.
        bytes: about what is written for all samples that are left.
        seconds: about the wall time for those; None if it has not been estimated.
    """

    samples: int
    finished: int
    workers: int
    worlds: int
    gpus: int
    particles: int
    frames: int
    bytes: int
    seconds: float | None = None

    @property
    def left(self) -> int:
        """Number of samples to simulate."""
        return self.samples - self.finished

    def as_dict(self) -> dict[str, Any]:
        """The attributes by name."""
        return asdict(self)


def make_plan(
    sweep: Sweep,
    folder: BatchFolder,
    workers: int | None,
    worlds: int | None,
    *,
    estimate: bool = False,
    retry_failed: bool = False,
) -> Plan:
    """The plan for what is left of a sweep.

    Args:
        sweep: the sweep.
        folder: where its samples go.
        workers: processes, worlds: samples stepped together; None for what suits the machine and the scene.
        estimate: whether to find out how long it takes, by simulating a few frames.
        retry_failed: whether samples that have failed are left to do, too.

    Raises:
        InputError: there is no such device.
    """
    device = sweep.base["simulation"]["device"]
    found = find_device(None if device == "auto" else device)
    gpus = wp.get_cuda_device_count() if found.is_cuda and device == "auto" else 0
    particles, frames = _particles(sweep), _frames(sweep)
    largest, mean = max(particles), sum(particles) / len(particles)
    length = sum(frames) / len(frames)
    room = GPU_PARTICLES if found.is_cuda else CPU_PARTICLES
    finished = len(folder.finished()) - (len(folder.failed()) if retry_failed else 0)
    left = sweep.count - finished
    workers = max(1, min(left, workers or ((gpus or 1) if found.is_cuda else cores())))
    worlds = worlds or max(1, min(MOST_WORLDS, room // max(1, largest)))
    seconds = _particle_seconds(sweep) * mean * length * left / workers if estimate else None
    size = round(_sample_bytes(sweep, mean, length) * left)
    return Plan(sweep.count, finished, workers, worlds, gpus, largest, max(frames), size, seconds)


def _probes(sweep: Sweep) -> list[Sample]:
    """Samples from all over the sweep, in which what varies is as varied as in all of them."""
    numbers = np.unique(np.linspace(0, sweep.count - 1, PROBES).astype(int))
    return [sweep.sample(index) for index in numbers.tolist()]


def _particles(sweep: Sweep) -> list[int]:
    """Particles of samples that can be built, or a zero if none can; obstacles are left alone."""
    sizes = []
    for sample in _probes(sweep):
        with contextlib.suppress(WarpclothError):
            sizes.append(_size(BuiltScene.of(sample.scene.changed({"obstacle": []}))))
    return sizes or [0]


def _size(built: BuiltScene) -> int:
    """Particles of a scene."""
    return sum(map(len, [built.network.points] if built.network else [cloth.points for cloth in built.cloths]))


def _frames(sweep: Sweep) -> list[int]:
    """Frames of each sample, if it does not rest before; just one number where all have the same."""
    differ = any(parameter.path.partition(".")[0] in TIMED for parameter in sweep.table.parameter)
    return [sweep.sample(index).scene.frames for index in range(sweep.count if differ else 1)]


def _particle_seconds(sweep: Sweep) -> float:
    """Wall time of a frame for each particle of a sample alone [s], by the first frames of one of the samples.

    Raises:
        WarpclothError: none of those looked at can be simulated.
    """
    *others, last = _probes(sweep)
    for sample in others:
        with contextlib.suppress(WarpclothError):
            return _measured(sample)
    return _measured(last)


def _measured(sample: Sample) -> float:
    """Wall time of one of the first frames of a sample alone, for each of its particles [s]."""
    prepared = prepare(sample)
    simulation = make_simulation([prepared.built], make_model([prepared.built]))
    for _ in range(2):  # the first loads the kernels, the second captures the graph
        simulation.step(1.0 / prepared.scene.fps)
    begun, frames = time.perf_counter(), 0
    while frames < prepared.scene.frames and time.perf_counter() - begun < PROBE_SECONDS:
        simulation.step(1.0 / prepared.scene.fps)
        frames += 1
    return (time.perf_counter() - begun) / max(1, frames) / max(1, _size(prepared.built))


def _sample_bytes(sweep: Sweep, particles: float, frames: float) -> float:
    """Of one sample, about: points, velocities and normals of each frame, and what does not move."""
    outputs = sweep.table.outputs
    poses = (frames + 1) * ("frames" in outputs) + ("pose" in outputs)
    return 40_000 + particles * (36 * poses + 60 * ("strain" in outputs) + 100)
