"""What is read from a stage: meshes, fabrics, pins and colliders, in whatever axes and units."""

import dataclasses

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade, Vt
from shot_files import add_ball, add_cloth, new_stage, pin_points, set_thickness, sheet, to_stage
from warpcloth.scenes import bundled_scenes, export_scene, load_scene, scene_from_toml, simulate
from warpcloth.scenes.built import BuiltScene
from warpcloth.scenes.shots.opening import stage_tables
from warpcloth.scenes.shots.shot import read_shot

from warpcloth import Fabric, MeshObstacle, Sphere
from warpcloth.fabric_library import fabrics

QUIET = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
UNITS = st.fixed_dictionaries(
    {
        "up": st.sampled_from(["Y", "Z"]),
        "metres": st.sampled_from([1.0, 0.01, 0.001, 0.3048]),
        "kilograms": st.sampled_from([1.0, 0.001]),
        "rate": st.sampled_from([24.0, 30.0, 4800.0]),
        "start": st.sampled_from([0.0, 1.0, 1001.0, -5.0]),
    }
)


@QUIET
@given(UNITS)
def test_a_shot_means_the_same_in_any_axes_and_units(tmp_path, units):
    (tmp_path / "shot.usda").unlink(missing_ok=True)
    stage = new_stage(tmp_path / "shot.usda", **units)
    metre, kilogram, rate = units["metres"], units["kilograms"], units["rate"]
    cloth = add_cloth(stage, density=400.0 * metre**3 / kilogram, surfaceStretchStiffness=100.0 / kilogram,
                      surfaceShearStiffness=30.0 / kilogram,
                      surfaceBendStiffness=1e-5 / (kilogram * metre**2))  # fmt: skip
    set_thickness(cloth, 0.0005 / metre)
    ball = add_ball(stage)
    for second in (0.0, 0.5):
        place = Gf.Vec3d(*to_stage(stage, (0.0, 0.0, 0.2 + 0.1 * second))[0])
        ball.GetOrderedXformOps()[0].Set(place, units["start"] + second * rate)
    scene = UsdPhysics.Scene.Define(stage, "/World/Physics")
    scene.CreateGravityMagnitudeAttr(1.62 / metre)
    stage.Save()
    shot = read_shot(tmp_path / "shot.usda")
    (part,), (obstacle,) = shot.parts, shot.obstacles
    np.testing.assert_allclose(part.cloth.points, sheet()[0], atol=1e-7)
    np.testing.assert_allclose(part.cloth.mass, 0.4**2 * 400.0 * 0.0005, rtol=1e-5)
    fabric = part.cloth.fabric
    found = (fabric.stretch_stiffness, fabric.shear_stiffness, fabric.bending_rigidity, fabric.thickness)
    np.testing.assert_allclose(found, (100.0 - 30.0**2 / 100.0, 30.0, 1e-5, 0.0005), rtol=1e-5)
    assert isinstance(obstacle, Sphere)
    np.testing.assert_allclose(obstacle.radius, 0.2, rtol=1e-12)
    np.testing.assert_allclose(obstacle.matrix(0.25)[:3, 3] + obstacle.center, (0.0, 0.0, 0.225), atol=1e-12)
    tables = stage_tables(shot.stage)
    np.testing.assert_allclose(tables["simulation"]["gravity"], (0.0, 0.0, -1.62), atol=1e-6)
    assert (tables["frames"], tables["fps"]) == (4, rate)


def polygon_sheet():
    """A hexagon, an L of six corners, a quad and a triangle, a point twice (a seam), and one that no face uses."""
    flat = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2), (2, 2), (3, 0), (3, 2), (4, 1), (2, 0), (9, 9)]
    counts = [6, 4, 4, 3]
    indices = [0, 1, 2, 3, 4, 5, 2, 6, 4, 3, 10, 7, 8, 6, 7, 9, 8]
    return np.array([(0.1 * x, 0.1 * y, 0.5) for x, y in flat]), counts, indices


