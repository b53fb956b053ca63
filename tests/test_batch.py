"""Batches: the same bytes in any company, failures that stay alone, folders that are complete, results, commands."""

import csv
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from batch_sweeps import SCENE, SWEEP, contents, simulated, written
from PIL import Image
from pxr import Usd
from warpcloth.scenes import check_cache, load_scene, simulate

from warpcloth.batch import load_sweep, recorder
from warpcloth.batch.folder import BatchFolder
from warpcloth.batch.job import Job
from warpcloth.batch.prepared import prepare, rounded_up
from warpcloth.batch.queue import Queue
from warpcloth.batch.run import index_batch, run_batch, status_of
from warpcloth.cli import run as cli
from warpcloth.errors import InputError, SceneError


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The sweep of the tests, every sample simulated by itself."""
    folder = tmp_path_factory.mktemp("alone")
    return simulated(written(folder), folder / "batch", worlds=1)[0]


@pytest.mark.parametrize("worlds", [4, 6])
def test_a_sample_is_the_same_in_any_company(alone, worlds):
    """Worlds end at different frames, some at rest, and leave the model; one has a box for an obstacle."""
    together, outcomes = simulated(alone.path.parent / "sweep.toml", alone.path.parent / f"worlds{worlds}", worlds)
    assert contents(together) == contents(alone)
    assert sorted(outcome.index for outcome in outcomes) == list(range(6))


def test_samples_end_when_they_rest(alone):
    facts = [alone.metrics(index) for index in range(6)]
    early = [row for row in facts if row["metrics"]["frames"] < row["parameters"]["frames"]]
    assert 0 < len(early) < 6
    assert all(row["metrics"]["settled"] for row in early)


def test_the_scene_beside_a_sample_makes_it_again(alone, tmp_path):
    index = next(i for i in range(6) if alone.metrics(i)["parameters"]["cloth.0.jitter"])
    scene = load_scene(alone.place(index) / "scene.toml")
    result = simulate(scene, tmp_path / "again.usdc")
    assert result.output.read_bytes() == (alone.place(index) / "cache.usdc").read_bytes()
    metrics = alone.metrics(index)["metrics"]
    assert (result.frames, result.substeps) == (metrics["frames"], metrics["substeps"])
    assert (result.max_strain, result.intersections) == (metrics["max_strain"], metrics["intersections"])


def test_what_is_written_is_sound(alone):
    for index in range(6):
        cache, pose = (check_cache(alone.place(index) / name) for name in ("cache.usdc", "pose.usdc"))
        metrics = alone.metrics(index)["metrics"]
        assert cache.ok
        assert pose.ok
        assert (cache.frames, pose.frames) == (metrics["frames"] + 1, 1)
        strain = np.load(alone.place(index) / "strain.npy")
        assert strain.shape == (metrics["springs"],)
        assert np.abs(strain).max() >= metrics["max_strain"] > 0.0


def test_the_manifest_and_the_assembly_come_from_the_folders(alone):
    parquet = pytest.importorskip("pyarrow.parquet")
    files = index_batch(alone)
    assert [file.name for file in files] == ["manifest.csv", "manifest.parquet", "assembly.usda", "contact_sheet.png"]
    with open(files[0], newline="") as lines:
        rows = list(csv.DictReader(lines))
    table = parquet.read_table(files[1])
    assert table.column("sample").to_pylist() == [int(row["sample"]) for row in rows] == list(range(6))
    facts = alone.metrics(3)
    assert float(rows[3]["cloth.0.position.2"]) == facts["parameters"]["cloth.0.position.2"]
    assert table.column("metrics.max_strain").to_pylist()[3] == facts["metrics"]["max_strain"]
    assert rows[3]["sha256.cache.usdc"] == facts["files"]["cache.usdc"]
    sheet = np.asarray(Image.open(files[3]))
    assert (sheet.std(axis=(0, 1)) > 5.0).all()  # something is to be seen
    stage = Usd.Stage.Open(str(files[2]))
    drapes = stage.GetPrimAtPath("/Samples").GetChildren()
    assert [prim.GetName() for prim in drapes] == [f"sample_{index:06d}" for index in range(6)]
    assert all(prim.GetChild("Cloth").GetChildren() for prim in drapes)
    assert stage.GetEndTimeCode() == max(alone.metrics(index)["metrics"]["frames"] for index in range(6))


def test_networks_stand_side_by_side(tmp_path):
    """The pendulum reaches 1.5 m to the side."""
    sweep = 'scene = "pendulum"\ndesign = "grid"\n[[parameter]]\npath = "network.k_s"\nvalues = [200.0, 300.0]\n'
    sweep += '[[parameter]]\npath = "frames"\nvalues = [2]\n'
    folder, _ = simulated(written(tmp_path, sweep), tmp_path / "batch", worlds=1)
    index_batch(folder)
    stage = Usd.Stage.Open(str(folder.path / "assembly.usda"))
    assert stage.GetPrimAtPath("/Samples/sample_000001").GetAttribute("xformOp:translate").Get()[0] > 3.0


OBJECTS = """
scene = "scene.toml"
design = "grid"

