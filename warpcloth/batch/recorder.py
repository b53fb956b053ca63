"""What is kept of a sample: files in a folder that is moved into place when all of them are there."""

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .. import render as pictures
from ..errors import SimulationError
from ..scenes import CacheWriter, Scene, check_cache
from .extra import needed
from .prepared import Prepared
from .schema import SweepTable
from .sweep import Sample

SCENE, METRICS, POSE, CACHE, STRAIN, PREVIEW = (
    "scene.toml", "metrics.json", "pose.usdc", "cache.usdc", "strain.npy", "preview.png",
)  # fmt: skip
PREVIEW_SIZE = (320, 320)
Arrays = Mapping[str, np.ndarray]


class Recorder:
    """Writes one sample into a folder of its own.

    Args:
        prepared: the sample.
        folder: to write into; it exists and is empty.
        table: what is to be kept.
    """

    def __init__(self, prepared: Prepared, folder: Path, table: SweepTable):
        self.prepared, self.folder, self.table = prepared, folder, table
        self.writer: CacheWriter | None = None
        if "frames" in table.outputs:
            self.writer = prepared.built.writer(folder / CACHE)

    @property
    def wants_frames(self) -> bool:
        """Whether :meth:`frame` needs to be called."""
        return self.writer is not None

    def frame(self, number: int, points: Arrays, velocities: Arrays, facts: Mapping[str, Any]) -> None:
        """Keeps a frame: positions [m] and velocities [m/s] by name of cloth; ``facts`` are for the provenance."""
        if self.writer is not None:
            if number == 1:
                self.writer.note(facts)
            self.writer.write(number, points, velocities)

    def finish(
        self,
        number: int,
        points: Arrays,
        velocities: Arrays,
        facts: Mapping[str, Any],
        metrics: Mapping[str, Any],
        strain: np.ndarray,
    ) -> None:
        """Completes the folder; ``number`` is the last frame.

        Raises:
            SimulationError: what was written is not sound, and the sweep wants it checked.
        """
        outputs = self.table.outputs
        if self.writer is not None:
            self.writer.close()
        if "pose" in outputs:
            with self.prepared.built.writer(self.folder / POSE) as writer:
                writer.note(facts)
                writer.write(number, points, velocities)
        if "strain" in outputs:
            np.save(self.folder / STRAIN, strain)
        if self.table.check:
            self._check()
        if "preview" in outputs:
            cache = self.folder / (POSE if "pose" in outputs else CACHE)
            pictures.render(cache, self.folder / PREVIEW, frame=-1, size=PREVIEW_SIZE)
        write_scene(self.folder, self.prepared.scene.changed({"frames": number}))
        done = {"status": "done", "metrics": dict(metrics), "inputs": self.prepared.inputs}
        write_metrics(self.folder, self.prepared.sample, done)

    def abandon(self) -> None:
        """Leaves the folder as it is; it will not be moved into place."""
        if self.writer is not None:
            self.writer.abort()

    def _check(self) -> None:
        for name in (CACHE, POSE):
            if (self.folder / name).exists():
                report = check_cache(self.folder / name)
                if not report.ok:
                    what = report.usd_errors[0] if report.usd_errors else "cloth is deep in an obstacle or not finite"
                    raise SimulationError(f"What was written as {name} is not sound: {what.rstrip('.')}.")


def write_failure(folder: Path, sample: Sample, reason: str) -> None:
    """Completes the folder of a sample that failed."""
    write_scene(folder, sample.scene)
    write_metrics(folder, sample, {"status": "failed", "reason": reason})


def write_scene(folder: Path, scene: Scene) -> None:
    """The scene as ``warpcloth simulate`` takes it."""
    tables = scene.model_dump(mode="json", exclude_none=True)
    text = needed("tomli_w").dumps(tables)
    (folder / SCENE).write_text(text, encoding="utf-8")


def write_metrics(folder: Path, sample: Sample, facts: Mapping[str, Any]) -> None:
    """What is known of a sample, and a hash of every other file in the folder."""
    hashes = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}
    data = {"sample": sample.index, **facts, "parameters": sample.parameters, "files": hashes}
    text = json.dumps(_plain(data), indent=1, ensure_ascii=False, allow_nan=False)
    (folder / METRICS).write_text(text + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    """Without numbers that JSON does not have."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