def test_polygons_keep_the_points_of_the_mesh(tmp_path):
    points, counts, indices = polygon_sheet()
    stage = new_stage(tmp_path / "shot.usda", frames=2)
    add_cloth(stage, mesh=(points, counts, indices))
    stage.Save()
    (part,) = read_shot(tmp_path / "shot.usda").parts
    area = 0.01 * (3.0 + 1.0 + 2.0 + 1.0)  # of the L, the quad in its corner, the quad right of it, the triangle
    np.testing.assert_allclose(part.cloth.area, area, rtol=1e-6)
    assert len(part.cloth.points) == 10
    assert part.particle_of[11] == -1
    assert part.particle_of[10] == part.particle_of[1]
    result = simulate(load_scene(tmp_path / "shot.usda"), tmp_path / "out.usda", device="cpu", substeps="auto")
    shot = Usd.Stage.Open(str(result.output))
    cached = UsdGeom.Mesh.Get(shot, "/World/Shirt")
    assert list(cached.GetFaceVertexCountsAttr().Get()) == counts
    end = np.array(cached.GetPointsAttr().Get(2))
    assert end.shape == points.shape
    assert np.array_equal(end[1], end[10])
    assert np.all(end[:11, 2] < 0.5)
    np.testing.assert_allclose(end[11], points[11])


@pytest.mark.parametrize(
    "how", ["points", "faces", "primvar", "houdini", "uniform", "corners", "one", "one of corners"]
)
def test_pins_are_subsets_or_primvars(tmp_path, how):
    stage = new_stage(tmp_path / "shot.usda")
    mesh, expected = add_cloth(stage), [0, 1, 5, 6]
    weights = np.isin(np.arange(25), expected).astype(float)
    primvars = UsdGeom.PrimvarsAPI(mesh)
    if how == "points":
        pin_points(mesh, expected)
    elif how == "faces":
        pin_points(mesh, [0], "face")
    elif how == "primvar":
        kind = Sdf.ValueTypeNames.FloatArray
        primvars.CreatePrimvar("pins", kind, "vertex").Set(Vt.FloatArray(weights.tolist()))
    elif how == "houdini":
        kind = Sdf.ValueTypeNames.IntArray
        primvars.CreatePrimvar("pintoanimation", kind, "vertex").Set(Vt.IntArray(weights.astype(int).tolist()))
    elif how == "uniform":
        primvar = primvars.CreatePrimvar("pins", Sdf.ValueTypeNames.BoolArray, "uniform")
        primvar.Set([False, True])
        primvar.SetIndices([1] + [0] * 15)
    elif how == "corners":
        primvar = primvars.CreatePrimvar("pins", Sdf.ValueTypeNames.FloatArray, "faceVarying")
        primvar.Set([1.0] * 4 + [0.0] * 60)
    else:
        kind = "constant" if how == "one" else "faceVarying"
        primvars.CreatePrimvar("pins", Sdf.ValueTypeNames.FloatArray, kind).Set([1.0])
        expected = list(range(25))
    stage.Save()
    (part,) = read_shot(tmp_path / "shot.usda").parts
    assert part.cloth.pinned.tolist() == expected
    assert all(pin.motion is None for pin in part.cloth.pins)


def test_weights_of_faces_are_none_of_points_where_there_are_as_many(tmp_path):
    n = 6
    turns = [2.0 * np.pi * i / n for i in range(n)]
    ring = [((2 + np.cos(b)) * np.cos(a), (2 + np.cos(b)) * np.sin(a), np.sin(b)) for a in turns for b in turns]
    quads = [(i * n + j, (i + 1) % n * n + j, (i + 1) % n * n + (j + 1) % n, i * n + (j + 1) % n)
             for i in range(n) for j in range(n)]  # fmt: skip
    stage = new_stage(tmp_path / "shot.usda")
    mesh = add_cloth(stage, mesh=(np.array(ring), [4] * len(quads), [v for quad in quads for v in quad]))
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("pins", Sdf.ValueTypeNames.FloatArray, "uniform")
    primvar.Set([0.0] * 7 + [1.0] + [0.0] * 28)
    stage.Save()
    (part,) = read_shot(tmp_path / "shot.usda").parts
    assert part.cloth.pinned.tolist() == sorted(quads[7])


