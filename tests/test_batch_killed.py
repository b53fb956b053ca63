"""Batches whose workers and parents die at random moments: nothing is lost, nothing is twice, nothing is half."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil
import pytest
from batch_sweeps import SCENE, SWEEP, contents, simulated, written

from warpcloth.batch import load_sweep, run
from warpcloth.batch.folder import BatchFolder
from warpcloth.batch.recorder import METRICS
from warpcloth.batch.recorder import SCENE as SCENE_FILE
from warpcloth.batch.run import run_batch, status_of

ROUNDS = int(os.environ.get("WARPCLOTH_KILLS", "3"))  # deaths of parents; for each, some of workers
MANY = SWEEP.replace("count = 6", "count = 24")
FINE = SCENE.replace("resolution = [6, 6]", "resolution = [12, 12]")


def start(path: Path, target: Path) -> subprocess.Popen:
    command = [
        sys.executable,
        "-m",
        "warpcloth",
        "batch",
        str(path),
        "-o",
        str(target),
        "--workers",
        "2",
        "--worlds",
        "3",
    ]
    return subprocess.Popen([*command, "--json"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


def kill_a_worker(parent: psutil.Process, chance: random.Random) -> bool:
    """One of the processes below, if there is one that is no helper of multiprocessing."""
    workers = [child for child in parent.children() if "spawn_main" in " ".join(child.cmdline())]
    if workers:
        chance.choice(workers).kill()
    return bool(workers)


def assert_whole(folder: BatchFolder) -> None:
    """Whatever has a final name is complete."""
    for place in folder.samples.iterdir() if folder.samples.exists() else ():
        facts = json.loads((place / METRICS).read_text())
        assert {file.name for file in place.iterdir()} == {METRICS, *facts["files"]} >= {SCENE_FILE, "cache.usdc"}


def test_nothing_is_lost_and_nothing_is_half(tmp_path):
    path = written(tmp_path, MANY, FINE)
    undisturbed, _ = simulated(path, tmp_path / "undisturbed", worlds=7)
    chance, folder, deaths = random.Random(3), BatchFolder(tmp_path / "batch"), 0
    for _ in range(ROUNDS):
        process = start(path, folder.path)
        parent = psutil.Process(process.pid)
        end = time.monotonic() + chance.uniform(2.0, 5.0)
        while (time.monotonic() < end or deaths == 0) and process.poll() is None:  # workers may take long to start
            time.sleep(chance.uniform(0.2, 1.2))
            if process.poll() is None and (deaths == 0 or chance.random() < 0.5):
                deaths += kill_a_worker(parent, chance)
        orphans = parent.children() if process.poll() is None else []
        process.send_signal(signal.SIGKILL)
        process.communicate()
        _, alive = psutil.wait_procs(orphans, timeout=10.0)
        assert not alive
        assert_whole(folder)
    process = start(path, folder.path)
    status = json.loads(process.communicate(timeout=120)[0])
    assert process.returncode == 0
    assert deaths > 0
    assert (status["done"], status["failed"]) == (24, 0)
    assert folder.finished() == list(range(24))
    assert contents(folder) == contents(undisturbed)
    assert not list(folder.partial.iterdir())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_batch_that_is_asked_to_end_is_left_to_resume(tmp_path, number):
    """By Ctrl-C, or by a scheduler whose time is up."""
    path = written(tmp_path, MANY, FINE)
    folder = BatchFolder(tmp_path / "batch")
    process = start(path, folder.path)
    while not folder.finished():
        time.sleep(0.05)
        assert process.poll() is None
    process.send_signal(number)
    status = json.loads(process.communicate(timeout=30)[0])
    assert process.returncode == 130
    assert status["interrupted"]
    assert 0 < status["done"] < 24
    assert (folder.path / "manifest.csv").read_text().count("\n") == status["done"] + 1
    assert not list(folder.partial.iterdir())
    assert_whole(folder)


def test_what_was_not_indexed_is_when_the_batch_is_resumed(tmp_path, monkeypatch):
    sweep = load_sweep(written(tmp_path, SWEEP.replace("count = 6", "count = 3")))

    def rows() -> int:
        return (tmp_path / "batch" / "manifest.csv").read_text().count("\n") - 1

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    def stop_at_outcome(plan: object, outcome: object) -> None:
        if outcome is not None:
            stop()

    with pytest.raises(KeyboardInterrupt):
        run_batch(sweep, tmp_path / "batch", workers=1, worlds=1, on_progress=stop_at_outcome)
    assert rows() < 3
    with monkeypatch.context() as patch:
        patch.setattr(run, "index_batch", stop)
        with pytest.raises(KeyboardInterrupt):
            run_batch(sweep, tmp_path / "batch", workers=1)
    assert rows() < 3 == status_of(BatchFolder(tmp_path / "batch")).done
    run_batch(sweep, tmp_path / "batch", workers=1)
    assert rows() == 3


def test_ctrl_c_once_more_lets_the_index_be_finished(tmp_path, monkeypatch):
    sweep = load_sweep(written(tmp_path, SWEEP.replace("count = 6", "count = 2")))
    reached = []

    def pressed(*_: object) -> None:
        raise KeyboardInterrupt

    def write_sheet(folder: BatchFolder) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        reached.append(folder.path)

    monkeypatch.setattr(run, "write_sheet", write_sheet)
    with pytest.raises(KeyboardInterrupt):
        run_batch(sweep, tmp_path / "batch", workers=1, on_progress=pressed)
    assert reached == [tmp_path / "batch"]
    assert not BatchFolder(tmp_path / "batch").stale.exists()


def test_two_at_the_index_take_turns(tmp_path, monkeypatch):
    """Four that write one and the same partial file would fail, or mix what they write."""
    folder = BatchFolder(tmp_path / "batch")
    folder.claim(load_sweep(written(tmp_path)))
    at_work, most = [], []

    def write_assembly(_: BatchFolder) -> None:
        at_work.append(1)
        time.sleep(0.1)
        most.append(len(at_work))
        at_work.pop()

    monkeypatch.setattr(run, "write_assembly", write_assembly)
    with ThreadPoolExecutor() as pool:
        list(pool.map(run.index_batch, [folder] * 4))
    assert most == [1, 1, 1, 1]
