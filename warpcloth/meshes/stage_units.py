"""Axes and units of a USD stage. This module imports ``pxr``; import it only to read USD."""

import math

import numpy as np
from pxr import Usd, UsdGeom

UP = (UsdGeom.Tokens.y, UsdGeom.Tokens.z)


def unit_fault(stage: Usd.Stage) -> str | None:
    """What is wrong with the axes or units of a stage, or None."""
    if UsdGeom.GetStageUpAxis(stage) not in UP:
        return f"its upAxis is '{UsdGeom.GetStageUpAxis(stage)}', but must be 'Y' or 'Z'"
    return number_fault("metersPerUnit", UsdGeom.GetStageMetersPerUnit(stage))


def number_fault(key: str, value: float) -> str | None:
    """What is wrong with a number that a stage says of itself and that must be above 0, or None."""
    return None if math.isfinite(value) and value > 0.0 else f"its {key} is {value:g}, but must be a number above 0"


def si_matrix(stage: Usd.Stage) -> np.ndarray:
    """The 4 × 4 matrix that takes the stage's axes and units to Z up and metres."""
    matrix = np.eye(4)
    if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y:
        matrix[:3, :3] = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    matrix[:3, :3] *= UsdGeom.GetStageMetersPerUnit(stage)
    return matrix