def test_pins_of_a_mesh_with_sampled_points_each_follow_their_own(tmp_path):
    stage = new_stage(tmp_path / "shot.usda", start=10.0)
    mesh = add_cloth(stage)
    pin_points(mesh, [3, 7])
    for code, stretch in ((10.0, 1.0), (34.0, 1.5)):
        mesh.GetPointsAttr().Set(to_stage(stage, sheet()[0] * stretch), code)
    stage.Save()
    (part,) = read_shot(tmp_path / "shot.usda").parts
    for pin in part.cloth.pins:
        first = part.cloth.points[pin.indices]
        np.testing.assert_allclose(pin.motion.evaluate(first, 0.5), 1.25 * first, atol=1e-7)
    assert part.cloth.pinned.tolist() == [3, 7]


def test_the_rest_shape_may_be_another_than_the_start(tmp_path):
    stage = new_stage(tmp_path / "shot.usda")
    mesh = add_cloth(stage)
    kind = Sdf.ValueTypeNames.Point3fArray
    rest = to_stage(stage, 0.5 * sheet()[0])
    mesh.GetPrim().CreateAttribute("physics:restShapePoints", kind).Set(rest)
    stage.Save()
    (part,) = read_shot(tmp_path / "shot.usda").parts
    np.testing.assert_allclose(part.cloth.points, sheet()[0], atol=1e-7)
    springs = part.cloth.springs
    lengths = np.linalg.norm(np.diff(part.cloth.points[springs.indices], axis=1)[:, 0], axis=1)
    np.testing.assert_allclose(springs.rest_lengths, 0.5 * lengths, rtol=1e-6)


@pytest.mark.parametrize(("said", "bent"), [(None, False), ("flat", False), ("restShape", True)])
def test_a_curved_mesh_is_flat_at_rest_unless_it_says_otherwise(tmp_path, said, bent):
    points, counts, indices = sheet(7)
    points[:, 2] += 2.0 * points[:, 0] ** 2
    stage = new_stage(tmp_path / "shot.usda")
    mesh = add_cloth(stage, mesh=(points, counts, indices), surfaceBendStiffness=1e-5)
    if said:
        mesh.GetPrim().CreateAttribute("physics:restBendAnglesDefault", Sdf.ValueTypeNames.Token).Set(said)
    stage.Save()
    bending = read_shot(tmp_path / "shot.usda").cloths[0].bending
    assert len(bending) > 0
    assert bool(np.any(bending.rest_curvature)) == bent


def test_variants_and_payloads_are_composed(tmp_path):
    stage = new_stage(tmp_path / "asset.usda")
    variants = stage.GetDefaultPrim().GetVariantSets().AddVariantSet("size")
    for name, size in (("small", 0.2), ("large", 0.6)):
        variants.AddVariant(name)
        variants.SetVariantSelection(name)
        with variants.GetVariantEditContext():
            add_cloth(stage, "/World/Shirt", sheet(4, size))
    stage.Save()
    shot = new_stage(tmp_path / "shot.usda")
    shirt = shot.DefinePrim("/World/wardrobe")
    shirt.GetPayloads().AddPayload("./asset.usda")
    shirt.GetVariantSet("size").SetVariantSelection("small")
    shot.Save()
    (part,) = read_shot(tmp_path / "shot.usda").parts
    assert str(part.mesh.GetPath()) == "/World/wardrobe/Shirt"
    np.testing.assert_allclose(part.cloth.area, 0.04, rtol=1e-6)


