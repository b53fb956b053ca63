"""A batch from beginning to end, and what can be said of one at any time."""

import contextlib
import time
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..errors import MissingExtraError, MixedBatchWarning, WarpclothError
from ..render.paint import pyvista
from ..scenes.interrupt import StopRequest, stop_on_interrupt
from .assembly import write_assembly
from .cluster import Cluster, ClusterPool
from .extra import needed
from .folder import BatchFolder
from .inputs import hash_of
from .job import Outcome
from .manifest import PARQUET, write_manifest
from .plan import Plan, make_plan
from .pool import LocalPool
from .queue import Queue
from .sheet import write_sheet
from .sweep import Sweep

INDEXING = ".index.lock"


@dataclass(frozen=True)
class Status:
    """How far a batch is.

    Attributes:
        folder: of the batch. samples: number of all. done, failed: of those that are complete.
        running: whether a batch is at work in the folder.
        samples_per_minute: in the run that is at work, or was last; None before its first sample.
        seconds_left: at that rate; None if it is not known.
        reasons: why samples failed, and how many each.
        changed: meshes and stages that are not any more what samples were made from, and of how many samples each.
    """

    folder: Path
    samples: int
    done: int
    failed: int
    running: bool
    samples_per_minute: float | None
    seconds_left: float | None
    reasons: dict[str, int]
    changed: dict[str, int]

    def as_dict(self) -> dict[str, Any]:
        """The attributes by name."""
        return asdict(self)


def run_batch(
    sweep: Sweep,
    path: str | Path,
    *,
    workers: int | None = None,
    worlds: int | None = None,
    ray: str | None = None,
    retry_failed: bool = False,
    on_progress: Callable[[Plan, Outcome | None], None] | None = None,
) -> Status:
    """Simulates what is left of a sweep.

    Args:
        sweep: the sweep; all of its samples are valid scenes.
        path: folder of the batch; made if need be.
        workers: processes, worlds: samples stepped together in each; None for what suits the machine and the scene.
        ray: address of a Ray cluster to run on, such as "auto".
        retry_failed: whether to try again what has failed before.
        on_progress: called twice a second, and with each outcome.

    Raises:
        InputError: the folder belongs to another sweep, another batch is at work in it, the disk is full, …
        SimulationError: the batch as a whole cannot go on. What is complete stays.
        KeyboardInterrupt: somebody pressed Ctrl-C, or the system asked it to end (SIGTERM). What is complete stays.
    """
    folder = BatchFolder(path)
    folder.check(sweep)
    with stop_on_interrupt() as request, contextlib.ExitStack() as exits:
        if "preview" in sweep.table.outputs:
            pyvista()  # before any work
        cluster = None
        if ray is not None:
            cluster = Cluster(ray)
            exits.callback(cluster.close)
            workers = workers or max(1, cluster.processors)
        exits.enter_context(folder.locked())
        folder.claim(sweep)
        with folder.writing():
            folder.sweep_up()
            if retry_failed:
                folder.forget_failed()
            plan = _begin(sweep, folder, workers, worlds)
        with _completing(folder, request):
            for outcome in _outcomes(sweep, folder, plan, cluster):
                if on_progress is not None:
                    on_progress(plan, outcome)
        return status_of(folder, running=False)


def _begin(sweep: Sweep, folder: BatchFolder, workers: int | None, worlds: int | None) -> Plan:
    """What is to be done, if there is room for it; notes that it has begun."""
    plan = make_plan(sweep, folder, workers, worlds)
    folder.check_space(plan.bytes)
    changed = {file for index in folder.finished() for file in _changed(folder.metrics(index))}
    if changed and plan.left:
        warnings.warn(
            f"{_names(changed)} changed since samples in {folder.path} were made, and those that are left are "
            "made of the new state; remove the folders of the others to have them made again, too.",
            MixedBatchWarning,
            stacklevel=3,
        )
    if plan.left:
        folder.begun.touch()
        folder.stale.touch()
    return plan


@contextlib.contextmanager
def _completing(folder: BatchFolder, request: StopRequest) -> Iterator[None]:
    """Leaves a folder as it is to be found, however what happens inside ends: nothing half, and all that is complete in
    its index."""

    def complete() -> None:
        request.waits = True  # for all of the index, whoever presses Ctrl-C once more
        folder.sweep_up()
        if folder.stale.exists() or not (folder.path / PARQUET).exists():
            index_batch(folder)
            folder.stale.unlink(missing_ok=True)

    try:
        yield
    except WarpclothError:
        with contextlib.suppress(WarpclothError):  # what has led here is what the user should hear of
            complete()
        raise
    except BaseException:
        complete()
        raise
    complete()


def index_batch(folder: BatchFolder) -> list[Path]:
    """Writes the manifest, the assembly and the picture anew from the folders of the samples; returns what it wrote.

    There is no picture where pyvista is not installed. One that is at it already is waited for.

    Raises:
        InputError: a sample is damaged, or the folder cannot be written to.
    """
    with folder.writing(), needed("filelock").FileLock(folder.path / INDEXING):
        files = [*write_manifest(folder), write_assembly(folder)]
        with contextlib.suppress(MissingExtraError):
            files.append(write_sheet(folder))
    return [file for file in files if file is not None]


def status_of(folder: BatchFolder, running: bool | None = None) -> Status:
    """How far the batch in a folder is.

    Raises:
        InputError: it is not the folder of a batch, or a sample is damaged.
    """
    count = folder.sweep.count
    finished = folder.finished()
    reasons: Counter[str] = Counter()
    changed: Counter[str] = Counter()
    for facts in folder.all_metrics(count):
        reasons.update([str(facts.get("reason"))] if facts["status"] == "failed" else [])
        changed.update(_changed(facts))
    running = folder.busy if running is None else running
    rate = _rate(folder, finished, running)
    left = count - len(finished)
    return Status(
        folder=folder.path,
        samples=count,
        done=len(finished) - reasons.total(),
        failed=reasons.total(),
        running=running,
        samples_per_minute=None if rate is None else 60.0 * rate,
        seconds_left=0.0 if left == 0 else None if rate is None else left / rate,
        reasons=dict(reasons.most_common()),
        changed=dict(changed.most_common()),
    )


def _changed(facts: Mapping[str, Any]) -> list[str]:
    """Files that are not any more what a sample was made from."""
    return [file for file, digest in facts.get("inputs", {}).items() if hash_of(file) not in ("", digest)]


def _names(changed: Collection[str]) -> str:
    """The beginning of a sentence about files."""
    more = f" and {len(changed) - 1} more files have" if len(changed) > 1 else " has"
    return f"{min(changed)}{more}"


def _outcomes(sweep: Sweep, folder: BatchFolder, plan: Plan, cluster: Cluster | None) -> Iterator[Outcome | None]:
    finished = set(folder.finished())
    left = [index for index in range(sweep.count) if index not in finished]
    queue = Queue(left, plan.worlds, plan.workers)
    if cluster is not None:
        yield from ClusterPool(cluster, sweep, folder, queue, plan.workers).run()
    else:
        yield from LocalPool(sweep, folder, queue, plan.workers, plan.gpus).run()


def _rate(folder: BatchFolder, finished: list[int], running: bool) -> float | None:
    """Samples per second since the latest run began; worlds that end together say nothing about each other."""
    if not folder.begun.exists():
        return None
    begun = folder.begun.stat().st_mtime
    times = [moment for index in finished if (moment := folder.place(index).stat().st_mtime) >= begun]
    seconds = (time.time() if running else max(times, default=begun)) - begun
    return len(times) / seconds if times and seconds > 0.0 else None
