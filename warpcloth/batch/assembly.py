"""A stage that shows all drapes of a batch side by side."""

import math
from pathlib import Path

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdPhysics

from ..scenes.usd.failures import as_usd_error
from ..scenes.usd.opening import open_stage
from .folder import BatchFolder, flush
from .recorder import CACHE, POSE

ASSEMBLY = "assembly.usda"
ROOT = Sdf.Path("/Samples")
GAP = 1.2  # distance of neighbours over the size of the largest


def write_assembly(folder: BatchFolder) -> Path | None:
    """Writes ``assembly.usda``, which refers to the drapes by payloads; None if there are none.

    Samples stand in rows along x, in the order of their numbers. Those that end before the last one stand still.

    Raises:
        UsdError: a drape cannot be read, or the stage cannot be written.
    """
    files = {index: file for index in folder.finished() if (file := drape_file(folder, index)) is not None}
    if not files:
        (folder.path / ASSEMBLY).unlink(missing_ok=True)  # it would show what is there no more
        return None
    partial = folder.path / f".partial.{ASSEMBLY}"
    layer = Sdf.Layer.CreateAnonymous(".usda")
    with as_usd_error(f"Cannot write {folder.path / ASSEMBLY}"):
        _fill(
            Usd.Stage.Open(layer, Usd.Stage.LoadNone),
            {index: file.relative_to(folder.path) for index, file in files.items()},
            folder,
        )
        layer.Export(str(partial))
        flush(partial)
        partial.replace(folder.path / ASSEMBLY)
    return folder.path / ASSEMBLY


def drape_file(folder: BatchFolder, index: int) -> Path | None:
    """The file that shows a sample: all frames if there are, else the last one."""
    files = [folder.place(index) / name for name in (CACHE, POSE)]
    return next((file for file in files if file.exists()), None)


def _fill(stage: Usd.Stage, files: dict[int, Path], folder: BatchFolder) -> None:
    sizes, ends, rates = [], [], []
    for file in files.values():
        drape = open_stage(folder.path / file)
        rates.append(drape.GetTimeCodesPerSecond())
        ends.append(drape.GetEndTimeCode())
        sizes.append(_width(drape))
    rate = max(rates)  # to which USD fits the time codes of the other drapes
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(max(end * (rate / own) for end, own in zip(ends, rates, strict=True)))
    root = UsdGeom.Xform.Define(stage, ROOT).GetPrim()
    Usd.ModelAPI(root).SetKind(Kind.Tokens.assembly)
    stage.SetDefaultPrim(root)
    columns, step = math.ceil(math.sqrt(len(files))), GAP * max(sizes)
    for number, (index, file) in enumerate(files.items()):
        prim = UsdGeom.Xform.Define(stage, ROOT.AppendChild(f"sample_{index:06d}"))
        prim.AddTranslateOp().Set(Gf.Vec3d(step * (number % columns), step * -(number // columns), 0.0))
        prim.GetPrim().GetPayloads().AddPayload(f"./{file.as_posix()}")


def _width(stage: Usd.Stage) -> float:
    """Greatest width of all that moves in a drape along x or y at its end [m], about the origin of its scene."""
    widest = 0.0
    for prim in stage.Traverse():
        points = UsdGeom.PointBased(prim).GetPointsAttr() if prim.IsA(UsdGeom.PointBased) else None
        if points and points.GetNumTimeSamples():
            values = np.array(points.Get(stage.GetEndTimeCode()))
            widest = max(widest, 2.0 * float(np.abs(values[:, :2]).max(initial=0.0)))
    return max(widest, 0.1)