def test_prims_that_are_cloth_or_collider_only_because_somebody_says_so(tmp_path):
    stage = new_stage(tmp_path / "shot.usda")
    add_cloth(stage, "/World/A/Shirt")
    add_cloth(stage, "/World/B/Shirt")
    ball = add_ball(stage)
    ball.GetPrim().RemoveAPI(UsdPhysics.CollisionAPI)
    stage.Save()
    path = tmp_path / "shot.usda"
    assert [cloth.name for cloth in read_shot(path).cloths] == ["Shirt", "Shirt_2"]
    assert read_shot(path).obstacles == []
    chosen = read_shot(path, ["/World/B"], ["/World/Ball"])
    assert [str(part.mesh.GetPath()) for part in chosen.parts] == ["/World/B/Shirt"]
    assert [obstacle.name for obstacle in chosen.obstacles] == ["Ball"]
    assert chosen.cloths[0].fabric == Fabric()
    twice = read_shot(path, ["/World/B"], ["/World/Ball", "/World/Ball", "/World"])
    assert [obstacle.name for obstacle in twice.obstacles] == ["Ball"]
    denim = read_shot(path, fabric=fabrics()["denim"].fabric)
    assert [cloth.fabric.name for cloth in denim.cloths] == ["denim", "denim"]
    fitted = load_scene(path, ["stage.springs=fitted"], cloth=["/World/A"])
    assert len(BuiltScene.of(fitted).cloths[0].springs) > len(chosen.cloths[0].springs)  # to the second ring, too


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
@pytest.mark.parametrize("kind", ["Cylinder", "Cone"])
def test_cylinders_and_cones_are_meshes_along_their_axis(tmp_path, kind, axis):
    stage = new_stage(tmp_path / "shot.usda")
    add_cloth(stage)
    shape = getattr(UsdGeom, kind).Define(stage, "/World/Solid")
    shape.CreateAxisAttr(axis)
    shape.CreateRadiusAttr(0.1)
    shape.CreateHeightAttr(0.6)
    UsdPhysics.CollisionAPI.Apply(shape.GetPrim())
    stage.Save()
    (solid,) = read_shot(tmp_path / "shot.usda").obstacles
    extent = np.array(UsdGeom.Boundable.ComputeExtentFromPlugins(shape, 0.0))
    np.testing.assert_allclose((solid.points.min(axis=0), solid.points.max(axis=0)), extent, atol=1e-6)
    a, b, c = (solid.points[solid.triangles[:, i]] for i in range(3))
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)
    exact = np.pi * 0.1**2 * 0.6 / (3.0 if kind == "Cone" else 1.0)
    assert 0.99 < volume / exact < 1.0  # positive: it faces outwards; 64 sides have 0.16 % less than a circle
    if kind == "Cone":
        tip = solid.points[np.argmax(solid.points @ np.eye(3)["XYZ".index(axis)])]
        np.testing.assert_allclose(tip, 0.3 * np.eye(3)["XYZ".index(axis)], atol=1e-12)


def test_friction_of_a_collider_is_that_of_its_physics_material(tmp_path):
    stage = new_stage(tmp_path / "shot.usda")
    add_cloth(stage)
    ball = add_ball(stage)
    ice = UsdShade.Material.Define(stage, "/World/Ice")
    physics = UsdPhysics.MaterialAPI.Apply(ice.GetPrim())
    physics.CreateDynamicFrictionAttr(0.02)
    physics.CreateRestitutionAttr(0.3)
    UsdShade.MaterialBindingAPI.Apply(ball.GetPrim()).Bind(ice, materialPurpose="physics")
    stage.Save()
    (obstacle,) = read_shot(tmp_path / "shot.usda").obstacles
    np.testing.assert_allclose((obstacle.friction, obstacle.restitution), (0.02, 0.3), rtol=1e-6)


PARTS = {
    "springs": ("indices", "rest_lengths", "stiffness", "damping", "kinds"),
    "bending": ("start", "particles", "stiffness", "rest_curvature", "slip_moment"),
}
CLOTHED = [name for name in bundled_scenes() if load_scene(name).cloth]


