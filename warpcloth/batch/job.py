"""A job: some samples of a sweep simulated in this process, each of which ends complete or with its reason."""

import shutil
import warnings
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..errors import UsdError, WarpclothError
from .folder import BatchFolder
from .group import Group, Member
from .prepared import Prepared, prepare
from .recorder import Recorder, write_failure
from .sweep import Sample, Sweep


@dataclass(frozen=True)
class Outcome:
    """How a sample ended.

    Attributes:
        index: the sample. reason: why it failed; None if it did not. seconds: its share of the wall time [s].
    """

    index: int
    reason: str | None
    seconds: float


class Job:
    """Samples simulated here.

    Args:
        sweep: whose samples.
        folder: where they go.
        on_frame: called after each frame, and between samples.
        on_outcome: called when a sample is in its place.
        threads: cores of the CPU that are there for it.
    """

    def __init__(
        self,
        sweep: Sweep,
        folder: BatchFolder,
        on_frame: Callable[[], None],
        on_outcome: Callable[[Outcome], None],
        threads: int = 1,
    ):
        self.sweep, self.folder, self.threads = sweep, folder, threads
        self.on_frame, self.on_outcome = on_frame, on_outcome

    def run(self, indices: Sequence[int]) -> None:
        """Simulates samples, as many together as can share a model.

        Raises:
            UsdError, OSError: nothing can be written any more. All other errors are those of a sample.
        """
        companions = defaultdict(list)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of steps and contacts: metrics tell, sample by sample
            for index in indices:
                prepared = self._prepare(index)
                if prepared is not None:
                    companions[prepared.companions].append(prepared)
                self.on_frame()
            for group in companions.values():
                self._simulate(group)

    def _prepare(self, index: int) -> Prepared | None:
        sample = self.sweep.sample(index)
        try:
            return prepare(sample)
        except Exception as error:
            self._fail(sample, error, 0.0)
            return None

    def _simulate(self, samples: Sequence[Prepared]) -> None:
        """All of them, whatever happens: those that fail do so alone, so that their neighbours have no part in it."""
        members = [Member(prepared, self._recorder(prepared)) for prepared in samples]
        done: set[int] = set()
        group: list[Group] = []
        try:
            group.append(self._group(members, done))
            group[0].run()
        except (UsdError, OSError):
            raise
        except Exception as error:
            current = group[0].members if group else members
            left = [member for member in members if member.prepared.sample.index not in done]
            if len(members) == 1 and left:
                self._fail(samples[0].sample, error, members[0].seconds)
            else:
                to_blame = [current[w] for w in getattr(error, "worlds", ())]
                self._apart(
                    [m.prepared for m in left if m in to_blame], [m.prepared for m in left if m not in to_blame]
                )
        finally:
            for member in members:
                if member.prepared.sample.index not in done:
                    member.recorder.abandon()
                    shutil.rmtree(member.recorder.folder, ignore_errors=True)

    def _apart(self, to_blame: Sequence[Prepared], others: Sequence[Prepared]) -> None:
        """Again, without each other: those to blame one by one; where nobody is known to be, in halves."""
        for prepared in to_blame:
            self._simulate([prepared])
        middle = len(others) if to_blame else (len(others) + 1) // 2
        for part in (others[:middle], others[middle:]):
            if part:
                self._simulate(part)

    def _group(self, members: Sequence[Member], done: set[int]) -> Group:
        def end(member: Member) -> None:
            index = member.prepared.sample.index
            self.folder.publish(member.recorder.folder, index)
            done.add(index)
            self.on_outcome(Outcome(index, None, member.seconds))

        table = self.sweep.table
        return Group(
            members,
            stop_at_rest=table.stop_at_rest,
            seconds=table.limits.seconds,
            threads=self.threads,
            on_frame=self.on_frame,
            on_end=end,
        )

    def _recorder(self, prepared: Prepared) -> Recorder:
        return Recorder(prepared, self.folder.new_partial(prepared.sample.index), self.sweep.table)

    def _fail(self, sample: Sample, error: Exception, seconds: float) -> None:
        fail(self.folder, sample, reason_of(error))
        self.on_outcome(Outcome(sample.index, reason_of(error), seconds))


def fail(folder: BatchFolder, sample: Sample, reason: str) -> None:
    """Puts a sample that failed into its place."""
    partial = folder.new_partial(sample.index)
    write_failure(partial, sample, reason)
    folder.publish(partial, sample.index)


def reason_of(error: Exception) -> str:
    """An error as one sentence."""
    text = " ".join(str(error).split())
    if isinstance(error, MemoryError) or "allocat" in text.lower():
        return "There was not enough memory for it; lower its resolution, or take a coarser mesh."
    if isinstance(error, WarpclothError):
        return text
    return f"{type(error).__name__}: {text}"
