"""Scenes as USD stages that other tools can read, and that simulate like the scene."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdUtils

from warpcloth.cloth import Cloth
from warpcloth.errors import InputError, UsdError
from warpcloth.obstacles import Obstacle
from warpcloth.transforms import apply, placement

from ..schema import Scene
from ..schema.cloth import ClothTable, DiscTable, GridTable
from ..sources import spare_sources
from ..usd.failures import as_usd_error
from ..usd.mesh_prims import ClothPrim
from ..usd.network_prims import NetworkPrim
from ..usd.obstacle_prims import ObstaclePrim
from ..usd.paths import Target, output_target, publish
from ..usd.roles import SIM_API
from ..usd.samples import integers
from ..usd.stage import CLOTH, MATERIALS, OBSTACLES, ROOT, create_stage, prim_names, usd_dictionary
from ..usd.writer import surroundings
from .cloth_prims import BODY_API
from .materials import write_material
from .motions import note_motion
from .network import note_network
from .notes import NOTES, note
from .pins import FAMILY
from .rest_shapes import RestShape

MESH = "mesh"  # below the Xform that carries a cloth's name


def export_scene(scene: Scene, path: str | os.PathLike) -> Path:
    """Writes a scene as a USD stage; returns the path.

    Cloths are surface deformables with a physics material, pins subsets of their points, obstacles colliders with
    sampled transforms. What USD has no words for is noted as ``warpcloth:…``.

    Args:
        scene: with cloths, or a bare network of springs, which only warpcloth finds in the stage again.
        path: ``.usd``, ``.usda``, ``.usdc`` or ``.usdz``.

    Raises:
        InputError: the scene is a stage already, or cannot be built; UsdError: ``path`` cannot be written, or the
            scene is read from it.
    """
    if scene.stage is not None:
        raise InputError(f"Scene '{scene.name}' is a USD stage already, {scene.stage.path}.")
    target = output_target(path)
    cloths, obstacles = scene.build()
    network = scene.build_network()
    spare_sources(target.final, scene)
    try:
        stage = create_stage(target, scene.fps, {"scene": scene.name})
        _physics_scene(stage, scene)
        bodies = zip(scene.cloth, cloths, prim_names([cloth.name for cloth in cloths]), strict=True)
        for table, cloth, name in bodies:
            _cloth(stage, table, cloth, name)
        if network is not None:
            drawn = NetworkPrim(stage, CLOTH.AppendChild(prim_names([network.name])[0]), network)
            note_network(drawn.particles.GetPrim(), network)
        _obstacles(stage, scene, cloths, obstacles)
        stage.SetEndTimeCode(scene.frames)
        _save(stage, target)
    finally:
        target.discard()
    return target.final


def _obstacles(stage: Usd.Stage, scene: Scene, cloths: list[Cloth], obstacles: list[Obstacle]) -> None:
    """Obstacles with samples at every frame, and the motions that these are of."""
    if not obstacles:
        return
    around, names = surroundings(cloths), prim_names([obstacle.name for obstacle in obstacles])
    for obstacle, name in zip(obstacles, names, strict=True):
        drawn = ObstaclePrim(stage, OBSTACLES.AppendChild(name), obstacle, around)
        note_motion(drawn.prim, obstacle.motion, drawn.placement)
        for frame in range(scene.frames + 1):
            drawn.write(frame, frame / scene.fps)


def _physics_scene(stage: Usd.Stage, scene: Scene) -> None:
    """Gravity for all, and how warpcloth simulates the scene."""
    physics = UsdPhysics.Scene.Define(stage, ROOT.AppendChild("PhysicsScene"))
    gravity = np.array(scene.simulation.gravity, float)
    strength = float(np.linalg.norm(gravity))
    direction = gravity / strength if strength > 0.0 else np.array([0.0, 0.0, -1.0])
    physics.CreateGravityDirectionAttr(Gf.Vec3f(*direction.tolist()))
    physics.CreateGravityMagnitudeAttr(strength)
    tables = scene.model_dump(include={"title", "description", "seed", "simulation", "air"}, exclude_none=True)
    del tables["simulation"]["device"]  # of the machine, not of the scene
    physics.GetPrim().SetCustomDataByKey(NOTES, usd_dictionary(tables))


def _cloth(stage: Usd.Stage, table: ClothTable, cloth: Cloth, name: str) -> None:
    """A cloth: an Xform that places it, and in it the mesh in its own frame."""
    matrix = placement(table.position, np.radians(table.rotation), getattr(table, "scale", 1.0))
    body = UsdGeom.Xform.Define(stage, CLOTH.AppendChild(name))
    body.GetPrim().AddAppliedSchema(BODY_API)
    body.AddTransformOp().Set(Gf.Matrix4d(*matrix.T.ravel().tolist()))
    local = replace(cloth, points=apply(np.linalg.inv(matrix), cloth.points), pins=())
    prim = ClothPrim(stage, body.GetPath().AppendChild(MESH), local).prim
    prim.AddAppliedSchema(SIM_API)
    UsdPhysics.CollisionAPI.Apply(prim)
    _rest(prim, table, cloth)
    write_material(prim, MATERIALS.AppendChild(f"{name}_fabric"), cloth.fabric)
    for pin, subset in zip(cloth.pins, prim_names([FAMILY] * len(cloth.pins)), strict=True):
        indices = integers(pin.indices)
        made = UsdGeom.Subset.CreateGeomSubset(UsdGeom.Mesh(prim), subset, UsdGeom.Tokens.point, indices, FAMILY)
        note_motion(made.GetPrim(), pin.motion, matrix)


def _rest(prim: Usd.Prim, table: ClothTable, cloth: Cloth) -> None:
    """What the cloth is at rest, how it starts, and what is in it."""
    kinds = Sdf.ValueTypeNames
    prim.CreateAttribute(
        "physics:restBendAnglesDefault", kinds.Token, custom=False, variability=Sdf.VariabilityUniform
    ).Set("restShape")
    springs = getattr(table, "springs", None)
    note(prim, "springs", springs, kinds.Token)
    if isinstance(table, GridTable):
        RestShape("grid", table.size, table.resolution).write(prim)
    elif isinstance(table, DiscTable):
        RestShape("disc", (table.radius,), (table.resolution,)).write(prim)
    if np.any(cloth.velocity):
        note(prim, "velocity", Gf.Vec3d(*cloth.velocity.tolist()), kinds.Double3)
    if cloth.inflation is not None:
        note(prim, "pressure", cloth.inflation.pressure, kinds.Double)
        note(prim, "gas", cloth.inflation.gas, kinds.Bool)
        note(prim, "ambient", cloth.inflation.ambient, kinds.Double)


def _save(stage: Usd.Stage, target: Target) -> None:
    """The finished stage in its final format and under its final name."""
    layer, done = stage.GetRootLayer(), True
    with as_usd_error(f"Cannot write {target.final.name}"):
        layer.Save()
        if target.final.suffix == ".usda":
            done = layer.Export(str(target.converted))
        elif target.final.suffix == ".usdz":
            name = target.final.with_suffix(".usdc").name
            done = UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(target.partial)), str(target.converted), name)
        if not done:
            raise UsdError(f"Cannot write {target.final.name}: the stage could not be converted.")
        publish(target)
