"""Batches whose workers take too much, or die: who is to blame, and that the others go on."""

import multiprocessing
import time
from types import SimpleNamespace

import pytest
from batch_sweeps import SWEEP, written

from warpcloth.batch import load_sweep, pool
from warpcloth.batch.folder import BatchFolder
from warpcloth.batch.run import run_batch
from warpcloth.errors import SimulationError

MIB = 2**20


class Doomed(pool.Worker):
    """A worker that is over a limit, or dies, as soon as it has a job; without a process."""

    memory, begins = 400 * MIB, True

    def __init__(self, folder, gpu, threads):
        self.connection, self.other = multiprocessing.Pipe()
        self.process = SimpleNamespace(join=lambda: None, kill=self.other.close, exitcode=-9)
        self.gpu, self.job, self.idle, self.ended_for, self.heard = gpu, [], False, "", time.monotonic()
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
