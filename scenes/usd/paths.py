"""Where a cache is written, and the file it grows in until it is complete."""

import contextlib
import errno
import os
import secrets
import shutil
from dataclasses import dataclass, field
from pathlib import Path

from ...errors import UsdError
from ...validate import at_home, file_path, is_utf8

FORMATS = (".usd", ".usdc", ".usda", ".usdz")
BINARY = (".usd", ".usdc")  # a .usd may be of either kind; the binary one is what it usually is
LAYER = ".cache.usdc"  # how the name of a shot's cache layer ends


def _own_mark() -> str:
    """What no other writer has, in this process or another, on this machine or another."""
    return f"{os.getpid()}-{secrets.token_hex(4)}"


@dataclass(frozen=True)
class Target:
    """A cache under its final name, which exists only once the cache is complete.

    Until then it is in files that nobody else writes to, even where two have the same final name; the last one to be
    complete keeps it. A process that is killed leaves them behind, and nobody removes them: the frames in them may be
    all there is of a long simulation.
    """

    final: Path
    mark: str = field(default_factory=_own_mark)

    @property
    def partial(self) -> Path:
        """The binary file that frames are streamed into, whatever the final format."""
        return self.final.with_name(f"{self.final.stem}.{self.mark}.partial.usdc")

    @property
    def converted(self) -> Path:
        """The finished cache in its final format, complete but not yet under its final name."""
        return self.partial if self.final.suffix in BINARY else self.partial.with_suffix(self.final.suffix)

    @property
    def folder(self) -> Path:
        """Where what is to be packed may be put together."""
        return self.final.with_name(f"{self.final.stem}.{self.mark}.partial")

    def discard(self, keep: Path | None = None) -> None:
        """Removes what there is under other names than the final one, as far as it can be, but not ``keep``."""
        for path in {self.partial, self.converted} - {keep}:
            with contextlib.suppress(OSError):  # what has led here is what the user should hear of
                path.unlink(missing_ok=True)
        shutil.rmtree(self.folder, ignore_errors=True)


def output_target(path: str | os.PathLike) -> Target:
    """Checks, before any work is done, that a cache can be written to ``path``.

    Raises:
        InputError: ``path`` is not the path of a file.
        UsdError: unknown extension, a folder that is missing or not writable, a path that is itself a folder, or one
            that is not UTF-8 text.
    """
    target = Target(at_home(file_path(path, "path")).absolute())
    name, folder = target.final.name, target.final.parent
    if not is_utf8(target.final):
        raise UsdError(f"Cannot write {str(target.final)!r}: USD needs a path that is UTF-8 text.")
    try:
        if target.final.suffix not in FORMATS:
            raise UsdError(f"Cannot write {path}: its name must end in {', '.join(FORMATS[:-1])} or {FORMATS[-1]}.")
        if target.final.is_dir():
            raise UsdError(f"Cannot write {path}: it is a folder; give a file name in it, such as cache.usdc.")
        if not folder.is_dir():
            raise UsdError(f"Cannot write {name}: the folder {folder} does not exist.")
        target.partial.touch(exist_ok=False)  # asking the permissions alone misses read-only mounts
        target.partial.unlink()
    except OSError as error:
        why = "its name is too long" if error.errno == errno.ENAMETOOLONG else f"the folder {folder} is not writable"
        raise UsdError(f"Cannot write {name}: {why}.") from error
    return target


def cache_of_shot(shot: Target) -> Path:
    """Where the cache layer of a shot is; before it is packed, in a folder of its own."""
    if shot.final.suffix == ".usdz":
        return shot.folder / f"{shot.final.stem}{LAYER}"
    whole = shot.final.stem if shot.final.suffix == ".usda" else shot.final.name
    return shot.final.with_name(f"{whole}{LAYER}")


def shot_of_cache(cache: Path) -> Path | None:
    """The shot that a cache layer belongs to; None where there is none beside it."""
    whole = cache.name.removesuffix(LAYER)
    shot = cache.with_name(whole if Path(whole).suffix in BINARY else f"{whole}.usda")
    return shot if cache.name.endswith(LAYER) and shot.is_file() else None


def publish(target: Target) -> None:
    """Moves the finished file to its final name in one step that survives a power cut."""
    _flush_to_disk(target.converted)
    os.replace(target.converted, target.final)
    if os.name == "posix":  # Windows cannot open a folder to flush it
        _flush_to_disk(target.final.parent)


def _flush_to_disk(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
