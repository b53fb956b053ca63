"""Opening a stage that is to be simulated."""

import os
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from warpcloth.errors import UsdError

from ..usd.opening import open_stage, si_matrix
from .notes import NOTES, agree, plain

EARTH = 9.81  # [m/s²], what a physics scene means that does not say


def open_shot(path: str | os.PathLike) -> Usd.Stage:
    """The stage in a USD file, with everything that it refers to.

    Raises:
        UsdError: when the file or something that it refers to cannot be read.
    """
    stage = open_stage(path)
    errors = stage.GetCompositionErrors()
    if errors:
        text = " ".join(str(errors[0]).split()).rstrip(".")
        more = f" (and {len(errors) - 1} more such problems)" if len(errors) > 1 else ""
        raise UsdError(f"Cannot use {Path(path).name}, which is incomplete: {text[:1].lower()}{text[1:]}{more}.")
    return stage


def frame_rate(stage: Usd.Stage) -> float:
    """Frames per second: as the stage says, or else one frame for each time code."""
    said = stage.HasAuthoredMetadata("framesPerSecond")
    return float(stage.GetFramesPerSecond() if said else stage.GetTimeCodesPerSecond())


def first_code(stage: Usd.Stage) -> float:
    """The time code at which the simulation starts."""
    return float(stage.GetStartTimeCode()) if stage.HasAuthoredMetadata("startTimeCode") else 0.0


def stage_tables(stage: Usd.Stage) -> dict[str, Any]:
    """What a stage says of frames, gravity and, where warpcloth wrote it, all else: raw tables of a scene."""
    tables: dict[str, Any] = {"fps": frame_rate(stage)}
    if stage.HasAuthoredTimeCodeRange():
        codes = stage.GetEndTimeCode() - stage.GetStartTimeCode()
        frames = round(codes * tables["fps"] / stage.GetTimeCodesPerSecond())
        tables |= {"frames": frames} if frames > 0 else {}
    scene = next((prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Scene)), None)
    if scene is None:
        return tables
    tables |= plain(scene.GetCustomDataByKey(NOTES) or {})
    simulation = tables.setdefault("simulation", {})
    simulation["gravity"] = agree(simulation.get("gravity"), gravity(UsdPhysics.Scene(scene)))
    return tables


def gravity(scene: UsdPhysics.Scene) -> list[float]:
    """Acceleration of gravity [m/s²], Z up."""
    stage = scene.GetPrim().GetStage()
    to_si = si_matrix(stage)[:3, :3]
    metres = UsdGeom.GetStageMetersPerUnit(stage)
    strength = float(scene.GetGravityMagnitudeAttr().Get())
    strength = strength * metres if np.isfinite(strength) and strength >= 0.0 else EARTH
    direction = to_si @ np.array(scene.GetGravityDirectionAttr().Get(), float) / metres
    length = float(np.linalg.norm(direction))
    return (strength * (direction / length if length > 0.0 else np.array([0.0, 0.0, -1.0]))).tolist()
