"""The folder of a batch. What stands under ``samples`` is complete, and is all that is known of how far it has come."""

import contextlib
import json
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..errors import InputError
from .extra import needed
from .recorder import METRICS
from .sweep import Sweep

SWEEP = "sweep.json"
LOCK = ".lock"
DIGITS = 6
SPARE = 64 * 2**20  # bytes that must be free on the disk beyond what the samples need


class BatchFolder:
    """A folder with a sweep and those of its samples that are complete.

    Attributes:
        path: the folder. samples: where complete samples are. partial: where samples grow.
        stale: a file that is there while manifest, assembly and picture may lack samples.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path).expanduser().absolute()
        self.samples, self.partial, self.stale = (self.path / name for name in ("samples", ".partial", ".stale"))

    @property
    def sweep(self) -> Sweep:
        """The sweep that the folder belongs to.

        Raises:
            InputError: it is not the folder of a batch.
        """
        try:
            return Sweep.from_json((self.path / SWEEP).read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise InputError(f"{self.path} is not the folder of a batch: it has no {SWEEP}.") from None
        except (OSError, ValueError, KeyError) as error:
            raise InputError(f"{self.path / SWEEP} cannot be read: {error}.") from error

    def claim(self, sweep: Sweep) -> None:
        """Makes the folder, or finds that it belongs to this very sweep.

        Raises:
            InputError: it belongs to another sweep, holds something else, or cannot be written to.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            if (self.path / SWEEP).exists():
                self._refuse_another(sweep)
            elif any(item.name != LOCK for item in self.path.iterdir()):
                raise InputError(f"The folder {self.path} is not empty and not of a batch; give another one with -o.")
            else:
                write_whole(self.path / SWEEP, sweep.as_json())
            self.samples.mkdir(exist_ok=True)
            self.partial.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(f"The folder {self.path} cannot be written to: {error.strerror}.") from error

    def _refuse_another(self, sweep: Sweep) -> None:
        ours, theirs = (json.loads(text) for text in (sweep.as_json(), (self.path / SWEEP).read_text("utf-8")))
        if ours == theirs:
            return
        if ours["version"] != theirs["version"] or ours["format"] != theirs["format"]:
            what = f"was begun by warpcloth {theirs['version']}, and this is {ours['version']}"
        elif ours["name"] != theirs["name"] or ours["folder"] != theirs["folder"]:
            what = f"belongs to another sweep, {theirs['name']}.toml in {theirs['folder']}"
        elif ours["scene"] != theirs["scene"]:
            what = f"was begun with another state of the scene {ours['sweep']['scene']!r}"
        else:
            keys = ours["sweep"].keys() | theirs["sweep"].keys()
            changed = [key for key in sorted(keys) if ours["sweep"].get(key) != theirs["sweep"].get(key)]
            what = f"was begun with another state of {ours['name']}.toml ({', '.join(changed)} differ)"
        raise InputError(f"The folder {self.path} {what}; give another folder with -o, or undo the change.")

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Keeps other batches out for as long as this process lives.

        Raises:
            InputError: another batch is at work in the folder.
        """
        filelock = needed("filelock")
        self.path.mkdir(parents=True, exist_ok=True)
        lock = filelock.FileLock(self.path / LOCK)
        try:
            lock.acquire(timeout=0)
        except filelock.Timeout:
            raise InputError(f"Another batch is at work in {self.path}; wait for it, or stop it.") from None
        try:
            yield
        finally:
            lock.release()

    @property
    def busy(self) -> bool:
        """Whether a batch is at work in the folder."""
        try:
            with self.locked():
                return False
        except InputError:
            return True

    def finished(self) -> list[int]:
        """Numbers of the samples that are complete, failed ones included, in rising order."""
        names = [item.name for item in os.scandir(self.samples)] if self.samples.is_dir() else []
        return sorted(int(name) for name in names if name.isdigit())

    def place(self, index: int) -> Path:
        """Where the sample goes when it is complete."""
        return self.samples / f"{index:0{DIGITS}d}"

    def metrics(self, index: int) -> dict[str, Any]:
        """What is known of a complete sample."""
        return json.loads((self.place(index) / METRICS).read_text(encoding="utf-8"))

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

    def forget_failed(self) -> None:
        """Takes failed samples out again, so that they are tried once more."""
        for index in self.finished():
            if self.metrics(index)["status"] == "failed":
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


def write_whole(path: Path, text: str) -> None:
    """A text file that is there with all of its text or not at all."""
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
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
