"""Folders of batches that are not as they should be: one sentence each, and nothing is lost."""

import contextlib
import json
import os
import shutil
import threading
import time

import pytest
from batch_sweeps import SWEEP, simulated, written
from filelock import FileLock

from warpcloth.batch import load_sweep, run
from warpcloth.batch.folder import SWEEP as SWEEP_FILE
from warpcloth.batch.folder import BatchFolder, BusyError
from warpcloth.batch.job import fail
from warpcloth.batch.run import status_of
from warpcloth.cli import run as cli


@pytest.fixture
def batch(tmp_path):
    """A batch of two samples that is done."""
    written(tmp_path, SWEEP.replace("count = 6", "count = 2").replace('["pose", "frames", "strain"]', '["pose"]'))
    return simulated(tmp_path / "sweep.toml", tmp_path / "batch", worlds=2)[0]


def refused(capfd, *arguments: str) -> str:
    """The sentence with which the command refuses."""
    assert cli(["batch", *arguments]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "defect" not in err
    return err


@pytest.mark.parametrize("output", ["file", "file/below", "file/far/below"])
@pytest.mark.parametrize("more", [[], ["--dry-run"]])
def test_a_file_is_no_folder(tmp_path, capfd, output, more):
    (tmp_path / "file").write_text("mine")
    sentence = refused(capfd, str(written(tmp_path)), "-o", str(tmp_path / output), *more)
    assert f"{tmp_path}/file is a file, so {tmp_path}/{output} cannot be a folder" in sentence
    assert "is not the folder of a batch" in refused(capfd, "status", str(tmp_path / output))
    assert (tmp_path / "file").read_text() == "mine"


def test_what_may_not_be_written_is_said(batch, capfd, monkeypatch):
    def refuse(*arguments: object, **options: object) -> None:
        raise PermissionError(13, "Permission denied")

    sweep = str(batch.path.parent / "sweep.toml")
    with monkeypatch.context() as patch:
        patch.setattr("filelock.FileLock.acquire", refuse)
        assert cli(["batch", "status", str(batch.path), "--json"]) == 0
        assert json.loads(capfd.readouterr().out)["running"] is False
        assert f"{batch.path} cannot be written to: permission denied." in refused(capfd, sweep, "-o", str(batch.path))
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", refuse)
        assert f"{batch.path} cannot be written to: permission denied." in refused(capfd, "index", str(batch.path))
    with monkeypatch.context() as patch:
        patch.setattr(os, "access", lambda *arguments: False)
        sentence = refused(capfd, sweep, "-o", str(batch.path.parent / "new" / "one"), "--dry-run")
        assert f"The folder {batch.path.parent} cannot be written to: permission denied." in sentence


@pytest.mark.parametrize("seconds", [0.3, 30.0])
def test_who_only_asks_whether_a_folder_is_busy_keeps_nobody_out(batch, seconds):
    """As `status` does, with the lock in its hand for a moment."""
    held, over = threading.Event(), threading.Event()

    def hold():
        with FileLock(batch.path / ".lock"):
            held.set()
            over.wait(seconds)

    holder = threading.Thread(target=hold)
    holder.start()
    held.wait()
    with contextlib.nullcontext() if seconds < 1.0 else pytest.raises(BusyError), batch.locked():
        assert batch.busy
    over.set()
    holder.join()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", "sweep.json is not JSON; bring it back"),
        ("[]", "sweep.json has no 'format' in it"),
        ('{"format": 1, "version": "0", "name": "", "folder": "", "sweep": [], "scene": {}}', "has no 'sweep' in it"),
        (
            '{"format": 1, "version": "0", "name": "", "folder": "", "sweep": {}, "scene": {}}',
            "warpcloth 0, and this is",
        ),
    ],
)
def test_a_broken_sweep_is_said(batch, capfd, text, sentence):
    (batch.path / SWEEP_FILE).write_text(text)
    for arguments in (["status"], ["index"], [str(batch.path.parent / "sweep.toml"), "-o"]):
        assert sentence in refused(capfd, *arguments, str(batch.path))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, "cannot be read (no such file or directory)"),
        ("{", "is not JSON"),
        ("{}", "has no 'status' in it"),
        ('{"status": "done", "parameters": {}, "files": {}, "inputs": [1]}', "has no usable 'inputs' in it"),
        ('{"status": "done", "parameters": {}, "files": {}, "metrics": 1}', "has no usable 'metrics' in it"),
        ('{"status": "done", "parameters": {}, "files": {"lost.usdc": ""}}', "names lost.usdc, which is not there"),
    ],
)
def test_a_damaged_sample_is_said_before_any_work(batch, capfd, text, sentence):
    file = batch.place(1) / "metrics.json"
    file.unlink() if text is None else file.write_text(text)
    for arguments in (["status"], ["index"], [str(batch.path.parent / "sweep.toml"), "-o"]):
        said = refused(capfd, *arguments, str(batch.path))
        assert f"Sample 1 is damaged: its metrics.json {sentence}; remove the folder {batch.place(1)}, and" in said


