"""Batches whose workers take too much, or die: who is to blame, and that the others go on."""

import mmap
import multiprocessing
import os
import time
from types import SimpleNamespace

import psutil
import pytest
from batch_sweeps import SWEEP, written

from warpcloth.batch import load_sweep, pool, run
from warpcloth.batch.folder import BatchFolder
from warpcloth.batch.job import Outcome, fail
from warpcloth.batch.plan import make_plan
from warpcloth.batch.run import run_batch
from warpcloth.errors import InputError, SimulationError

MIB = 2**20


class Doomed(pool.Worker):
    """A worker that is over a limit, or dies, as soon as it has a job; without a process."""

    memory, begins = 400 * MIB, True

    def __init__(self, folder, gpu, threads):
        self.connection, self.other = multiprocessing.Pipe()
        self.process = SimpleNamespace(join=lambda: None, kill=self.other.close, exitcode=-9)
        self.gpu, self.job, self.idle, self.ended_for, self.heard = gpu, [], False, None, time.monotonic()
        self.folder, self.looks = folder, 0
        if self.begins:
            self.other.send(("idle", None))
        else:
            self.other.close()


@pytest.mark.parametrize("workers", [1, 7])
def test_samples_over_the_limit_of_memory_fail_one_by_one(tmp_path, monkeypatch, workers):
    monkeypatch.setattr(pool, "Worker", Doomed)
    monkeypatch.setattr(pool, "LOOK", 1e-3)
    path = written(tmp_path, SWEEP.replace("count = 6", "count = 100") + "[limits]\nmemory_mib = 150\n")
    status = run_batch(load_sweep(path), tmp_path / "batch", workers=workers)
    assert status.reasons == {"It needed more than 150 MiB of memory.": 100}
    assert BatchFolder(tmp_path / "batch").finished() == list(range(100))


def test_workers_that_cannot_begin_end_the_batch(tmp_path, monkeypatch):
    monkeypatch.setattr(pool, "Worker", type("Stillborn", (Doomed,), {"begins": False}))
    with pytest.raises(SimulationError, match=r"Workers die before they begin anything \(exit code -9\)"):
        run_batch(load_sweep(written(tmp_path)), tmp_path / "batch", workers=2)


def test_a_full_disk_is_said_rather_than_that_the_index_has_no_room_either(tmp_path, monkeypatch):
    def refuse(folder):
        raise InputError("Cannot write contact_sheet.png: No space left on device.")

    monkeypatch.setattr(pool, "Worker", type("Stillborn", (Doomed,), {"begins": False}))
    monkeypatch.setattr(run, "index_batch", refuse)
    with pytest.raises(SimulationError, match=r"Workers die before they begin anything"):
        run_batch(load_sweep(written(tmp_path)), tmp_path / "batch", workers=2)
    assert BatchFolder(tmp_path / "batch").stale.exists()


def test_memory_that_is_shared_counts_for_nobody(tmp_path):
    """Such as that of libraries; 64 MiB of a mapped file here."""
    worker = SimpleNamespace(process=SimpleNamespace(pid=os.getpid()))
    (tmp_path / "library").write_bytes(bytes(64 * MIB))
    before = pool.Worker.memory.fget(worker)
    with open(tmp_path / "library", "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
        assert sum(mapped[:: mmap.PAGESIZE]) == 0
        assert pool.Worker.memory.fget(worker) < before + 16 * MIB
    own = bytearray(os.urandom(64 * MIB))
    assert pool.Worker.memory.fget(worker) > before + 48 * MIB
    del own


class Large(Doomed):
    """A worker that is done with its job when its memory has been looked at three times; two samples take much."""

    @property
    def memory(self):
        self.looks += bool(self.job)
        if self.looks == 3:
            for index in self.job:
                fail(self.folder, self.folder.sweep.sample(index), "Simulated.")
                self.other.send(("outcome", Outcome(index, "Simulated.", 0.0)))
            self.other.send(("idle", None))
            self.looks = 0
        return (1200 if 3 in self.job else 950 if 5 in self.job else 100) * MIB


@pytest.mark.parametrize("workers", [1, 4, 30])
def test_memory_for_all_is_shared_without_blaming_a_sample(tmp_path, monkeypatch, workers):
    total = psutil.virtual_memory().total
    monkeypatch.setattr(pool, "Worker", Large)
    monkeypatch.setattr(pool, "LOOK", 1e-3)
    monkeypatch.setattr(pool, "SHARE", 1000 * MIB / total)
    sweep = load_sweep(written(tmp_path, SWEEP.replace("count = 6", "count = 30")))
    status = run_batch(sweep, tmp_path / "batch", workers=workers, worlds=1)
    assert status.reasons == {"Simulated.": 29, "It needed more than 1,000 MiB of memory.": 1}
    assert "It needed" in BatchFolder(tmp_path / "batch").metrics(3)["reason"]


def test_no_more_processes_are_planned_than_samples(tmp_path):
    plan = make_plan(load_sweep(written(tmp_path)), BatchFolder(tmp_path / "batch"), workers=80, worlds=None)
    assert (plan.workers, plan.samples) == (6, 6)


def test_a_worker_that_says_nothing_beyond_its_time_is_ended(tmp_path, monkeypatch):
    """As one does that hangs in a single frame, where it cannot look at the clock itself."""
    monkeypatch.setattr(Doomed, "memory", 0)
    table = SWEEP.replace("count = 6", "count = 1") + "[limits]\nseconds = 5\n"
    doomed = pool.LocalPool(load_sweep(written(tmp_path, table)), BatchFolder(tmp_path), None, workers=1)
    doomed.workers = [silent, heard, idle] = [Doomed(doomed.folder, None, 1) for _ in range(3)]
    silent.job, heard.job = [0], [1]
    silent.heard -= 5.0 + pool.GRACE + 1.0
    heard.heard -= 5.0
    idle.heard -= 1e3
    doomed._enforce_limits()
    assert [worker.ended_for for worker in (silent, heard, idle)] == ["It took longer than 5 s.", None, None]
