"""The stage of a cache: its metadata, its skeleton of prims, and where it comes from."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pxr import Kind, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade, Vt

from ... import __version__
from .failures import as_usd_error
from .paths import Target

ROOT = Sdf.Path("/World")
CLOTH = ROOT.AppendChild("Cloth")
OBSTACLES = ROOT.AppendChild("Obstacles")
MATERIALS = ROOT.AppendChild("Materials")
PROVENANCE = "warpcloth"
ASSET = "asset"  # key of the provenance: the stage that a simulation was of


def new_stage(target: Target) -> Usd.Stage:
    """An empty stage that is to become ``target``.

    Raises:
        UsdError: when the file cannot be made.
    """
    with as_usd_error(f"Cannot write {target.final.name}"):
        return Usd.Stage.CreateNew(str(target.partial))


def create_stage(target: Target, fps: float, provenance: Mapping[str, Any]) -> Usd.Stage:
    """A new stage in SI units, Z up, with one component ``/World`` and nothing in it; errors as :func:`new_stage`."""
    stage = new_stage(target)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(fps)
    stage.SetFramesPerSecond(fps)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(0)
    root = UsdGeom.Xform.Define(stage, ROOT).GetPrim()
    Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
    stage.SetDefaultPrim(root)
    for path_in_stage in (CLOTH, OBSTACLES, MATERIALS):
        UsdGeom.Scope.Define(stage, path_in_stage)
    stage.GetRootLayer().customLayerData = with_provenance({}, {"version": __version__, **provenance})
    return stage


def with_provenance(layer_data: Mapping[str, Any], facts: Mapping[str, Any]) -> dict[str, Any]:
    """The data of a layer with facts added to its provenance."""
    return {**layer_data, PROVENANCE: {**layer_data.get(PROVENANCE, {}), **usd_dictionary(facts)}}


def bind_color(prim: Usd.Prim, color: Sequence[float], roughness: float) -> None:
    """Binds a preview material of one linear colour to ``prim``, and sets its display colour."""
    stage = prim.GetStage()
    path = MATERIALS.AppendChild(f"{prim.GetParent().GetName()}_{prim.GetName()}")
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, path.AppendChild("Surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(tuple(map(float, color)))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(roughness)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)
    UsdGeom.Gprim(prim).CreateDisplayColorAttr([tuple(map(float, color))])


def prim_names(names: Sequence[str]) -> list[str]:
    """Valid prim names for any names, all different, as close to the given ones as can be."""
    taken: set[str] = set()
    result = []
    for name in names:
        base = re.sub(r"\W", "_", name, flags=re.ASCII)
        base = candidate = f"_{base}" if base[0].isdigit() else base
        number = 1
        while candidate in taken:
            candidate, number = f"{base}_{number}", number + 1
        taken.add(candidate)
        result.append(candidate)
    return result


def usd_dictionary(values: Mapping[str, Any]) -> dict[str, Any]:
    """``values`` as types that USD metadata can hold; None is left out, anything unknown becomes text."""
    return {str(key): _usd_value(value) for key, value in values.items() if value is not None}


def _usd_value(value: Any) -> Any:
    if isinstance(value, Mapping):
        return usd_dictionary(value)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, (list, tuple, np.ndarray)):
        return _usd_array(list(value))
    if isinstance(value, int) and not isinstance(value, bool) and not -(2**63) <= value < 2**63:
        return str(value)
    return value if isinstance(value, (bool, int, float, str)) else str(value)


def _usd_array(values: list[Any]) -> Any:
    plain = [_usd_value(value) for value in values]
    if plain and all(isinstance(value, (int, float)) for value in plain):
        return Vt.DoubleArray(plain)
    return Vt.StringArray([str(value) for value in plain])
