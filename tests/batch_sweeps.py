"""Small sweeps for the tests of batches, and what is in a batch's folder."""

from pathlib import Path

from warpcloth.batch import load_sweep
from warpcloth.batch.folder import BatchFolder
from warpcloth.batch.job import Job, Outcome

SCENE = """
frames = 24
fps = 30.0

[simulation]
integrator = "xpbd"
device = "cpu"
contact = "all"

[[cloth]]
shape = "grid"
size = [0.16, 0.16]
resolution = [6, 6]
position = [0.0, 0.0, 0.21]
fabric = { damping_time = 5e-3 }

[[obstacle]]
name = "ball"
shape = "sphere"
center = [0.0, 0.0, 0.1]
radius = 0.1

[[obstacle]]
name = "ground"
shape = "plane"
"""

SWEEP = """
scene = "scene.toml"
count = 6
outputs = ["pose", "frames", "strain"]

[[parameter]]
path = "cloth.0.position.2"
uniform = [0.205, 0.3]

[[parameter]]
path = "cloth.0.jitter"
values = [0.0, 1e-4]

[[parameter]]
path = "obstacle.1"
values = [{ shape = "plane" }, { shape = "box", center = [0.0, 0.0, 0.1], size = [0.2, 0.2, 0.2] }]

[[parameter]]
path = "frames"
values = [12, 20]
"""


def written(folder: Path, sweep: str = SWEEP, scene: str = SCENE) -> Path:
    """The path of a sweep file in ``folder``, beside its scene."""
    (folder / "scene.toml").write_text(scene, encoding="utf-8")
    (folder / "sweep.toml").write_text(sweep, encoding="utf-8")
    return folder / "sweep.toml"


def simulated(path: Path, target: Path, worlds: int) -> tuple[BatchFolder, list[Outcome]]:
    """A batch done in this process, so many samples together."""
    sweep, folder = load_sweep(path), BatchFolder(target)
    outcomes: list[Outcome] = []
    with folder.locked():
        folder.claim(sweep)
        for first in range(0, sweep.count, worlds):
            job = Job(sweep, folder, lambda: None, outcomes.append)
            job.run(range(first, min(first + worlds, sweep.count)))
    return folder, outcomes


def contents(folder: BatchFolder) -> dict[str, bytes]:
    """Every file of the samples by its path, as bytes."""
    files = [path for path in folder.samples.rglob("*") if path.is_file()]
    return {path.relative_to(folder.samples).as_posix(): path.read_bytes() for path in sorted(files)}
