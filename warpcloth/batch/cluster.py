"""Jobs on a Ray cluster. Nodes need no disk in common: what they write comes back and is put in place here."""

import signal
import socket
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from ..errors import InputError, SimulationError
from .extra import needed
from .folder import BatchFolder
from .job import Job, Outcome, fail
from .queue import Queue
from .sweep import Sweep

LOOK = 0.5  # [s] between looks at the clock
ANSWER = 10.0  # [s] that a cluster has to answer
PATIENCE = 3  # deaths of a task with one and the same sample alone, after which the sample has failed

Written = tuple[Outcome, dict[str, bytes]]


class Cluster:
    """A connection to a Ray cluster.

    Args:
        address: of the cluster: "auto", "host:6379", or "local" for one on this machine.

    Raises:
        InputError: there is no cluster at that address.
        MissingExtraError: Ray is not installed.
    """

    def __init__(self, address: str):
        self.ray = needed("ray", "cluster")
        self._ours = not self.ray.is_initialized()
        if self._ours:
            _knock(address)
            at_term = signal.getsignal(signal.SIGTERM)
            try:
                self.ray.init(address=address, log_to_driver=False, logging_level="ERROR", ignore_reinit_error=True)
            except (ConnectionError, ValueError, RuntimeError) as error:
                reason = str(error).strip().splitlines()[0].rstrip(".")
                raise InputError(f"There is no Ray cluster at {address!r}: {reason}.") from error
            finally:  # Ray takes the signal in order to exit at once; a batch stops cleanly, and its caller has a say
                if threading.current_thread() is threading.main_thread():
                    signal.signal(signal.SIGTERM, at_term)

    @property
    def processors(self) -> int:
        """Of all nodes."""
        return int(self.ray.cluster_resources().get("CPU", 0))

    @property
    def gpus(self) -> int:
        """Of all nodes."""
        return int(self.ray.cluster_resources().get("GPU", 0))

    @property
    def memory(self) -> int:
        """Of the largest node [bytes]."""
        return int(max((node["Resources"].get("memory", 0) for node in self.ray.nodes() if node["Alive"]), default=0))

    def close(self) -> None:
        """Leaves the cluster, if it was joined here."""
        if self._ours:
            self.ray.shutdown()


def _knock(address: str) -> None:
    """Looks whether anybody answers: Ray tries for many minutes, and logs each try.

    Raises:
        InputError: nobody does, or it is no address.
    """
    if address in ("auto", "local"):
        return
    try:
        place = urlsplit(f"//{address}")
        host, port = place.hostname, place.port
    except ValueError:
        host = port = None
    if not host or not port:
        raise InputError(f"A Ray cluster's address is auto, local, or one such as host:6379, not {address!r}.")
    try:
        socket.create_connection((host, port), timeout=ANSWER).close()
    except OSError as error:
        raise InputError(f"There is no Ray cluster at {address!r}: {error.strerror or error}.") from error


class ClusterPool:
    """Simulates samples with tasks of a cluster.

    Args:
        cluster: the connection.
        sweep: whose samples.
        folder: where they go; this process holds its lock.
        queue: what is to be done.
        tasks: most jobs in flight.
    """

    def __init__(self, cluster: Cluster, sweep: Sweep, folder: BatchFolder, queue: Queue, tasks: int):
        self.ray, self.sweep, self.folder, self.queue, self.tasks = cluster.ray, sweep, folder, queue, tasks
        self.deaths: dict[int, int] = {}
        limits, device = sweep.table.limits, sweep.base["simulation"]["device"]
        needs: dict[str, Any] = {"num_cpus": 1, "max_retries": 0}
        if device.startswith("cuda") or (device == "auto" and cluster.gpus):
            needs["num_gpus"] = 1
        if limits.memory_mib is not None and limits.memory_mib * 2**20 <= cluster.memory:  # else it waits for ever
            needs["memory"] = int(limits.memory_mib * 2**20)
        self.task = self.ray.remote(simulate_here).options(**needs)
        self.text = self.ray.put(sweep.as_json())

    def run(self) -> Iterator[Outcome | None]:
        """Yields each outcome as it comes, and None in between, so that the caller can look at the clock.

        Raises:
            SimulationError: a task has a defect, or cannot write on its node.
        """
        flying: dict[Any, list[int]] = {}
        try:
            while self.queue or flying:
                while self.queue and len(flying) < self.tasks:
                    job = self.queue.take()
                    flying[self.task.remote(self.text, job)] = job
                landed, _ = self.ray.wait(list(flying), timeout=LOOK)
                for reference in landed:
                    yield from self._land(reference, flying.pop(reference))
                yield None
        finally:
            for reference in flying:
                self.ray.cancel(reference, force=True)

    def _land(self, reference: Any, job: list[int]) -> Iterator[Outcome]:
        errors = self.ray.exceptions
        try:
            written: list[Written] = self.ray.get(reference)
        except errors.RayTaskError as error:
            raise SimulationError(f"A task on the cluster cannot go on: {error.cause}.") from error
        except errors.RayError as error:  # its process or its node died
            yield from self._lose(job, type(error).__name__)
            return
        for outcome, files in written:
            partial = self.folder.new_partial(outcome.index)
            for name, data in files.items():
                (partial / name).write_bytes(data)
            self.folder.publish(partial, outcome.index)
            yield outcome

    def _lose(self, job: list[int], error: str) -> Iterator[Outcome]:
        """The samples of a task that died go back to the queue, in smaller groups; one alone fails in the end."""
        if len(job) == 1:
            self.deaths[job[0]] = self.deaths.get(job[0], 0) + 1
            if self.deaths[job[0]] >= PATIENCE:
                reason = f"The task that simulated it died {PATIENCE} times ({error})."
                fail(self.folder, self.sweep.sample(job[0]), reason)
                yield Outcome(job[0], reason, 0.0)
                return
        self.queue.put_back(job)


def simulate_here(text: str, indices: list[int]) -> list[Written]:
    """A task: simulates samples of the sweep in ``text`` on a node; each outcome with the files of its folder."""
    from .worker import quiet_warp, ready_kernels

    sweep = Sweep.from_json(text)
    quiet_warp()
    ready_kernels(sweep.base["simulation"])
    written: list[Written] = []
    with tempfile.TemporaryDirectory(prefix="warpcloth-") as scratch:
        folder = BatchFolder(Path(scratch) / "batch")
        folder.claim(sweep)

        def keep(outcome: Outcome) -> None:
            files = folder.place(outcome.index).iterdir()
            written.append((outcome, {file.name: file.read_bytes() for file in files}))

        Job(sweep, folder, lambda: None, keep).run(indices)
    return written
