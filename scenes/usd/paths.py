"""Where a cache is written, and the file it grows in until it is complete."""

import os
from dataclasses import dataclass
from pathlib import Path

from ...errors import UsdError

FORMATS = (".usdc", ".usda", ".usdz")


@dataclass(frozen=True)
class Target:
    """A cache under its final name, which exists only once the cache is complete."""

    final: Path

    @property
    def partial(self) -> Path:
        """The binary file that frames are streamed into, whatever the final format."""
        return self.final.with_name(f"{self.final.stem}.partial.usdc")

    @property
    def converted(self) -> Path:
        """The finished cache in its final format, complete but not yet under its final name."""
        return self.partial.with_suffix(self.final.suffix)


def output_target(path: str | os.PathLike) -> Target:
    """Checks, before any work is done, that a cache can be written to ``path``.

    Raises:
        UsdError: unknown extension, a folder that is missing or not writable, or a path that is itself a folder.
    """
    final = Path(path).expanduser().absolute()
    folder = final.parent
    if final.is_dir():
        raise UsdError(f"Cannot write the cache: {path} is a folder; give a file name in it, such as cache.usdc.")
    if final.suffix not in FORMATS:
        raise UsdError(f"Cannot write the cache: {path} must end in {', '.join(FORMATS[:-1])} or {FORMATS[-1]}.")
    if not folder.is_dir():
        raise UsdError(f"Cannot write the cache {final.name}: the folder {folder} does not exist.")
    if not _accepts_files(folder):
        raise UsdError(f"Cannot write the cache {final.name}: the folder {folder} is not writable.")
    return Target(final)


def publish(target: Target) -> None:
    """Moves the finished file to its final name in one step that survives a power cut."""
    _flush_to_disk(target.converted)
    os.replace(target.converted, target.final)
    if os.name == "posix":  # Windows cannot open a folder to flush it
        _flush_to_disk(target.final.parent)


def _accepts_files(folder: Path) -> bool:
    """Whether a file can be made in ``folder``; asking the permissions alone misses read-only mounts."""
    probe = folder / f".warpcloth-{os.getpid()}.tmp"
    try:
        probe.touch(exist_ok=True)
        probe.unlink()
    except OSError:
        return False
    return True


def _flush_to_disk(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
