"""The folder of a batch. What stands under ``samples`` is complete, and is all that is known of how far it has come."""

import contextlib
import json
import os
import re
import secrets
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from .. import __version__
from ..errors import InputError
from ..validate import at_home
from .extra import needed
from .recorder import METRICS
from .sweep import Sweep

SWEEP = "sweep.json"
LOCK = ".lock"
OWN = (LOCK, f".{SWEEP}")  # with what begins so a folder is as good as empty
DIGITS = 6
GLANCE = 1.0  # [s]; whoever has the lock for longer is at work
SPARE = 64 * 2**20  # bytes that must be free on the disk beyond what the samples need


class BusyError(InputError):
    """Another batch is at work in the folder."""


class BatchFolder:
    """A folder with a sweep and those of its samples that are complete.

    Attributes:
        path: the folder. samples: where complete samples are. partial: where samples grow.
        begun: an empty file, as old as the latest run that had something to do.
        stale: another one, which is there while manifest, assembly and picture may lack samples.
    """

    def __init__(self, path: str | Path):
        self.path = at_home(path).absolute()
        self.samples, self.partial = self.path / "samples", self.path / ".partial"
        self.begun, self.stale = self.path / ".begun", self.path / ".stale"

    @property
    def sweep(self) -> Sweep:
        """The sweep that the folder belongs to.

        Raises:
            InputError: it is not the folder of a batch.
        """
        facts = self._facts()
        try:
            return Sweep.from_json(json.dumps(facts))
        except ValueError:
            version = f"is of warpcloth {facts['version']}, and this is {__version__}, or it is damaged"
            raise InputError(f"{self.path / SWEEP} cannot be used: it {version}.") from None

    def _facts(self) -> dict[str, Any]:
        """What the folder says of its sweep."""
        if not (self.path / SWEEP).is_file():
            raise InputError(f"{self.path} is not the folder of a batch: it has no {SWEEP}.")
        kinds = {"format": int, "version": str, "name": str, "folder": str, "sweep": dict, "scene": dict}
        try:
            return read_tables(self.path / SWEEP, kinds)
        except ValueError as error:
            raise InputError(f"{self.path / SWEEP} {error}; bring it back, or give another folder.") from None

    def check(self, sweep: Sweep) -> None:
        """Finds that the folder belongs to this very sweep, or could, and that its samples are sound; writes nothing.

        Raises:
            InputError: it belongs to another sweep, holds something else, is damaged, or cannot be written to.
        """
        with self.writing():
            there = next(path for path in (self.path, *self.path.parents) if path.exists())
        if not there.is_dir():
            raise InputError(f"{there} is a file, so {self.path} cannot be a folder; give another one with -o.")
        if not os.access(there, os.W_OK | os.X_OK):
            raise InputError(f"The folder {there} cannot be written to: permission denied.")
        if (self.path / SWEEP).exists():
            self._refuse_another(sweep)
        elif there == self.path and any(not item.name.startswith(OWN) for item in self.path.iterdir()):
            raise InputError(f"The folder {self.path} is not empty and not of a batch; give another one with -o.")
        for _ in self.all_metrics(sweep.count):
            pass

    def all_metrics(self, count: int) -> Iterator[dict[str, Any]]:
        """The :meth:`metrics` of all finished samples of a sweep of so many.

        Raises:
            InputError: one is damaged, or there are more.
        """
        for index in self.finished():
            if index >= count:
                raise InputError(f"{self.place(index)} is of another batch, as this one has {count}; take it away.")
            yield self.metrics(index)

    def claim(self, sweep: Sweep) -> None:
        """Makes the folder, or finds that it belongs to this very sweep; see :meth:`check`."""
        self.check(sweep)
        with self.writing():
            self.path.mkdir(parents=True, exist_ok=True)
            if not (self.path / SWEEP).exists():
                write_whole(self.path / SWEEP, sweep.as_json())
            self.samples.mkdir(exist_ok=True)
            self.partial.mkdir(exist_ok=True)

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Says in a sentence what the file system refuses within the block.

        Raises:
            InputError: it refuses something.
        """
        try:
            yield
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise InputError(f"The folder {self.path} cannot be written to: {reason}.") from error

    def _refuse_another(self, sweep: Sweep) -> None:
        ours, theirs = json.loads(sweep.as_json()), self._facts()
        if ours == theirs:
            return
        if ours["version"] != theirs["version"] or ours["format"] != theirs["format"]:
            what = f"was begun by warpcloth {theirs['version']}, and this is {ours['version']}"
        elif ours["name"] != theirs["name"] or ours["folder"] != theirs["folder"]:
            what = f"belongs to another sweep, {theirs['name']}.toml in {theirs['folder']}"
        elif ours["scene"] != theirs["scene"] or ours.get("own") != theirs.get("own"):
            what = f"was begun with another state of the scene {ours['sweep']['scene']!r}"
        else:
            keys = ours["sweep"].keys() | theirs["sweep"].keys()
            changed = [key for key in sorted(keys) if ours["sweep"].get(key) != theirs["sweep"].get(key)]
            what = f"was begun with another state of {ours['name']}.toml ({', '.join(changed)} differ)"
        raise InputError(f"The folder {self.path} {what}; give another folder with -o, or undo the change.")

    @contextlib.contextmanager
    def locked(self, patience: float = GLANCE) -> Iterator[None]:
        """Keeps other batches out for as long as this process lives.

        Args:
            patience: how long to wait for whoever has it [s]; one who only looks at it has it for a moment, too.

        Raises:
            InputError: another batch is at work in the folder, or it cannot be written to.
        """
        filelock = needed("filelock")
        lock = filelock.FileLock(self.path / LOCK)
        with self.writing():
            self.path.mkdir(parents=True, exist_ok=True)
            try:
                lock.acquire(timeout=patience)
            except filelock.Timeout:
                raise BusyError(f"Another batch is at work in {self.path}; wait for it, or stop it.") from None
        try:
            yield
        finally:
            lock.release()

    @property
    def busy(self) -> bool:
        """Whether a batch is at work in the folder, as far as somebody who may only read it can tell."""
        try:
            with self.locked(patience=0.0):
                return False
        except InputError as error:
            return isinstance(error, BusyError)

    def finished(self) -> list[int]:
        """Numbers of the samples that are complete, failed ones included, in rising order."""
        names = [item.name for item in os.scandir(self.samples)] if self.samples.is_dir() else []
        return sorted(int(name) for name in names if re.fullmatch(f"[0-9]{{{DIGITS},}}", name))

    def place(self, index: int) -> Path:
        """Where the sample goes when it is complete."""
        return self.samples / f"{index:0{DIGITS}d}"

    def metrics(self, index: int) -> dict[str, Any]:
        """What is known of a complete sample.

        Raises:
            InputError: it is damaged.
        """
        place = self.place(index)
        try:
            facts = read_tables(place / METRICS, {"status": str, "parameters": dict, "files": dict})
            wrong = [key for key in ("inputs", "metrics") if not isinstance(facts.get(key, {}), dict)]
            if wrong:
                raise ValueError(f"has no usable {wrong[0]!r} in it")
            lost = [name for name in facts["files"] if not (place / name).is_file()]
            if lost:
                raise ValueError(f"names {lost[0]}, which is not there")
            return facts
        except ValueError as error:
            rule = f"remove the folder {place}, and the batch makes the sample again"
            raise InputError(f"Sample {index} is damaged: its {METRICS} {error}; {rule}.") from None

    def new_partial(self, index: int) -> Path:
        """An empty folder for a sample to grow in."""
        folder = self.partial / f"{index:0{DIGITS}d}-{os.getpid()}-{secrets.token_hex(4)}"
        folder.mkdir(parents=True)
        return folder

    def publish(self, partial: Path, index: int) -> None:
        """Moves a complete sample into place in one step; does nothing if it is there already."""
        for item in (*partial.iterdir(), partial):
            flush(item)
        try:
            os.rename(partial, self.place(index))
        except OSError:
            if not self.place(index).is_dir():
                raise
            shutil.rmtree(partial, ignore_errors=True)  # somebody else was first, with the same bytes
        flush(self.samples)

    def sweep_up(self) -> None:
        """Removes what samples left that were not completed."""
        for item in self.partial.iterdir() if self.partial.is_dir() else ():
            shutil.rmtree(item, ignore_errors=True)

    def failed(self) -> list[int]:
        """Numbers of the samples that have failed, in rising order."""
        return [index for index in self.finished() if self.metrics(index)["status"] == "failed"]

    def forget_failed(self) -> None:
        """Takes failed samples out again, so that they are tried once more."""
        for index in self.failed():
            os.rename(self.place(index), self.partial / f"{self.place(index).name}-failed-{secrets.token_hex(4)}")
        self.sweep_up()

    def check_space(self, wanted: int) -> None:
        """Refuses to begin on a disk that has no room for ``wanted`` bytes.

        Raises:
            InputError: it has not.
        """
        free = shutil.disk_usage(self.path).free
        if free < wanted + SPARE:
            raise InputError(
                f"The disk of {self.path} has {free / 2**20:,.0f} MiB free, and the samples need about "
                f"{wanted / 2**20:,.0f} MiB; make room, or give another folder with -o."
            )


def read_tables(path: Path, kinds: Mapping[str, type]) -> dict[str, Any]:
    """What a JSON file holds, with what it must have at least by name and kind.

    Raises:
        ValueError: it does not; the message reads on from the name of the file.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"cannot be read ({(error.strerror or str(error)).lower()})") from error
    except ValueError as error:
        raise ValueError("is not JSON") from error
    lacking = [key for key, kind in kinds.items() if not isinstance(data, dict) or not isinstance(data.get(key), kind)]
    if lacking:
        raise ValueError(f"has no {lacking[0]!r} in it")
    return data


def write_whole(path: Path, text: str) -> None:
    """A text file that is there with all of its text or not at all."""
    partial = path.with_name(f".{path.name}")
    partial.write_text(text, encoding="utf-8")
    flush(partial)
    os.replace(partial, path)


def flush(path: Path) -> None:
    """Has the disk hold what the file or folder holds."""
    if path.is_dir() and os.name != "posix":  # Windows cannot open a folder
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
