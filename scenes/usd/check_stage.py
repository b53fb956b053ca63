"""Checks of a stage as a whole: its metadata, and what the validators of others say."""

from pathlib import Path
from typing import Any

from pxr import Usd, UsdValidation

from warpcloth.meshes.stage_parts import incomplete

from .paths import shot_of_cache
from .stage import ASSET, PROVENANCE

METADATA = (
    "upAxis",
    "metersPerUnit",
    "kilogramsPerUnit",
    "timeCodesPerSecond",
    "framesPerSecond",
    "startTimeCode",
    "endTimeCode",
    "defaultPrim",
)
NOT_FAULTS = ("UsdAsciiPerformanceChecker",)  # advises against .usda, which whoever asked for it wants


def why_nothing_is_sampled(stage: Usd.Stage) -> str:
    """Why a stage has no mesh with sampled points, and what has; it follows a colon."""
    fault = incomplete(stage)
    if fault:
        return f"it is incomplete: {fault}"
    layer = stage.GetRootLayer()
    facts = layer.customLayerData.get(PROVENANCE)
    asset = facts.get(ASSET) if isinstance(facts, dict) else None
    if asset is None or layer.subLayerPaths:
        return "no mesh in it has sampled points"
    shot = shot_of_cache(Path(layer.realPath))
    right = f"make it a sublayer over {asset}" if shot is None else f"open {shot.name}, which has both"
    return f"it has the frames of a shot but none of its meshes; {right}"


def metadata_errors(stage: Usd.Stage, ours: bool) -> list[str]:
    """What the stage leaves unsaid; ``ours``: it is a cache of warpcloth, which says where it comes from."""
    errors = [f"The stage has no {key}." for key in METADATA if not stage.HasAuthoredMetadata(key)]
    root = stage.GetDefaultPrim()
    if root and not Usd.ModelAPI(root).GetKind():
        errors.append(f"The default prim {root.GetPath()} has no kind.")
    provenance = stage.GetRootLayer().customLayerData.get(PROVENANCE)
    over_asset = isinstance(provenance, dict) and ASSET in provenance  # whose time codes are as they are
    if stage.GetTimeCodesPerSecond() != stage.GetFramesPerSecond() and not over_asset:
        rates = f"{stage.GetTimeCodesPerSecond():g} time codes and {stage.GetFramesPerSecond():g} frames"
        errors.append(f"The stage has {rates} per second; they must be equal.")
    if ours and provenance is None:
        errors.append(f"The stage has no provenance in customLayerData['{PROVENANCE}'].")
    return errors


def range_errors(stage: Usd.Stage, codes: list[float]) -> list[str]:
    """Whether the stage's range of frames is that of its samples."""
    if not codes or not stage.HasAuthoredTimeCodeRange():
        return []
    said, found = (stage.GetStartTimeCode(), stage.GetEndTimeCode()), (codes[0], codes[-1])
    if said == found:
        return []
    return [f"The stage says frames {said[0]:g} to {said[1]:g}, but is sampled from {found[0]:g} to {found[1]:g}."]


def validator_errors(stage: Usd.Stage) -> list[str]:
    """Messages of OpenUSD's validators, and of NVIDIA's where they are installed."""
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    return sorted([error.GetMessage() for error in context.Validate(stage)] + _nvidia_errors(stage))


def _nvidia_errors(stage: Usd.Stage) -> list[str]:
    try:
        from usd_validation_nvidia import IssueSeverity, ValidationEngine
    except ImportError:
        return []
    issues = ValidationEngine().validate(stage).issues()  # it reads a path as a URL, in which # and ? end it
    faults = [i for i in issues if i.severity not in (IssueSeverity.NONE, IssueSeverity.INFO)]
    return [_with_place(i) for i in faults if i.rule is None or i.rule.__name__ not in NOT_FAULTS]


def _with_place(issue: Any) -> str:
    """What is wrong, with the prim at which it is where the message leaves that out: ``Prim </World/Ball>: …``."""
    text, place = issue.message.strip(), "" if issue.at is None else issue.at.as_str()
    return text if not place or place in text else f"{place}: {text}"
