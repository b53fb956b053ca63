"""Opening a stage that is to be simulated."""

import os
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from warpcloth.errors import UsdError
from warpcloth.meshes.stage_parts import incomplete
from warpcloth.meshes.stage_units import si_matrix

from ..usd.opening import frame_rate, open_stage
from ..usd.value_types import refuse_other_types
from .notes import NOTES, agree, plain

EARTH = 9.81  # [m/s²], what a physics scene means that does not say


def open_shot(path: str | os.PathLike) -> Usd.Stage:
    """The stage in a USD file, with everything that it refers to.

    Raises:
        UsdError: when the file or something that it refers to cannot be read.
    """
    stage = open_stage(path)
    fault = incomplete(stage)
    if fault:
        raise UsdError(f"Cannot use {Path(path).name}, which is incomplete: {fault}.")
    return stage


def first_code(stage: Usd.Stage) -> float:
    """The time code at which the simulation starts.

    Raises:
        UsdError: it is not finite.
    """
    code = float(stage.GetStartTimeCode()) if stage.HasAuthoredMetadata("startTimeCode") else 0.0
    if not np.isfinite(code):
        raise UsdError(f"Cannot use {_name(stage)}: its startTimeCode is {code:g}, but must be a finite number.")
    return code


def stage_tables(stage: Usd.Stage, fps: float | None = None) -> dict[str, Any]:
    """What a stage says of frames, gravity and, where warpcloth wrote it, all else: raw tables of a scene.

    Args:
        stage: any stage.
        fps: frames per second that its range of time codes is to be cut into; None: those that it says.

    Raises:
        UsdError: its range of time codes is endless, or ends before it starts, or its gravity is no vector.
    """
    tables: dict[str, Any] = {"fps": frame_rate(stage) if fps is None else fps}
    if stage.HasAuthoredTimeCodeRange() and np.isfinite(tables["fps"]):
        start, end = first_code(stage), stage.GetEndTimeCode()
        frames = (end - start) * tables["fps"] / stage.GetTimeCodesPerSecond()
        if not np.isfinite(frames):
            raise UsdError(f"Cannot use {_name(stage)}: its time codes from {start:g} to {end:g} have no end.")
        if end < start:
            raise UsdError(f"Cannot use {_name(stage)}: its endTimeCode {end:g} is before its startTimeCode {start:g}.")
        tables |= {"frames": round(frames)} if round(frames) > 0 else {}
    scene = next((prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Scene)), None)
    if scene is None:
        return tables
    tables |= plain(scene.GetCustomDataByKey(NOTES) or {})
    simulation = tables.setdefault("simulation", {})
    simulation["gravity"] = agree(simulation.get("gravity"), gravity(UsdPhysics.Scene(scene)))
    return tables


def gravity(scene: UsdPhysics.Scene) -> list[float]:
    """Acceleration of gravity [m/s²], Z up."""
    refuse_other_types(scene.GetPrim())
    stage = scene.GetPrim().GetStage()
    to_si = si_matrix(stage)[:3, :3]
    metres = UsdGeom.GetStageMetersPerUnit(stage)
    magnitude, direction = scene.GetGravityMagnitudeAttr().Get(), scene.GetGravityDirectionAttr().Get()
    told = magnitude is not None and np.isfinite(magnitude) and magnitude >= 0.0
    strength = float(magnitude) * metres if told else EARTH
    direction = to_si @ np.array((0.0, 0.0, 0.0) if direction is None else direction, float) / metres
    length = float(np.linalg.norm(direction))
    return (strength * (direction / length if length > 0.0 else np.array([0.0, 0.0, -1.0]))).tolist()


def _name(stage: Usd.Stage) -> str:
    return Path(stage.GetRootLayer().realPath).name
