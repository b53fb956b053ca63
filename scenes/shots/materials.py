"""Fabrics as materials of the surface-deformable proposal, both ways.

The proposal has ``physics:surfaceStretchStiffness`` C = E h/(1 − ν²) and ``physics:surfaceShearStiffness`` G [N/m],
``physics:surfaceBendStiffness`` [N m] and ``physics:density`` [kg/m³] on the material, ``physics:thicknesses`` h [m] on
the mesh, all in the stage's units. A sheet of springs has C = (Y + √(Y² + 4 G²))/2 (see :class:`warpcloth.Fabric`), so
Y = C − G²/C. What fabrics have besides is noted as ``warpcloth:…``, in SI units.
"""

from dataclasses import fields, replace
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdPhysics, UsdShade

from warpcloth.cloth.sheet import sheet_tensor
from warpcloth.errors import InputError, UsdError
from warpcloth.fabric import Fabric
from warpcloth.fabric_library import fabrics, library_fabric

from .notes import note, noted, same

MATERIAL_API = "PhysicsSurfaceDeformableMaterialAPI"
THICKNESS = 1e-3  # [m], the proposal's where a mesh does not say
POISSON = 0.3  # likewise
STRETCH, SHEAR, BEND = "surfaceStretchStiffness", "surfaceShearStiffness", "surfaceBendStiffness"
NAMES = (STRETCH, SHEAR, BEND, "youngsModulus", "poissonsRatio", "density", "dynamicFriction")
NUMBERS = [field.name for field in fields(Fabric) if field.name not in ("name", "color")]
OPTIONAL = {field.name for field in fields(Fabric) if field.default is None}


def write_material(mesh: Usd.Prim, path: Sdf.Path, fabric: Fabric) -> None:
    """Defines a material for ``fabric`` at ``path`` and binds it to ``mesh`` for physics."""
    stage = mesh.GetStage()
    material = UsdShade.Material.Define(stage, path)
    prim = material.GetPrim()
    UsdPhysics.MaterialAPI.Apply(prim)
    prim.AddAppliedSchema(MATERIAL_API)
    units = _units(stage)
    for name, value in _physics_of(fabric).items():
        kind = Sdf.ValueTypeNames.Float
        prim.CreateAttribute(f"physics:{name}", kind, custom=False).Set(value / units[name])
    note(prim, "fabric", fabric.name, Sdf.ValueTypeNames.String)
    for name in NUMBERS:
        note(prim, name, getattr(fabric, name), Sdf.ValueTypeNames.Double)
    UsdShade.MaterialBindingAPI.Apply(mesh).Bind(material, materialPurpose="physics")
    thickness = fabric.thickness / UsdGeom.GetStageMetersPerUnit(stage)
    mesh.CreateAttribute("physics:thicknesses", Sdf.ValueTypeNames.FloatArray, custom=False).Set([thickness])
    mesh.CreateAttribute(
        "physics:thicknesses:elementType", Sdf.ValueTypeNames.Token, custom=False, variability=Sdf.VariabilityUniform
    ).Set("constant")


def read_fabric(mesh: Usd.Prim) -> Fabric:
    """What a mesh is made of: by its physics material, or else ``Fabric()``; the colour is the mesh's own.

    Raises:
        UsdError: on a value that no fabric has.
    """
    material = physics_material(mesh)
    try:
        base = _noted_fabric(material)
        fabric = _with_physics(base or Fabric(), _found(material), _thickness(mesh), exact=base is not None)
        color = UsdGeom.Gprim(mesh).GetDisplayColorAttr().Get(Usd.TimeCode.EarliestTime())
        if color:
            red, green, blue = (float(np.clip(channel, 0.0, 1.0)) for channel in color[0])
            fabric = replace(fabric, color=(red, green, blue))
    except InputError as error:
        where = mesh.GetPath() if material is None else material.GetPath()
        raise UsdError(f"The fabric of {where} cannot be used: {error}") from error
    return fabric


def physics_material(prim: Usd.Prim) -> Usd.Prim | None:
    """The material that is bound to a prim for physics, or else for everything."""
    material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")[0]
    return material.GetPrim() if material else None