@pytest.mark.parametrize("name", CLOTHED)
def test_every_bundled_scene_is_read_back_from_its_stage_as_it_was(tmp_path, name):
    """Cloths to a rounding of the local frame in double precision, meshes of obstacles in single precision."""
    scene = load_scene(name, ["frames=30"])
    back = load_scene(export_scene(scene, tmp_path / f"{name}.usdc"))
    assert back.model_dump(exclude={"cloth", "obstacle", "stage"}) == scene.model_dump(
        exclude={"cloth", "obstacle", "stage"}
    )
    shot = read_shot(tmp_path / f"{name}.usdc")
    cloths, obstacles = scene.build()
    for cloth, found in zip(cloths, shot.cloths, strict=True):
        assert found.fabric == dataclasses.replace(cloth.fabric, color=found.fabric.color)
        for field in ("points", "triangles", "masses", "uvs", "corner_share"):
            np.testing.assert_allclose(
                getattr(found, field), getattr(cloth, field), rtol=1e-6, atol=1e-12, err_msg=field
            )
        for part, fields in PARTS.items():
            for field in fields:
                ours, theirs = (getattr(getattr(item, part), field) for item in (cloth, found))
                np.testing.assert_allclose(theirs, ours, rtol=1e-9, atol=1e-15, err_msg=field)
        assert_same_pins(cloth, found)
    for obstacle, found in zip(obstacles, shot.obstacles, strict=True):
        assert (found.name, found.thickness, found.friction) == (obstacle.name, obstacle.thickness, obstacle.friction)
        for second in (0.0, 0.3, 1.01):
            placed = [item.matrix(second) for item in (obstacle, found)]
            np.testing.assert_allclose(*placed, atol=1e-9)
        if isinstance(obstacle, MeshObstacle):
            np.testing.assert_allclose(found.points, obstacle.points, atol=1e-7)


def assert_same_pins(cloth, found):
    for pin, other in zip(cloth.pins, found.pins, strict=True):
        assert np.array_equal(pin.indices, other.indices)
        assert (pin.motion is None) == (other.motion is None)
        if pin.motion is not None:
            for second in (0.0, 0.7, 1.9):
                ours, theirs = (m.evaluate(cloth.points[pin.indices], second) for m in (pin.motion, other.motion))
                np.testing.assert_allclose(theirs, ours, atol=1e-12)


def test_discs_jitter_and_pressure_survive_the_export(tmp_path):
    text = """
    [[cloth]]
    shape = "disc"
    radius = 0.3
    resolution = 6
    springs = "shear"
    jitter = 0.001
    velocity = [0.0, 1.0, 0.0]
    [[cloth]]
    shape = "disc"
    radius = 0.2
    resolution = 3
    springs = "woven"
    jitter = 0.001
    position = [2.0, 0.0, 0.0]
    [[cloth]]
    shape = "mesh"
    path = "warp:sphere.usd"
    scale = 0.2
    position = [1.0, 0.0, 0.0]
    springs = "woven"
    inflation = { pressure = 50.0, gas = true }
    """
    scene = scene_from_toml(text)
    cloths = scene.build()[0]
    found = read_shot(export_scene(scene, tmp_path / "scene.usdc")).cloths
    for cloth, other in zip(cloths, found, strict=True):
        np.testing.assert_allclose(other.points, cloth.points, atol=1e-7)
        np.testing.assert_allclose(other.springs.rest_lengths, cloth.springs.rest_lengths, rtol=1e-6)
        np.testing.assert_allclose(other.springs.stiffness, cloth.springs.stiffness, rtol=1e-5)
        np.testing.assert_allclose(other.woven.stiffness, cloth.woven.stiffness, rtol=1e-4)
        np.testing.assert_allclose(
            other.woven.slopes, cloth.woven.slopes, atol=1e-4 * np.abs(cloth.woven.slopes).max(initial=0.0)
        )
        assert np.array_equal(other.velocity, cloth.velocity)
        assert other.inflation == cloth.inflation
    assert [len(cloth.woven) > 0 for cloth in found] == [False, True, True]
