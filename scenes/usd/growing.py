"""A stage that grows on disk while frames are added, and becomes a finished file in one step."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd, UsdUtils

from ...errors import UsdError
from .clock import Clock
from .crate import save_again
from .failures import as_usd_error
from .paths import Target, publish
from .stage import with_provenance

SAVE_BYTES = 64 * 2**20


class GrowingStage:
    """The stage behind a cache. Samples leave the memory at each save.

    It is saved for every 64 MiB of samples, and whenever its frames have doubled: few saves, but a process that is
    killed leaves at least half of its frames even when the whole shot is small. Each save repeats the tables of
    all samples, which is why not every frame is saved.

    Args:
        target: the file to become.
        stage: a new one whose root layer is ``target.partial``.
        clock: time codes of the frames.
    """

    def __init__(self, target: Target, stage: Usd.Stage, clock: Clock):
        self.target = target
        self.stage = stage
        self.clock = clock
        self._doing = f"Cannot write {target.final.name}"
        self._unsaved_bytes = 0
        self._saved_frames = 0
        self._kept = False  # whether the file is to stay although it could not be completed

    def note(self, facts: Mapping[str, Any]) -> None:
        """Adds to the provenance, or replaces what it says."""
        layer = self.stage.GetRootLayer()
        layer.customLayerData = with_provenance(layer.customLayerData, facts)

    def added(self, size: int) -> None:
        """Takes note of ``size`` more bytes in memory."""
        self._unsaved_bytes += size

    def save_when_due(self, frames: range) -> None:
        """Saves if enough has come together; call it after whole frames only."""
        if self._unsaved_bytes >= SAVE_BYTES or len(frames) >= 2 * self._saved_frames:
            self.save_frames(frames)

    def save_frames(self, frames: range) -> None:
        """Saves everything, with ``frames`` as the range of the stage.

        Raises:
            UsdError: when the disk does not take it; the message has the file in which earlier frames are kept.
        """
        self.stage.SetStartTimeCode(self.clock.code(frames[0]))
        self.stage.SetEndTimeCode(self.clock.code(frames[-1]))
        try:
            self.save()
        except UsdError as error:
            if self._saved_frames == 0:
                raise
            raise self._keeping(error, f"its first {self._saved_frames} frames") from error
        self._saved_frames = len(frames)

    def save(self) -> None:
        """Saves everything.

        Raises:
            UsdError: when the disk does not take it.
        """
        layer = self.stage.GetRootLayer()
        if layer.dirty:
            with as_usd_error(self._doing):
                save_again(layer, self.target.partial, self._unsaved_bytes)
        self._unsaved_bytes = 0

    def finish(self, frames: range) -> Path:
        """Saves ``frames`` and closes the stage, converts the file if need be, and gives it its final name.

        Raises:
            UsdError: when the disk does not take it; the message has the file in which frames are kept.
        """
        try:
            self.save_frames(frames)
            del self.stage
            try:
                with as_usd_error(self._doing):
                    self._convert()
                    publish(self.target)
            except UsdError as error:
                raise self._keeping(error, "its frames") from error
        except BaseException:
            self._discard_file()
            raise
        self.target.discard()
        stale = Sdf.Layer.Find(str(self.target.final))
        if stale:  # somebody in this process still has the file open that was just replaced
            stale.Reload(force=True)
        return self.target.final

    def discard(self) -> None:
        """Closes the stage and removes its file, unless that has all there is of frames that no disk had room for."""
        del self.stage
        self._discard_file()

    def _discard_file(self) -> None:
        self.target.discard(keep=self.target.partial if self._kept else None)

    def _keeping(self, error: UsdError, what: str) -> UsdError:
        """Lets the file stay, and says so."""
        self._kept = True
        return UsdError(f"{str(error).rstrip('.')}; {what} are kept in {self.target.partial}.")

    def _convert(self) -> None:
        source, result = self.target.partial, self.target.converted
        done = True
        if result.suffix == ".usda":
            done = Sdf.Layer.FindOrOpen(str(source)).Export(str(result))
        elif result.suffix == ".usdz":
            name = self.target.final.with_suffix(".usdc").name
            done = UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(source)), str(result), name)
        if not done:
            raise UsdError(f"{self._doing}: it could not be converted to {result.suffix}.")