[[parameter]]
path = "obstacle.ball.path"
glob = "objects/*"
"""
MESH = 'shape = "mesh"\npath = "x.obj"\nscale = 0.2'
BALL = 'shape = "sphere"\ncenter = [0.0, 0.0, 0.1]\nradius = 0.1'
TETRAHEDRON = "v 0 0 0\nv 0.5 0 0\nv 0 0.5 0\nv 0 0 0.5\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def test_bad_meshes_fail_alone_with_their_reasons(tmp_path):
    """In one group with good ones; the huge one is over the limit of memory."""
    (tmp_path / "objects").mkdir()
    (tmp_path / "objects" / "a_good.obj").write_text(TETRAHEDRON)
    (tmp_path / "objects" / "b_corrupt.stl").write_bytes(b"solid\0" + bytes(range(256)) * 3)
    (tmp_path / "objects" / "c_empty.obj").write_text("")
    with open(tmp_path / "objects" / "d_huge.stl", "wb") as huge:  # 5 million triangles, in a file with a hole
        huge.write(bytes(80) + (5_000_000).to_bytes(4, "little"))
        huge.truncate(84 + 50 * 5_000_000)
    (tmp_path / "objects" / "e_good.obj").write_text(TETRAHEDRON)
    scene = SCENE.replace(BALL, MESH).replace("frames = 24", "frames = 3")
    path = written(tmp_path, OBJECTS + "[limits]\nmemory_mib = 1000\n", scene)
    status = run_batch(load_sweep(path), tmp_path / "batch", workers=1, worlds=5)
    assert (status.done, status.failed) == (2, 3)
    folder = BatchFolder(tmp_path / "batch")
    reasons = [folder.metrics(index).get("reason") for index in range(5)]
    assert reasons[0] is reasons[4] is None
    assert "b_corrupt.stl' holds no triangle that can be read" in reasons[1]
    assert "c_empty.obj' is empty" in reasons[2]
    assert reasons[3] == "It needed more than 1,000 MiB of memory."
    assert (folder.place(3) / "scene.toml").exists()
    assert not list(folder.partial.iterdir())


FAILURES = """
scene = "scene.toml"
design = "grid"
outputs = ["pose"]

