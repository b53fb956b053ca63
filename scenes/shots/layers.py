"""The two files that a simulated stage becomes: a cache layer of overs, and a shot that puts it over the stage."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Kind, Sdf, Usd, UsdGeom, UsdPhysics, UsdUtils

from warpcloth import __version__
from warpcloth.errors import UsdError

from ..sources import layer_files, spare
from ..usd.clock import Clock
from ..usd.failures import as_usd_error
from ..usd.frames import FrameWriter, SampledCloth
from ..usd.growing import GrowingStage
from ..usd.paths import Target, cache_of_shot, output_target, publish
from ..usd.stage import ASSET, PROVENANCE, new_stage, with_provenance
from ..usd.writer import check_rate
from .cloth_over import ClothOver, single_out
from .network import NetworkOver
from .packing import refuse_unpackable
from .shot import Shot

COLLISION_API = "PhysicsCollisionAPI"
INSTANT = 0.01  # of a frame, over which the motion of a frame of reference is told


class ShotWriter(FrameWriter):
    """Streams frames into a cache layer; at the end writes the shot, which has that layer over the stage.

    For ``-o shot_sim.usda`` the layer is ``shot_sim.cache.usdc`` beside it, for ``-o shot_sim.usdc`` it is
    ``shot_sim.usdc.cache.usdc``, so that each shot has its own. A ``.usdz`` holds the shot, the layer and everything
    that the stage refers to.

    Args:
        path: of the shot: ``.usd``, ``.usda``, ``.usdc`` or ``.usdz``.
        shot: what is simulated.
        fps: frames per second, > 0.
        provenance: facts to keep in both files.
        frames: how many are to come after the first.

    Raises:
        UsdError: when nothing can be written to ``path``, when that is one of the files that the stage consists of,
            when the stage cannot be packed as asked for, or when one of the frames cannot be written to the stage.
    """

    def __init__(self, path: str | os.PathLike, shot: Shot, fps: float, provenance: Mapping[str, Any], frames: int = 0):
        check_rate(fps)
        self._target = output_target(path)
        cache = Target(cache_of_shot(self._target))
        spare((self._target.final, cache.final), layer_files(shot.stage), f"stage {shot.path.name}")
        if self._target.final.suffix == ".usdz":
            refuse_unpackable(shot.stage, shot.path.name, self._target.final.name)
        self._shot = shot
        rate = shot.stage.GetTimeCodesPerSecond()
        clock = Clock(shot.start, rate / fps)
        codes = [clock.code(frame) for frame in range(frames + 1)]
        facts = {"version": __version__, **provenance, ASSET: shot.path.name}
        try:
            file = GrowingStage(cache, _layer(cache, shot.stage, fps, facts), clock)
            overs: dict[str, SampledCloth] = {
                part.cloth.name: ClothOver(file.stage, part, codes, INSTANT * clock.step) for part in shot.parts
            }
            if shot.network is not None:
                overs[shot.network.network.name] = NetworkOver(file.stage, shot.network)
            for collider in shot.colliders:
                single_out(file.stage, shot.stage.GetPrimAtPath(collider))
                file.stage.OverridePrim(collider).AddAppliedSchema(COLLISION_API)
            super().__init__(file, float(fps), overs, [])
            file.save()
        except BaseException:
            cache.discard()
            self._target.discard()
            raise

    def close(self) -> Path | None:
        """Completes both files; returns the path of the shot, or None if there is not one frame.

        Raises:
            UsdError: when the disk does not take it; the message has the file in which frames are kept.
        """
        if self._closed:
            return self._target.final if self.frames else None
        try:
            cache = super().close()
            if cache is None:
                return None
            with as_usd_error(f"Cannot write the shot {self._target.final.name}, whose frames are kept in {cache}"):
                _finish(_Files(self._target, cache, self._shot))
        except UsdError:
            self._target.converted.unlink(missing_ok=True)
            raise
        except BaseException:
            self._target.discard()
            raise
        self._target.discard()
        return self._target.final

    def abort(self) -> None:
        """Removes what is written so far; files under the final names stay as they were."""
        if not self._closed:
            super().abort()
            self._target.discard()


@dataclass(frozen=True)
class _Files:
    """The shot to write, the finished cache layer, and what was simulated."""

    target: Target
    cache: Path
    shot: Shot


def _layer(target: Target, source: Usd.Stage, fps: float, provenance: Mapping[str, Any]) -> Usd.Stage:
    """A new stage of nothing but the cache layer, with the units of the stage it is to go over."""
    with as_usd_error(f"Cannot write {target.final.name}"):
        target.final.parent.mkdir(exist_ok=True)
    stage = new_stage(target)
    _set_units(stage, source, fps)
    stage.GetRootLayer().customLayerData = with_provenance({}, provenance)
    root = _root(source)
    stage.OverridePrim(root.GetPath())
    stage.SetDefaultPrim(stage.GetPrimAtPath(root.GetPath()))
    if not Usd.ModelAPI(root).GetKind():
        parts = any(Usd.ModelAPI(prim).GetKind() for prim in Usd.PrimRange(root))
        kind = Kind.Tokens.assembly if parts else Kind.Tokens.component
        Usd.ModelAPI(stage.GetPrimAtPath(root.GetPath())).SetKind(kind)
    return stage


def _set_units(stage: Usd.Stage, source: Usd.Stage, fps: float) -> None:
    UsdGeom.SetStageUpAxis(stage, UsdGeom.GetStageUpAxis(source))
    UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.GetStageMetersPerUnit(source))
    UsdPhysics.SetStageKilogramsPerUnit(stage, UsdPhysics.GetStageKilogramsPerUnit(source))
    stage.SetTimeCodesPerSecond(source.GetTimeCodesPerSecond())
    stage.SetFramesPerSecond(fps)


def _root(source: Usd.Stage) -> Usd.Prim:
    return source.GetDefaultPrim() or source.GetPseudoRoot().GetChildren()[0]


def _finish(files: _Files) -> None:
    """Writes the shot beside the cache; packs both where that is asked for."""
    target = files.target
    packed = target.final.suffix == ".usdz"
    draft = target.folder / f"{target.final.stem}.usda" if packed else target.converted
    _write_shot(draft, files)
    if packed and not UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(draft)), str(target.converted), draft.name):
        kept = f"the shot and its frames are kept in {draft.parent}"
        raise UsdError(f"Cannot write {target.final.name}: the stage cannot be packed; {kept}.")
    publish(target)
    stale = Sdf.Layer.Find(str(target.final))
    if stale:  # somebody in this process still has the file open that was just replaced
        stale.Reload(force=True)


def _write_shot(path: Path, files: _Files) -> None:
    """A layer with the cache over the stage, and the stage's own settings, which sublayers do not pass on."""
    source, asset = files.shot.stage, files.shot.stage.GetRootLayer()
    layer = Sdf.Layer.CreateNew(str(path))
    keep = {"subLayers", "subLayerOffsets", "primChildren", "customLayerData", "documentation"}
    for key in asset.pseudoRoot.ListInfoKeys():
        if key not in keep:
            layer.pseudoRoot.SetInfo(key, asset.pseudoRoot.GetInfo(key))
    layer.subLayerPaths = [_reference(files.cache, path), _reference(Path(asset.realPath), path)]
    cache = Sdf.Layer.FindOrOpen(str(files.cache))
    stage = Usd.Stage.Open(layer)
    _set_units(stage, source, cache.framesPerSecond)
    stage.SetStartTimeCode(cache.startTimeCode)
    stage.SetEndTimeCode(cache.endTimeCode)
    stage.SetDefaultPrim(stage.GetPrimAtPath(_root(source).GetPath()))
    layer.customLayerData = {**asset.customLayerData, PROVENANCE: cache.customLayerData[PROVENANCE]}
    layer.Save()


def _reference(file: Path, shot: Path) -> str:
    """How the shot names another file: relative to itself where both lie in one tree and may move together.

    Whoever opens the shot may come to its folder by a link or not, and ``..`` goes up the way that they came; so what
    is not found both ways is named in full.
    """
    relative = Path(os.path.relpath(file, shot.parent))
    direct = Path(os.path.normpath(shot.parent.resolve() / relative))
    shared = os.path.commonpath([file.absolute(), shot.absolute()]) != file.absolute().anchor
    if not shared or direct.resolve() != file.resolve():
        return file.absolute().as_posix()
    text = relative.as_posix()
    return text if text.startswith("../") else f"./{text}"
