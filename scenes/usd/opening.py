"""Opening a stage to read it."""

import os
from difflib import get_close_matches

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from ...errors import UsdError
from ...meshes.stage_units import number_fault, si_matrix, unit_fault
from ...validate import at_home, file_path, is_utf8
from .failures import as_usd_error, quietly

READABLE = (".usd", ".usda", ".usdc", ".usdz")


def open_stage(path: str | os.PathLike) -> Usd.Stage:
    """The stage in a USD file, as it is on disk now.

    Raises:
        InputError: ``path`` is not the path of a file.
        UsdError: when the file is missing, empty, not USD, or corrupt, or has no usable units.
    """
    file = at_home(file_path(path, "path")).absolute()
    if not is_utf8(file):
        raise UsdError(f"Cannot read {str(file)!r}: USD needs a path that is UTF-8 text.")
    if file.is_dir():
        raise UsdError(f"Cannot read {path}: it is a folder, not a USD file.")
    if not file.exists():
        beside = [other.name for other in file.parent.glob("*") if other.suffix in READABLE]
        near = get_close_matches(file.name, sorted(beside), n=1)
        raise UsdError(f"Cannot read {path}: there is no such file{f'; did you mean {near[0]!r}?' if near else '.'}")
    if file.suffix not in READABLE:
        raise UsdError(f"Cannot read {path}: the name of a USD file ends in {', '.join(READABLE[:-1])} or .usdz.")
    if file.stat().st_size == 0:
        raise UsdError(f"Cannot read {path}: the file is empty.")
    with as_usd_error(f"Cannot read {path}"), quietly():
        stage = Usd.Stage.Open(str(file))
        stage.Reload()  # somebody in this process may hold an older state of the file
    fault = (
        unit_fault(stage)
        or number_fault("kilogramsPerUnit", UsdPhysics.GetStageKilogramsPerUnit(stage))
        or number_fault("timeCodesPerSecond", stage.GetTimeCodesPerSecond())
    )
    if fault:
        raise UsdError(f"Cannot use {file.name}: {fault}.")
    return stage


def frame_rate(stage: Usd.Stage) -> float:
    """Frames per second: as the stage says, or else one frame for each time code."""
    said = stage.HasAuthoredMetadata("framesPerSecond")
    return float(stage.GetFramesPerSecond() if said else stage.GetTimeCodesPerSecond())


def world_matrix(prim: Usd.Prim, code: Usd.TimeCode | float) -> np.ndarray:
    """The 4 × 4 matrix, in column-vector convention, from the prim's own frame to Z up and metres at time ``code``.

    Raises:
        UsdError: when it is not finite.
    """
    matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode(code))).T
    if not np.isfinite(matrix).all():
        raise UsdError(f"Prim {prim.GetPath()} has a transform that is not of finite numbers{_at(code)}.")
    return si_matrix(prim.GetStage()) @ matrix


def local_matrix(prim: Usd.Prim, code: Usd.TimeCode | float) -> np.ndarray:
    """The inverse of :func:`world_matrix`.

    Raises:
        UsdError: when there is none.
    """
    matrix = world_matrix(prim, code)
    if np.linalg.matrix_rank(matrix[:3, :3]) < 3:
        rule = "cloth needs a scale other than 0"
        raise UsdError(f"Prim {prim.GetPath()} has a transform that flattens space{_at(code)}; {rule}.")
    return np.linalg.inv(matrix)


def _at(code: Usd.TimeCode | float) -> str:
    numeric = Usd.TimeCode(code).IsNumeric() and Usd.TimeCode(code) != Usd.TimeCode.EarliestTime()
    return f" at time code {Usd.TimeCode(code).GetValue():g}" if numeric else ""
