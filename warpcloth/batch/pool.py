"""Many workers on this machine: who does what, and what happens to the work of those that die."""

import contextlib
import multiprocessing
import signal
import time
from collections.abc import Iterator
from multiprocessing import resource_tracker
from multiprocessing.connection import wait
from typing import Any

from ..errors import SimulationError
from ..program import cores
from .extra import needed
from .folder import BatchFolder
from .job import Outcome, fail
from .queue import Queue
from .sweep import Sweep
from .worker import serve

LOOK = 0.5  # [s] between looks at the workers' memory and time
GRACE = 30.0  # [s] beyond a sample's own limit before a worker that says nothing is ended
PATIENCE = 3  # deaths of a worker with one and the same sample alone, after which the sample has failed
SHARE = 0.9  # of the machine's memory, which all workers together may take
FUTILE = 20  # deaths of workers in a row that had not begun, after which the batch gives up


class Worker:
    """A process, and the samples it is at.

    Args:
        folder: of the batch.
        gpu: number of the GPU that it shall see; None for all there are.
        threads: cores of the CPU that are there for it.
    """

    def __init__(self, folder: BatchFolder, gpu: int | None, threads: int):
        context = multiprocessing.get_context("spawn")
        self.connection, other = context.Pipe()
        self.process = context.Process(target=serve, args=(other, str(folder.path), gpu, threads), daemon=True)
        with _deaf_children():
            self.process.start()
        other.close()
        self.gpu = gpu
        self.job: list[int] = []
        self.idle = False  # ready for a job; a new process is not yet
        self.ended_for: str | None = None  # why, once it was ended: for what limit, or "" where no sample is to blame
        self.heard = time.monotonic()

    @property
    def memory(self) -> int:
        """Resident memory of its own [bytes]; 0 once it is gone. Files that are mapped, such as libraries, are left out
        where the system tells: all workers share them, and nothing in a sample makes them smaller."""
        psutil = needed("psutil")
        try:
            taken = psutil.Process(self.process.pid).memory_info()
        except psutil.Error:
            return 0
        return taken.rss - getattr(taken, "shared", 0)

    def give(self, job: list[int]) -> None:
        """Sends it samples to simulate."""
        self.job, self.idle, self.heard = list(job), False, time.monotonic()
        self.connection.send(job)

    def end(self, why: str = "") -> None:
        """Ends the process at once; what it was writing stays in the partial folder."""
        if self.ended_for is None:
            self.ended_for = why
        self.process.kill()


