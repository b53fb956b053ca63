"""Fabrics as materials of a stage, and back."""

import dataclasses

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Sdf, Usd, UsdGeom, UsdPhysics, UsdShade
from shot_files import add_cloth, set_thickness
from warpcloth.scenes.shots.materials import read_fabric, write_material

from warpcloth import Fabric
from warpcloth.fabric_library import fabrics


@settings(max_examples=25)
@given(st.sampled_from([entry.fabric for entry in fabrics().values()]), st.floats(1e-4, 1e3), st.floats(1e-4, 1e3))
def test_a_fabric_survives_its_material_to_the_last_bit(fabric, metres, kilograms):
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    UsdPhysics.SetStageKilogramsPerUnit(stage, kilograms)
    mesh = UsdGeom.Mesh.Define(stage, "/mesh")
    write_material(mesh.GetPrim(), Sdf.Path("/fabric"), fabric)
    assert read_fabric(mesh.GetPrim()) == dataclasses.replace(fabric, color=Fabric().color)


def test_what_somebody_edits_counts_for_more_than_our_notes():
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    mesh = UsdGeom.Mesh.Define(stage, "/mesh")
    denim = fabrics()["denim"].fabric
    write_material(mesh.GetPrim(), Sdf.Path("/fabric"), denim)
    material = stage.GetPrimAtPath("/fabric")
    material.GetAttribute("physics:surfaceBendStiffness").Set(1e-3)
    material.GetAttribute("physics:density").Set(1000.0)
    edited = read_fabric(mesh.GetPrim())
    np.testing.assert_allclose(edited.bending, (1e-3, 1e-3), rtol=1e-6)
    np.testing.assert_allclose(edited.areal_density, 1000.0 * denim.thickness, rtol=1e-6)
    assert edited.stretch == denim.stretch


def test_a_fabric_of_the_library_by_its_name():
    stage = Usd.Stage.CreateInMemory()
    mesh = UsdGeom.Mesh.Define(stage, "/mesh")
    material = UsdShade.Material.Define(stage, "/Jeans")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    assert read_fabric(mesh.GetPrim()) == Fabric()
    material.GetPrim().CreateAttribute("warpcloth:fabric", Sdf.ValueTypeNames.String).Set("denim")
    material.GetPrim().CreateAttribute("warpcloth:friction", Sdf.ValueTypeNames.Double).Set(0.1)
    denim = fabrics()["denim"].fabric
    expected = dataclasses.replace(denim, friction=0.1, color=read_fabric(mesh.GetPrim()).color)
    assert read_fabric(mesh.GetPrim()) == expected


def test_youngs_modulus_makes_a_plate():
    """C = E h/(1 − ν²), B = E h³/(12 (1 − ν²)), G = C (1 − ν)/2; a sheet of springs has Y = C − G²/C."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    mesh = UsdGeom.Mesh.Define(stage, "/World/Shirt")
    cloth = add_cloth(stage, youngsModulus=1e6, poissonsRatio=0.25, density=300.0)
    set_thickness(cloth, 1e-3)
    fabric = read_fabric(mesh.GetPrim())
    plate = 1e6 * 1e-3 / (1.0 - 0.25**2)
    shear = plate * 0.75 / 2.0
    np.testing.assert_allclose(fabric.stretch, (plate - shear**2 / plate,) * 2, rtol=1e-6)
    np.testing.assert_allclose(fabric.shear_stiffness, shear, rtol=1e-6)
    np.testing.assert_allclose(fabric.bending_rigidity, plate * 1e-6 / 12.0, rtol=1e-6)
    np.testing.assert_allclose(fabric.areal_density, 0.3, rtol=1e-6)