def _noted_fabric(material: Usd.Prim | None) -> Fabric | None:
    """A fabric of the library by its name, with what is noted of it; None where nothing is."""
    if material is None:
        return None
    values: dict[str, Any] = {name: value for name in NUMBERS if (value := noted(material, name)) is not None}
    name = noted(material, "fabric")
    if name in fabrics() and set(NUMBERS) - set(values) - OPTIONAL:
        return library_fabric(name, **values)
    return Fabric(name=name or material.GetName(), **values) if name or values else None


def _with_physics(base: Fabric, found: dict[str, float], thickness: float | None, *, exact: bool) -> Fabric:
    """``base`` with what the proposal's attributes say otherwise; ``exact``: that they say the same is rounding."""
    given: dict[str, Any] = {}
    if thickness is not None and not (exact and same(base.thickness, thickness)):
        given["thickness"] = thickness
    ours = _physics_of(base)
    found = {name: value for name, value in found.items() if not (exact and name in ours and same(ours[name], value))}
    height = given.get("thickness", base.thickness if exact else THICKNESS)
    nu, young = found.get("poissonsRatio", POISSON), found.get("youngsModulus")
    plate = None if young is None else young * height / (1.0 - nu * nu)
    stretch, shear, bend = found.get(STRETCH, plate), found.get(SHEAR), found.get(BEND)
    if shear is None and stretch is not None:
        shear = base.shear_stiffness if exact else 0.5 * (1.0 - nu) * (stretch if plate is None else plate)
    if stretch is not None and shear is not None and stretch > 0.0:
        given |= {"stretch_stiffness": stretch - shear * shear / stretch, "stretch_stiffness_weft": None}
    if shear is not None:
        given["shear_stiffness"] = shear
    if bend is None and plate is not None:
        bend = plate * height * height / 12.0
    if bend is not None:
        given |= {"bending_rigidity": bend, "bending_rigidity_weft": None, "bend_stiffness": 0.0}
    density = found.get("density", 0.0) or (ours["density"] if exact and "thickness" in given else 0.0)
    if density > 0.0:  # 0 means: not given
        given["areal_density"] = density * height
    if "dynamicFriction" in found:
        given["friction"] = found["dynamicFriction"]
    return replace(base, **given)


def _physics_of(fabric: Fabric) -> dict[str, float]:
    """What the proposal's attributes say of a fabric, in SI units."""
    return {
        STRETCH: sheet_tensor(fabric.stretch, fabric.shear_stiffness)[0],
        SHEAR: fabric.shear_stiffness,
        BEND: fabric.bending_rigidity,
        "density": fabric.areal_density / fabric.thickness,
        "dynamicFriction": fabric.friction,
    }


def _found(material: Usd.Prim | None) -> dict[str, float]:
    """The attributes of a material that say anything, in SI units; negative and infinite values stand for nothing."""
    if material is None:
        return {}
    units = _units(material.GetStage())
    values = {name: material.GetAttribute(f"physics:{name}") for name in NAMES}
    numbers = {name: value.Get() for name, value in values.items() if value and value.HasAuthoredValue()}
    usable = {name: value for name, value in numbers.items() if isinstance(value, int | float)}
    return {name: value * units[name] for name, value in usable.items() if np.isfinite(value) and value >= 0.0}


def _thickness(mesh: Usd.Prim) -> float | None:
    """Mean of the thicknesses that a mesh says it has [m]."""
    attribute = mesh.GetAttribute("physics:thicknesses")
    values = np.array(attribute.Get() or [], float) if attribute else np.zeros(0)
    if values.size == 0 or not np.all(np.isfinite(values)) or values.min() <= 0.0:
        return None
    return float(values.mean()) * UsdGeom.GetStageMetersPerUnit(mesh.GetStage())


def _units(stage: Usd.Stage) -> dict[str, float]:
    """The stage's unit of each attribute in SI units."""
    metre, kilogram = UsdGeom.GetStageMetersPerUnit(stage), UsdPhysics.GetStageKilogramsPerUnit(stage)
    return {
        STRETCH: kilogram,
        SHEAR: kilogram,
        BEND: kilogram * metre**2,
        "youngsModulus": kilogram / metre,
        "poissonsRatio": 1.0,
        "density": kilogram / metre**3,
        "dynamicFriction": 1.0,
    }