@contextlib.contextmanager
def _deaf_children() -> Iterator[None]:
    """Ctrl-C, which reaches the whole group, does not reach processes that are started inside: for a second or two they
    could only answer it with a traceback. What it brings this process waits as long."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # which would let Ctrl-C through again as it begins
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class LocalPool:
    """Simulates samples with processes of this machine.

    Args:
        sweep: whose samples.
        folder: where they go; this process holds its lock.
        queue: what is to be done.
        workers: number of processes.
        gpus: number of GPUs to divide among them; 0 leaves that to the scene.
    """

    def __init__(self, sweep: Sweep, folder: BatchFolder, queue: Queue, workers: int, gpus: int = 0):
        self.sweep, self.folder, self.queue = sweep, folder, queue
        self.wanted, self.gpus = workers, gpus
        self.workers: list[Worker] = []
        self.deaths: dict[int, int] = {}
        self.futile = 0
        limits = sweep.table.limits
        self.seconds = limits.seconds
        self.room = SHARE * needed("psutil").virtual_memory().total
        self.memory = self.room if limits.memory_mib is None else limits.memory_mib * 2**20

    def run(self) -> Iterator[Outcome | None]:
        """Yields each outcome as it comes, and None in between, so that the caller can look at the clock.

        Raises:
            SimulationError: nothing can be written any more, or workers die without end.
        """
        try:
            while self.queue or any(worker.job for worker in self.workers):
                self._hire()
                for outcome in self._listen():
                    self.futile = 0
                    yield outcome
                self._enforce_limits()
                yield None
        finally:
            for worker in self.workers:
                worker.end()
            for worker in self.workers:
                worker.process.join()

    def _hire(self) -> None:
        """As many workers as there is work for; work for those that have none."""
        busy = sum(bool(worker.job) for worker in self.workers)
        while len(self.workers) < min(self.wanted, busy + len(self.queue)):
            seen = {worker.gpu for worker in self.workers}
            free = [gpu for gpu in range(self.gpus) if gpu not in seen] or [len(self.workers) % max(1, self.gpus)]
            self.workers.append(Worker(self.folder, free[0] if self.gpus else None, max(1, cores() // self.wanted)))
        for worker in self.workers:
            if worker.idle and self.queue:
                job = self.queue.take()
                try:
                    worker.give(job)
                except OSError:  # it has died, which _listen finds out; it has the job as long as that
                    continue

    def _listen(self) -> Iterator[Outcome]:
        connections: dict[Any, Worker] = {worker.connection: worker for worker in self.workers}
        for connection in wait(list(connections), timeout=LOOK):
            worker = connections[connection]
            try:
                while worker.connection.poll():
                    yield from self._hear(worker, *worker.connection.recv())
            except (EOFError, OSError):
                yield from self._bury(worker)

    def _hear(self, worker: Worker, what: str, message: Any) -> Iterator[Outcome]:
        worker.heard = time.monotonic()
        if what == "broken":
            raise SimulationError(message)
        if what == "outcome":
            worker.job.remove(message.index)
            yield message
        if what == "idle":
            worker.job, worker.idle = [], True

    def _enforce_limits(self) -> None:
        taken = {worker: worker.memory for worker in self.workers if worker.ended_for is None}
        for worker in taken:
            if worker.job and taken[worker] > self.memory:
                worker.end(f"It needed more than {self.memory / 2**20:,.0f} MiB of memory.")
            elif worker.job and self.seconds is not None and time.monotonic() - worker.heard > self.seconds + GRACE:
                worker.end(f"It took longer than {self.seconds:g} s.")
        alive = {worker: memory for worker, memory in taken.items() if worker.ended_for is None}
        if len(alive) > 1 and sum(alive.values()) > self.room:  # too many for this machine
            self.wanted = len(alive) - 1
            max(alive, key=alive.__getitem__).end()

    def _bury(self, worker: Worker) -> Iterator[Outcome]:
        """The samples of a worker that died go back to the queue, in smaller groups; one alone fails in the end."""
        self.workers.remove(worker)
        worker.process.join()
        if not worker.job and worker.ended_for is None:  # jobs get smaller with each death, so they come to an end
            self.futile += 1
        if self.futile > FUTILE:
            raise SimulationError(f"Workers die before they begin anything (exit code {worker.process.exitcode}).")
        left = []
        for index in worker.job:
            if self.folder.place(index).is_dir():  # it died before it could say so
                yield Outcome(index, self.folder.metrics(index).get("reason"), 0.0)
            else:
                left.append(index)
        reason = self._verdict(worker, left)
        if reason:
            fail(self.folder, self.sweep.sample(left[0]), reason)
            yield Outcome(left[0], reason, 0.0)
        elif worker.ended_for == "":
            self.queue.postpone(left)
        else:
            self.queue.put_back(left)

    def _verdict(self, worker: Worker, left: list[int]) -> str:
        """Why the one sample left has failed, if it has."""
        if len(left) != 1:
            return ""
        if worker.ended_for is not None:
            return worker.ended_for
        self.deaths[left[0]] = self.deaths.get(left[0], 0) + 1
        if self.deaths[left[0]] < PATIENCE:
            return ""
        return f"The process that simulated it died {PATIENCE} times (exit code {worker.process.exitcode})."
