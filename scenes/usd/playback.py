"""Playing a cache back: what is in it, and where it is at each frame."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom

from ...errors import UsdError
from ...obstacles import Obstacle
from ...transforms import apply
from .check import simulated_prims
from .check_stage import why_nothing_is_sampled
from .faces import mesh_triangles
from .failures import as_usd_error, quietly
from .obstacle_reader import read_obstacles
from .opening import frame_rate, open_stage, world_matrix
from .roles import NETWORK_ROLE, SIM_API, SPRINGS_ROLE, has_schema, name_of, numbers, role_of
from .samples import as_vectors
from .value_types import refuse_other_types

PLAIN = (0.85, 0.82, 0.74)
THIN = 0.001  # [m], of cloth that does not say


@dataclass(frozen=True, eq=False)
class PlayedCloth:
    """A mesh with sampled points.

    Attributes:
        name: of the cloth.
        rest: rest pose [m], shape [n, 3].
        triangles: shape [m, 3], int32.
        uvs: texture coordinates of each corner, shape [m, 3, 2], or None.
        color: linear red, green, blue.
        thickness: [m].
        fabric: name of the fabric; empty where the file has none.
    """

    name: str
    rest: np.ndarray
    triangles: np.ndarray
    uvs: np.ndarray | None
    color: tuple[float, float, float]
    thickness: float
    fabric: str
    prim: Usd.Prim


@dataclass(frozen=True, eq=False)
class PlayedNetwork:
    """Balls and springs: ``radii`` of the balls [m], shape [n], ``width`` of the springs [m], two colours."""

    name: str
    radii: np.ndarray
    width: float
    ball_color: tuple[float, float, float]
    spring_color: tuple[float, float, float]
    particles: Usd.Prim
    springs: Usd.Prim


class Playback:
    """An open cache.

    Args:
        path: a cache of ours, or any stage in which points of meshes are sampled.

    Raises:
        UsdError: the file cannot be read, or nothing in it moves; InputError: its meshes or colliders are not usable.

    Attributes:
        cloths, networks, obstacles: what is in it; lengths in metres, Z up.
        codes: time codes of the frames, in order.
        fps: frames per second; there may be more time codes.
    """

    def __init__(self, path: str | os.PathLike):
        self.path = Path(path)
        self.stage = open_stage(path)
        with as_usd_error(f"Cannot read {path}"), quietly():
            prims = simulated_prims(self.stage)
            if not prims:
                raise UsdError(f"There is nothing to play in {path}: {why_nothing_is_sampled(self.stage)}.")
            self.codes = sorted(
                {code for prim in prims for code in UsdGeom.PointBased(prim).GetPointsAttr().GetTimeSamples()}
            )
            self.fps, self._rate = frame_rate(self.stage), self.stage.GetTimeCodesPerSecond()
            self.obstacles: list[Obstacle] = read_obstacles(self.stage, self.codes[0])
            self.cloths = [_cloth(prim) for prim in prims if prim.IsA(UsdGeom.Mesh)]
            self.networks = _networks(prims)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.codes)

    def time(self, frame: int) -> float:
        """Time of a frame [s], from the first one on: shots may start at any time code."""
        return (self.codes[frame] - self.codes[0]) / self._rate

    def points(self, item: PlayedCloth | PlayedNetwork, frame: int) -> np.ndarray:
        """Positions of a cloth's vertices or a network's balls [m], shape [n, 3]."""
        return _points(item.prim if isinstance(item, PlayedCloth) else item.particles, self.codes[frame])

    def has_velocities(self, cloth: PlayedCloth) -> bool:
        """Whether the file has velocities of a cloth's vertices."""
        return UsdGeom.PointBased(cloth.prim).GetVelocitiesAttr().GetNumTimeSamples() > 0

    def velocities(self, cloth: PlayedCloth, frame: int) -> np.ndarray:
        """Velocities of a cloth's vertices [m/s], shape [n, 3]; zero where the file has none."""
        values = as_vectors(UsdGeom.PointBased(cloth.prim).GetVelocitiesAttr().Get(self.codes[frame]))
        if len(values) != len(cloth.rest):
            return np.zeros_like(cloth.rest)
        return values @ world_matrix(cloth.prim, self.codes[frame])[:3, :3].T

    def segments(self, network: PlayedNetwork, frame: int) -> np.ndarray:
        """Both ends of each spring [m], shape [s, 2, 3]."""
        return _points(network.springs, self.codes[frame]).reshape(-1, 2, 3)


