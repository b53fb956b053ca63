"""Small USD stages with cloth in them, as other tools make them."""

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade

AXES = {"Z": np.eye(3), "Y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])}  # from Z up


def new_stage(path, *, up="Z", metres=1.0, kilograms=1.0, rate=24.0, fps=None, start=0.0, frames=4) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    UsdPhysics.SetStageKilogramsPerUnit(stage, kilograms)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(fps or rate)
    stage.SetStartTimeCode(start)
    stage.SetEndTimeCode(start + frames * rate / (fps or rate))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    return stage


def to_stage(stage: Usd.Stage, points) -> list[tuple[float, ...]]:
    """Points in metres and Z up as the stage has them."""
    turned = np.asarray(points, float).reshape(-1, 3) @ AXES[UsdGeom.GetStageUpAxis(stage)].T
    return [tuple(point) for point in (turned / UsdGeom.GetStageMetersPerUnit(stage)).tolist()]


def sheet(n: int = 5, size: float = 0.4, height: float = 0.5) -> tuple[np.ndarray, list[int], list[int]]:
    """A square of n × n points in metres with (n − 1)² quads."""
    u = (np.arange(n) / (n - 1) - 0.5) * size
    points = np.array([(x, y, height) for y in u for x in u])
    corners = [
        [j * n + i, j * n + i + 1, (j + 1) * n + i + 1, (j + 1) * n + i] for j in range(n - 1) for i in range(n - 1)
    ]
    return points, [4] * len(corners), [vertex for face in corners for vertex in face]


def add_mesh(stage: Usd.Stage, path: str, mesh=None) -> UsdGeom.Mesh:
    points, counts, indices = sheet() if mesh is None else mesh
    prim = UsdGeom.Mesh.Define(stage, path)
    prim.CreatePointsAttr(to_stage(stage, points))
    prim.CreateFaceVertexCountsAttr(list(counts))
    prim.CreateFaceVertexIndicesAttr(list(indices))
    prim.CreateSubdivisionSchemeAttr("none")
    prim.CreateNormalsAttr([(0.0, 0.0, 1.0) if UsdGeom.GetStageUpAxis(stage) == "Z" else (0.0, 1.0, 0.0)] * len(points))
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(prim.GetPointsAttr().Get()))
    return prim


def add_cloth(stage: Usd.Stage, path: str = "/World/Shirt", mesh=None, **material: float) -> UsdGeom.Mesh:
    """A surface deformable; ``material`` has values of its physics material, in the stage's units."""
    prim = add_mesh(stage, path, mesh)
    prim.GetPrim().AddAppliedSchema("PhysicsSurfaceDeformableSimAPI")
    UsdPhysics.CollisionAPI.Apply(prim.GetPrim())
    if material:
        bound = UsdShade.Material.Define(stage, "/World/Fabric")
        bound.GetPrim().AddAppliedSchema("PhysicsSurfaceDeformableMaterialAPI")
        for name, value in material.items():
            bound.GetPrim().CreateAttribute(f"physics:{name}", Sdf.ValueTypeNames.Float).Set(value)
        UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(bound, materialPurpose="physics")
    return prim


def set_thickness(mesh: UsdGeom.Mesh, value: float) -> None:
    prim = mesh.GetPrim()
    prim.CreateAttribute("physics:thicknesses", Sdf.ValueTypeNames.FloatArray).Set([value])
    prim.CreateAttribute("physics:thicknesses:elementType", Sdf.ValueTypeNames.Token).Set("constant")


def add_ball(
    stage: Usd.Stage, path: str = "/World/Ball", radius: float = 0.2, center=(0.0, 0.0, 0.2)
) -> UsdGeom.Sphere:
    ball = UsdGeom.Sphere.Define(stage, path)
    ball.CreateRadiusAttr(radius / UsdGeom.GetStageMetersPerUnit(stage))
    ball.AddTranslateOp().Set(Gf.Vec3d(*to_stage(stage, center)[0]))
    UsdPhysics.CollisionAPI.Apply(ball.GetPrim())
    return ball


def pin_points(mesh: UsdGeom.Mesh, indices, element: str = "point") -> None:
    UsdGeom.Subset.CreateGeomSubset(mesh, "pins", element, list(indices), "pins")


def small_shot(path: Path, **metadata) -> Path:
    """A cloth with two held corners over a ball."""
    stage = new_stage(path, **metadata)
    pin_points(add_cloth(stage), [0, 4])
    add_ball(stage)
    stage.Save()
    return path


def cached_points(path, prim: str, code: float) -> np.ndarray:
    """World positions of a mesh in the stage's own axes and units."""
    stage = Usd.Stage.Open(str(path))
    mesh = UsdGeom.Mesh.Get(stage, prim)
    matrix = np.array(UsdGeom.Xformable(mesh).ComputeLocalToWorldTransform(code))
    return np.array(mesh.GetPointsAttr().Get(code), float) @ matrix[:3, :3] + matrix[3, :3]
