"""Colliders as other tools write them: sizes with time samples, and sizes that are none."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdShade
from usd_files import SQUARE
from warpcloth.scenes.usd import read_obstacles

from warpcloth.errors import MeshError, MeshWarning, UsdError

SIZES = [
    (UsdGeom.Sphere, "radius"),
    (UsdGeom.Cube, "size"),
    *((kind, size) for kind in (UsdGeom.Capsule, UsdGeom.Cylinder, UsdGeom.Cone) for size in ("radius", "height")),
]
each_size = pytest.mark.parametrize(("kind", "name"), SIZES, ids=lambda value: getattr(value, "__name__", value))


def collider(kind):
    """A stage with one collider in it."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    shape = kind.Define(stage, "/Solid")
    UsdPhysics.CollisionAPI.Apply(shape.GetPrim())
    return stage, shape.GetPrim()


def extent(stage) -> np.ndarray:
    """Edges of a box around the obstacle [m]."""
    (solid,) = read_obstacles(stage)
    if hasattr(solid, "points"):
        return np.ptp(solid.points, axis=0)
    if hasattr(solid, "start"):
        return np.abs(solid.end - solid.start) + 2.0 * solid.radius
    return np.ones(3) * (2.0 * solid.radius if hasattr(solid, "radius") else solid.size)


@each_size
def test_a_size_that_has_samples_but_does_not_change_is_a_constant(kind, name):
    stage, prim = collider(kind)
    prim.GetAttribute(name).Set(0.25)
    told = extent(stage)
    assert np.all(told > 0.2)
    for codes in ([3.0], [1.0, 5.0]):
        stage, prim = collider(kind)
        for code in codes:
            prim.GetAttribute(name).Set(0.25, code)
        np.testing.assert_array_equal(extent(stage), told)


@each_size
def test_a_size_that_changes_is_refused(kind, name):
    stage, prim = collider(kind)
    for code in (0.0, 1.0):
        prim.GetAttribute(name).Set(0.25 + code, code)
    with pytest.raises(UsdError, match=f"A collider needs a constant {name}, but /Solid.{name} changes over time"):
        read_obstacles(stage)


@each_size
@pytest.mark.parametrize("value", [0.0, -0.1, np.nan, np.inf])
def test_a_size_that_is_none_is_refused(kind, name, value):
    stage, prim = collider(kind)
    prim.GetAttribute(name).Set(value)
    with pytest.raises(UsdError, match=f"Collider /Solid has a {name} of {value:g}, but must have one above 0"):
        read_obstacles(stage)


@pytest.mark.parametrize("kind", [UsdGeom.Capsule, UsdGeom.Cylinder, UsdGeom.Cone, UsdGeom.Plane])
def test_an_axis_that_is_none_is_refused(kind):
    stage, prim = collider(kind)
    prim.GetAttribute("axis").Set("W")
    with pytest.raises(UsdError, match="Collider /Solid has the axis 'W', which must be X, Y or Z"):
        read_obstacles(stage)


def test_friction_may_be_sampled_once(tmp_path):
    stage, prim = collider(UsdGeom.Sphere)
    material = UsdShade.Material.Define(stage, "/Rubber")
    friction = UsdPhysics.MaterialAPI.Apply(material.GetPrim()).CreateDynamicFrictionAttr()
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material, materialPurpose="physics")
    friction.Set(0.75, 2.0)
    (ball,) = read_obstacles(stage)
    assert ball.friction == 0.75
    friction.Set(0.25, 3.0)
    with pytest.raises(UsdError, match=r"a constant dynamicFriction, but /Rubber\.physics:dynamicFriction ch"):
        read_obstacles(stage)


@pytest.mark.parametrize("codes", [[None], [7.0]], ids=["default", "one sample"])
@pytest.mark.parametrize("moves", [False, True])
def test_a_mesh_may_have_its_points_sampled_once(codes, moves):
    stage, prim = collider(UsdGeom.Mesh)
    mesh = UsdGeom.Mesh(prim)
    for code in codes:
        at = Usd.TimeCode.Default() if code is None else code
        mesh.GetPointsAttr().Set(SQUARE, at)
        mesh.GetFaceVertexCountsAttr().Set([4], at)
        mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3], at)
    if moves:
        op = mesh.AddTranslateOp()
        for code in (0.0, 24.0):
            op.Set(Gf.Vec3d(0.0, 0.0, code / 24.0), code)
    (solid,) = read_obstacles(stage)
    assert solid.moves is moves
    np.testing.assert_array_equal(solid.points_at(0.0), SQUARE)
    np.testing.assert_allclose(solid.points_at(1.0)[:, 2], float(moves), atol=1e-12)


def test_faces_that_are_sampled_may_not_change():
    """Many writers sample faces at every frame."""
    stage, prim = collider(UsdGeom.Mesh)
    mesh = UsdGeom.Mesh(prim)
    mesh.CreatePointsAttr(SQUARE)
    for code in (0.0, 1.0, 2.0):
        mesh.GetFaceVertexCountsAttr().Set([4], code)
        mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3], code)
    (solid,) = read_obstacles(stage)
    assert len(solid.triangles) == 2
    assert not solid.moves
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 3, 2], 2.0)
    with pytest.raises(UsdError, match=r"^Collider /Solid has a faceVertexIndices that changes over time; an obstacle"):
        read_obstacles(stage)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("mirrored", [(), (0,), (1,), (2,), (0, 1, 2)])
