"""Checks of what a cloth has besides the values of its samples."""

import numpy as np
from pxr import Usd, UsdGeom

from .roles import role_of


def topology_faults(mesh: UsdGeom.Mesh) -> list[str]:
    """Whether the faces are given, once and for all."""
    faults = []
    for attribute in (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr(), mesh.GetSubdivisionSchemeAttr()):
        if not attribute.HasAuthoredValue():
            faults.append(f"has no {attribute.GetName()}")
        if attribute.GetNumTimeSamples():
            faults.append(f"has a sampled {attribute.GetName()}, but topology must not change")
    return faults


def sampling_faults(shape: UsdGeom.PointBased, followers: list[Usd.Attribute]) -> list[str]:
    """Whether ``followers`` are sampled where the points are, and these at every frame."""
    codes = shape.GetPointsAttr().GetTimeSamples()
    if not codes:
        return ["has no sampled points"]
    faults = []
    for attribute in followers:
        own = attribute.GetTimeSamples()
        if not own:
            faults.append(f"has no {attribute.GetName()} at its frames")
        elif own != codes:
            faults.append(f"has {attribute.GetName()} at {len(own)} frames that are not the {len(codes)} of its points")
    stage = shape.GetPrim().GetStage()
    frames = codes[0] + np.arange(len(codes)) * stage.GetTimeCodesPerSecond() / stage.GetFramesPerSecond()
    if role_of(shape.GetPrim()) and not np.allclose(codes, frames, rtol=0.0, atol=1e-6):
        faults.append("is not sampled at every frame")
    return faults


def extent_fault(shape: UsdGeom.PointBased, code: Usd.TimeCode) -> str | None:
    """Whether the extent is missing or not that of the points at ``code``, to the last bit."""
    extent = shape.GetExtentAttr().Get(code)
    computed = UsdGeom.Boundable.ComputeExtentFromPlugins(shape, code)
    if extent is None:
        return "has no extent"
    if computed is not None and not np.array_equal(np.array(extent), np.array(computed)):
        return "has a wrong extent"
    return None