def test_samples_taken_away_during_a_run_are_not_done(batch, monkeypatch, capfd):
    """By hand, or by another program; the next run makes them again."""
    arguments = ["batch", str(batch.path.parent / "sweep.toml"), "-o", str(batch.path), "--json"]
    with monkeypatch.context() as patch:
        patch.setattr(run, "index_batch", lambda folder: shutil.rmtree(folder.place(0)))
        assert cli(arguments) == 3
    assert json.loads(capfd.readouterr().out)["done"] == 1
    assert cli([*arguments, "--workers", "1"]) == 0
    assert batch.finished() == [0, 1]


def test_a_dry_run_finds_that_the_folder_is_another_s(batch, capfd):
    sentence = refused(
        capfd, str(batch.path.parent / "sweep.toml"), "-o", str(batch.path), "--dry-run", "--set", "seed=5"
    )
    assert "was begun with another state of sweep.toml (seed differ)" in sentence


def test_folders_beside_the_samples_are_none(batch):
    for name in ("99", "notes", "²"):
        (batch.samples / name).mkdir()
    assert batch.finished() == [0, 1]


def test_an_empty_drape_is_said(batch, capfd):
    (batch.place(1) / "pose.usdc").write_bytes(b"")
    assert f"Cannot read {batch.place(1)}/pose.usdc: the file is empty." in refused(capfd, "index", str(batch.path))


def test_an_assembly_that_cannot_be_written_is_said(batch, capfd):
    (batch.path / ".partial.assembly.usda").mkdir()
    assert f"Cannot write {batch.path}/assembly.usda: " in refused(capfd, "index", str(batch.path))


def test_what_a_kill_left_of_the_sweep_is_no_obstacle(tmp_path):
    folder = BatchFolder(tmp_path / "batch")
    folder.path.mkdir()
    for name in (".lock", ".sweep.json", ".sweep.json.0a1b2c3d"):
        (folder.path / name).write_text("{")
    sweep = load_sweep(written(tmp_path))
    folder.claim(sweep)
    assert folder.sweep.identity == sweep.identity


def test_the_rate_is_that_of_the_run(tmp_path):
    """Two samples of long ago, then two that ended together 20 seconds after their run began."""
    sweep, folder = load_sweep(written(tmp_path, SWEEP.replace("count = 6", "count = 32"))), BatchFolder(tmp_path / "b")
    folder.claim(sweep)
    assert status_of(folder).samples_per_minute is None
    now = time.time()
    for index, age in enumerate([9000.0, 8000.0, 0.03, 0.0]):
        fail(folder, sweep.sample(index), "Slow.")
        os.utime(folder.place(index), (now - age, now - age))
    folder.begun.touch()
    os.utime(folder.begun, (now - 20.0, now - 20.0))
    for running in (True, False):
        status = status_of(folder, running)
        assert status.samples_per_minute == pytest.approx(6.0, rel=0.1)
        assert status.seconds_left == pytest.approx(280.0, rel=0.1)


def test_a_sample_that_the_sweep_does_not_have_is_said(batch, capfd):
    shutil.copytree(batch.place(1), batch.place(2))
    for arguments in (["status"], ["index"], [str(batch.path.parent / "sweep.toml"), "-o"]):
        said = refused(capfd, *arguments, str(batch.path))
        assert f"{batch.place(2)} is of another batch, as this one has 2; take it away." in said