def test_a_plane_that_is_mirrored_is_solid_on_the_side_that_it_has_in_the_stage(axis, mirrored):
    stage, prim = collider(UsdGeom.Plane)
    UsdGeom.Plane(prim).CreateAxisAttr("XYZ"[axis])
    scale = np.ones(3)
    scale[list(mirrored)] = -1.0
    UsdGeom.XformCommonAPI(prim).SetScale(Gf.Vec3f(*scale.tolist()))
    (plane,) = read_obstacles(stage)
    np.testing.assert_allclose(plane.normal, np.eye(3)[axis] * scale, atol=1e-12)


def test_holes_of_a_mesh_are_none_of_its_faces():
    stage, prim = collider(UsdGeom.Mesh)
    mesh = UsdGeom.Mesh(prim)
    mesh.CreatePointsAttr([*SQUARE, (2.0, 0.0, 0.0), (2.0, 1.0, 0.0)])
    mesh.CreateFaceVertexCountsAttr([4, 4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 1, 4, 5, 2])
    assert len(read_obstacles(stage)[0].triangles) == 4
    mesh.CreateHoleIndicesAttr([0])
    (solid,) = read_obstacles(stage)
    assert sorted({*solid.triangles.ravel().tolist()}) == [1, 2, 4, 5]


@pytest.mark.skipif(not hasattr(UsdGeom, "Capsule_1"), reason="this OpenUSD knows no newer kinds")
@pytest.mark.parametrize(("old", "new"), [("Capsule", "Capsule_1"), ("Cylinder", "Cylinder_1")])
def test_newer_kinds_with_one_radius_are_as_the_older_ones(old, new):
    solids = []
    for kind, radii in ((old, ["radius"]), (new, ["radiusTop", "radiusBottom"])):
        stage, prim = collider(getattr(UsdGeom, kind))
        for name, value in [*((radius, 0.3) for radius in radii), ("height", 0.8), ("axis", "X")]:
            prim.GetAttribute(name).Set(value)
        solids.append(read_obstacles(stage)[0])
    assert type(solids[0]) is type(solids[1])
    for name in ("points", "triangles", "start", "end", "radius"):
        np.testing.assert_array_equal(getattr(solids[0], name, 0), getattr(solids[1], name, 0))
    prim.GetAttribute("radiusTop").Set(0.1)
    with pytest.raises(UsdError, match=r"/Solid has radii of 0.1 at its top and 0.3 at its bottom, but must have one"):
        read_obstacles(stage)


@pytest.mark.parametrize("how", ["scale", "points"])
def test_what_is_folded_up_at_first_may_open_later(how):
    stage, prim = collider(UsdGeom.Mesh)
    mesh = UsdGeom.Mesh(prim)
    mesh.CreatePointsAttr(SQUARE)
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    if how == "scale":
        grow = mesh.AddScaleOp()
        grow.Set(Gf.Vec3f(0.0), 0.0)
        grow.Set(Gf.Vec3f(-1.0, 1.0, 1.0), 24.0)
    else:
        mesh.GetPointsAttr().Set([SQUARE[0], SQUARE[1], SQUARE[1], SQUARE[0]], 0.0)
        mesh.GetPointsAttr().Set(SQUARE, 24.0)
    (solid,) = read_obstacles(stage)
    assert len(solid.triangles) == 2
    a, b, c = solid.points_at(1.0)[solid.triangles[0]]
    assert np.cross(b - a, c - a)[2] > 0.0
    assert np.ptp(solid.points_at(0.0)[:, 1]) == 0.0


@pytest.mark.parametrize("kind", [UsdGeom.Mesh, UsdGeom.Cylinder])
def test_a_still_collider_may_be_flattened(kind):
    stage, prim = collider(kind)
    if kind is UsdGeom.Mesh:
        UsdGeom.Mesh(prim).CreatePointsAttr(SQUARE)
        UsdGeom.Mesh(prim).CreateFaceVertexCountsAttr([4])
        UsdGeom.Mesh(prim).CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    UsdGeom.XformCommonAPI(prim).SetScale(Gf.Vec3f(2.0, 1.0, 0.0))
    (solid,) = read_obstacles(stage) if kind is UsdGeom.Mesh else _warned(stage)
    assert not solid.moves
    assert np.ptp(solid.points, axis=0)[2] == 0.0


def _warned(stage):
    """The obstacles of a stage in which triangles are left out."""
    with pytest.warns(MeshWarning, match="triangles have no area"):
        return read_obstacles(stage)


def test_triangles_without_area_are_left_out_with_a_warning():
    stage, prim = collider(UsdGeom.Mesh)
    mesh = UsdGeom.Mesh(prim)
    mesh.CreatePointsAttr([*SQUARE, (0.5, 0.0, 0.0)])
    mesh.CreateFaceVertexCountsAttr([3, 3, 3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 0, 4, 1, 0, 2, 3])
    with pytest.warns(MeshWarning, match=r"Collider /Solid: 1 triangle has no area, first triangle 1 .* does without"):
        (solid,) = read_obstacles(stage)
    np.testing.assert_array_equal(solid.triangles, [[0, 1, 2], [0, 2, 3]])
    mesh.GetPointsAttr().Set([(0.0, 0.0, 0.0)] * 5)
    with pytest.raises(MeshError, match=r"3 triangles have no area, .* and no others are left"):
        read_obstacles(stage)