[[parameter]]
path = "cloth.0"
values = [
  {{ shape = "grid", size = [0.3, 0.3], resolution = [5, 5], position = [0.0, 0.0, 0.3] }},
  {{ shape = "grid", size = [0.3, 0.3], resolution = [5, 5], position = [0.0, 0.0, {z}], jitter = 1e-3, {more} }},
  {{ shape = "grid", size = [0.3, 0.3], resolution = [5, 5], position = [0.0, 0.0, 0.32] }},
]
"""


@pytest.mark.parametrize("contact", ["obstacles", "all"])
@pytest.mark.parametrize(
    ("z", "more", "reason"),
    [
        (0.1, "velocity = [0, 0, 0]", "starts inside an obstacle"),
        (0.4, "fabric = { areal_density = 1e-3, stretch_stiffness = 1e6 }", "The simulation diverged"),
    ],
)
def test_a_sample_that_fails_has_no_part_in_its_neighbours(tmp_path, z, more, reason, contact):
    scene = SCENE.replace('"xpbd"', '"symplectic_euler"\nsubsteps = 40').replace("frames = 24", "frames = 8")
    path = written(tmp_path, FAILURES.format(z=z, more=more), scene.replace('"all"', f'"{contact}"'))
    both = [simulated(path, tmp_path / f"worlds{worlds}", worlds) for worlds in (1, 3)]
    assert contents(both[0][0]) == contents(both[1][0])
    for folder, outcomes in both:
        assert [folder.metrics(index)["status"] for index in range(3)] == ["done", "failed", "done"]
        assert reason in folder.metrics(1)["reason"]
        assert sorted(outcome.index for outcome in outcomes) == [0, 1, 2]


def test_a_sample_over_its_time_fails(tmp_path):
    path = written(tmp_path, SWEEP.replace("count = 6", "count = 2") + "[limits]\nseconds = 1e-6\n")
    folder, _ = simulated(path, tmp_path / "batch", worlds=2)
    assert [folder.metrics(index)["reason"] for index in (0, 1)] == ["It took longer than 1e-06 s."] * 2


def test_substeps_are_fixed_for_each_sample_by_itself(tmp_path):
    sweep = load_sweep(written(tmp_path, SWEEP, SCENE.replace('"xpbd"', '"symplectic_euler"')))
    first, second = (prepare(sweep.sample(index)) for index in (0, 1))
    assert first.scene.simulation.substeps == second.scene.simulation.substeps > 1
    assert first.companions == second.companions
    assert [rounded_up(n) for n in (1, 15, 16, 17, 33, 100, 100_000)] == [1, 15, 16, 18, 36, 104, 100_000]
    adaptive = load_sweep(tmp_path / "sweep.toml", ["scene=scene.toml"]).base
    assert adaptive["simulation"]["substeps"] == "auto"


def test_jobs_shrink_towards_the_end_and_halve_after_a_death():
    queue = Queue(range(20), worlds=6, workers=2)
    sizes = [len(queue.take()) for _ in range(9)]
    assert sizes == [5, 4, 3, 2, 2, 1, 1, 1, 1]
    assert not queue.take()
    queue.put_back([3, 4, 5])
    queue.put_back([1, 2])  # before those that are farther from being alone
    assert (len(queue), [queue.take() for _ in range(4)], len(queue)) == (5, [[1], [2], [3, 4], [5]], 0)


def test_a_folder_belongs_to_one_sweep(alone, tmp_path):
    sweep = load_sweep(alone.path.parent / "sweep.toml")
    alone.claim(sweep)
    with pytest.raises(InputError, match=r"another state of sweep.toml \(count differ\)"):
        alone.claim(load_sweep(alone.path.parent / "sweep.toml", ["count=7"]))
    with pytest.raises(InputError, match=r"another sweep, sweep\.toml in"):
        alone.claim(load_sweep(written(tmp_path)))
    (tmp_path / "scene.toml").write_text(SCENE.replace("radius = 0.1", "radius = 0.11"))
    other = BatchFolder(tmp_path / "batch")
    other.claim(load_sweep(tmp_path / "sweep.toml"))
    (tmp_path / "scene.toml").write_text(SCENE)
    with pytest.raises(InputError, match="another state of the scene"):
        other.claim(load_sweep(tmp_path / "sweep.toml"))
    with pytest.raises(InputError, match="not empty and not of a batch"):
        BatchFolder(tmp_path).claim(sweep)
    with pytest.raises(InputError, match="MiB free"):
        alone.check_space(10**18)
    with alone.locked(), pytest.raises(InputError, match="Another batch is at work"), BatchFolder(alone.path).locked():
        pass


def test_the_second_to_finish_a_sample_gives_way(alone):
    before = contents(alone)
    partial = alone.new_partial(2)
    (partial / "metrics.json").write_text("{}")
    alone.publish(partial, 2)
    assert contents(alone) == before
    assert not partial.exists()


def test_what_failed_can_be_tried_again(tmp_path):
    path = written(tmp_path, SWEEP.replace("count = 6", "count = 1"))
    folder, _ = simulated(path, tmp_path / "batch", worlds=1)
    facts = folder.metrics(0)
    (folder.place(0) / "metrics.json").write_text(json.dumps({**facts, "status": "failed", "reason": "Bad luck."}))
    assert status_of(folder).reasons == {"Bad luck.": 1}
    folder.forget_failed()
    assert folder.finished() == []
    Job(load_sweep(path), folder, lambda: None, lambda outcome: None).run([0])
    assert folder.metrics(0) == facts


def test_the_command(tmp_path, capfd):
    path = str(written(tmp_path, SWEEP.replace("count = 6", "count = 3")))
    out = str(tmp_path / "out")

    def run(*arguments: str) -> tuple[int, dict]:
        code = cli(["batch", *arguments, "--json"])
        return code, json.loads(capfd.readouterr().out)

    code, plan = run(path, "-o", out, "--dry-run", "--worlds", "2")
    assert (code, plan["samples"], plan["left"], plan["worlds"], plan["particles"]) == (0, 3, 3, 2, 36)
    assert plan["seconds"] > 0.0
    assert not os.path.exists(out)
    code, status = run(path, "-o", out, "--workers", "1")
    assert (code, status["samples"], status["done"], status["failed"]) == (0, 3, 3, 0)
    assert sorted(p.name for p in (tmp_path / "out").iterdir() if not p.name.startswith(".")) == [
        "assembly.usda", "contact_sheet.png", "manifest.csv", "manifest.parquet", "samples", "sweep.json",
    ]  # fmt: skip
    before = contents(BatchFolder(out))
    assert run(path, "-o", out, "--workers", "1")[1]["done"] == 3
    assert contents(BatchFolder(out)) == before
    code, status = run("status", out)
    assert (code, status["done"], status["running"], status["seconds_left"]) == (0, 3, False, 0.0)
    (tmp_path / "out" / "manifest.csv").unlink()
    code, status = run("index", out)
    assert code == 0
    assert (tmp_path / "out" / "manifest.csv").exists()
    code, error = run(path, "-o", out, "--set", "seed=5")
    assert (code, error["exit_code"]) == (2, 2)
    assert "seed differ" in error["error"]
    assert run(path, "--workers", "0", "-o", out)[0] == 2
    assert run("status", str(tmp_path))[0] == 2
    assert run("status")[0] == 2
    for option in (["--workers", "2"], ["--retry-failed"], ["--dry-run"], ["--set", "count=2"], ["-o", out]):
        code, error = run("status", out, *option)
        assert (code, f"{option[0]} " in error["error"], "has no meaning" in error["error"]) == (2, True, True)
    assert "plans for this machine" in run(path, "--dry-run", "--ray", "auto")[1]["error"]


def test_samples_that_failed_make_the_exit_code_3(tmp_path, capfd):
    """The first of two, whose cloth starts inside the ball; also when there is nothing left to do."""
    sweep = 'scene = "scene.toml"\ndesign = "grid"\n[[parameter]]\npath = "cloth.0.position.2"\nvalues = [0.1, 0.21]\n'
    path, out = str(written(tmp_path, sweep)), str(tmp_path / "out")
    for _ in range(2):
        assert cli(["batch", path, "-o", out, "--workers", "1"]) == 3
        report = capfd.readouterr().out
        assert "1 of 2 samples done, 1 failed" in report
        assert "1 ×: Cloth" in report
    for option, left in (([], 0), (["--retry-failed"], 1)):
        assert cli(["batch", path, "-o", out, "--dry-run", *option, "--json"]) == 0
        assert json.loads(capfd.readouterr().out)["left"] == left
    for question in ("status", "index"):
        assert cli(["batch", question, out, "--json"]) == 0
        status = json.loads(capfd.readouterr().out)
        assert (status["done"], status["failed"]) == (1, 1)
    assert cli(["batch", "--help"]) == 0
    assert "3 if any failed" in capfd.readouterr().out


def test_a_preview_is_a_picture_of_the_last_frame(tmp_path, monkeypatch):
    seen = []

    def draw(cache, output, **options):
        seen.append((cache.name, output.name, options["frame"]))
        assert cache.exists()
        output.write_bytes(b"picture")

    monkeypatch.setattr(recorder.pictures, "render", draw, raising=False)
    sweep = SWEEP.replace("count = 6", "count = 1").replace('["pose", "frames", "strain"]', '["frames", "preview"]')
    folder, _ = simulated(written(tmp_path, sweep), tmp_path / "batch", worlds=1)
    assert seen == [("cache.usdc", "preview.png", -1)]
    assert set(folder.metrics(0)["files"]) == {"cache.usdc", "preview.png", "scene.toml"}
    with pytest.raises(SceneError, match="must have 'pose' or 'frames'"):
        load_sweep(tmp_path / "sweep.toml", ["outputs=['preview']"])


def test_indexing_says_nothing_of_drivers_and_displays(alone):
    environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
    command = [sys.executable, "-m", "warpcloth", "batch", "index", str(alone.path)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
    assert "contact_sheet.png" in done.stdout
    assert done.stderr == ""


def test_batches_need_no_library_of_pictures():
    code = """
import sys
for name in ("PIL", "pyvista", "matplotlib", "ray", "scipy", "pyarrow"):
    sys.modules[name] = None  # as if it were not installed
import warpcloth.batch.run
"""
    subprocess.run([sys.executable, "-c", code], check=True)