def can_play(path: str | os.PathLike) -> bool:
    """Whether anything in a USD file moves as cloth does; not what is animated in a stage that is to be simulated yet.

    Raises:
        UsdError: the file cannot be read.
    """
    with as_usd_error(f"Cannot read {path}"), quietly():
        stage = open_stage(path)
        prims = simulated_prims(stage)
        every = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
        done = any(role_of(prim) for prim in prims)
        return bool(prims) and (done or not any(has_schema(prim, SIM_API) for prim in every))


def _cloth(prim: Usd.Prim) -> PlayedCloth:
    refuse_other_types(prim)
    mesh, first = UsdGeom.Mesh(prim), Usd.TimeCode.EarliestTime()
    code = Usd.TimeCode.Default() if role_of(prim) else first
    rest = _points(prim, code)
    triangles = mesh_triangles(mesh, rest)
    return PlayedCloth(
        name=name_of(prim),
        rest=rest,
        triangles=triangles,
        uvs=_corner_uvs(mesh, triangles),
        color=_color(prim),
        thickness=numbers(prim, "thickness").get("thickness", THIN),
        fabric=prim.GetCustomDataByKey("warpcloth:fabric") or "",
        prim=prim,
    )


def _networks(prims: list[Usd.Prim]) -> list[PlayedNetwork]:
    springs = {name_of(prim): prim for prim in prims if role_of(prim) == SPRINGS_ROLE}
    return [
        PlayedNetwork(
            name=name_of(prim),
            radii=0.5 * np.array(UsdGeom.Points(prim).GetWidthsAttr().Get(), float),
            width=float(UsdGeom.Curves(springs[name_of(prim)]).GetWidthsAttr().Get()[0]),
            ball_color=_color(prim),
            spring_color=_color(springs[name_of(prim)]),
            particles=prim,
            springs=springs[name_of(prim)],
        )
        for prim in prims
        if role_of(prim) == NETWORK_ROLE
    ]


def _points(prim: Usd.Prim, code: Usd.TimeCode | float) -> np.ndarray:
    return apply(world_matrix(prim, code), as_vectors(UsdGeom.PointBased(prim).GetPointsAttr().Get(code)))


def _color(prim: Usd.Prim) -> tuple[float, float, float]:
    values = UsdGeom.Gprim(prim).GetDisplayColorAttr().Get(Usd.TimeCode.EarliestTime())
    red, green, blue = (min(1.0, max(0.0, float(channel))) for channel in (values[0] if values else PLAIN))
    return red, green, blue


def _corner_uvs(mesh: UsdGeom.Mesh, triangles: np.ndarray) -> np.ndarray | None:
    """Texture coordinates per corner, where the file has them for triangles as they are; else None."""
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st")
    flat = primvar.ComputeFlattened() if primvar else None
    if flat is None:
        return None
    values = np.array(flat, float)
    if primvar.GetInterpolation() == UsdGeom.Tokens.vertex and triangles.max() < len(values):
        return values[triangles]
    whole = len(mesh.GetFaceVertexCountsAttr().Get()) == len(triangles)
    left = mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded
    if len(values) != triangles.size or not whole:
        return None
    return values.reshape(-1, 3, 2)[:, ::-1] if left else values.reshape(-1, 3, 2)
