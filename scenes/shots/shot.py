"""A stage as the simulator sees it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pxr import Sdf, Usd, UsdGeom

from warpcloth.cloth import Cloth
from warpcloth.errors import UsdError
from warpcloth.fabric import Fabric
from warpcloth.meshes.usd import is_shown
from warpcloth.obstacles import Obstacle

from ..usd.failures import as_usd_error, quietly
from ..usd.moving import transform_codes
from ..usd.obstacle_reader import is_collider, is_collider_group, is_solid, read_obstacle
from ..usd.opening import world_matrix
from .cloth_prims import cloth_meshes, cloth_names, is_deformable, is_scattered, prim_at
from .cloth_reader import ShotCloth, read_cloth
from .motions import noted_motion, same_motion
from .network import ShotNetwork, read_network
from .opening import first_code, open_shot


@dataclass(frozen=True, eq=False)
class Shot:
    """What of a stage is simulated.

    Attributes:
        path: of its file.
        stage: it, open; never written to.
        start: time code of second 0.
        parts: its cloths.
        obstacles: what they collide with [m], Z up.
        colliders: paths of shapes that are colliders only because a user, or a prim above them, said so.
        network: a bare network of springs in place of cloths and obstacles, or None.
    """

    path: Path
    stage: Usd.Stage
    start: float
    parts: list[ShotCloth]
    obstacles: list[Obstacle]
    colliders: tuple[Sdf.Path, ...]
    network: ShotNetwork | None = None

    @property
    def cloths(self) -> list[Cloth]:
        """The cloths alone."""
        return [part.cloth for part in self.parts]


def read_shot(
    path: Path,
    cloth: Sequence[str] = (),
    collider: Sequence[str] = (),
    fabric: Fabric | None = None,
    springs: str | None = None,
) -> Shot:
    """Reads what is to be simulated from a stage.

    Args:
        path: of a USD file.
        cloth: paths of prims that are cloth, see :func:`cloth_meshes`.
        collider: paths of further colliders, or of parents of some.
        fabric: what the cloth is made of; None: as its materials say.
        springs: see :meth:`warpcloth.Cloth.from_mesh`; None: as its meshes say.

    Raises:
        UsdError: the stage cannot be read, has no cloth, or something in it cannot be used; MeshError: likewise.
    """
    stage = open_shot(path)
    with as_usd_error(f"Cannot read {path.name}"), quietly():
        start = first_code(stage)
        network = None if cloth else read_network(stage)
        if network is not None:
            return Shot(path, stage, start, [], [], (), network)
        meshes = cloth_meshes(stage, cloth, path.name)
        names = cloth_names(meshes)
        parts = [read_cloth(mesh, name, start, fabric, springs) for mesh, name in zip(meshes, names, strict=True)]
        marked, added = _colliders(stage, collider, {mesh.GetPath() for mesh in meshes}, path.name)
        obstacles = [_obstacle(prim, start) for prim in [*marked, *added]]
    return Shot(path, stage, start, parts, obstacles, tuple(prim.GetPath() for prim in added))


def _colliders(
    stage: Usd.Stage, named: Sequence[str], cloth: set[Sdf.Path], file: str
) -> tuple[list[Usd.Prim], list[Usd.Prim]]:
    """Shapes that say that they are colliders, and those of which a user, or a prim above them, says so."""
    every = list(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    marked = [prim for prim in every if is_collider(prim) and prim.GetPath() not in cloth]
    added: dict[Sdf.Path, Usd.Prim] = {}
    for where in named:
        shapes = _shapes(prim_at(stage, where, file))
        if not shapes:
            raise UsdError(f"Prim {where} in {file} has no shape in it that cloth could collide with.")
        both = next((prim for prim in shapes if prim.GetPath() in cloth), None)
        if both is not None:
            rule = f"give other colliders than {where}"
            raise UsdError(f"Prim {both.GetPath()} in {file} cannot be both cloth and collider; {rule}.")
        added |= {prim.GetPath(): prim for prim in shapes}
    grouped = [shape for prim in every if is_collider_group(prim) for shape in _shapes(prim)]
    added |= {prim.GetPath(): prim for prim in grouped if prim.GetPath() not in cloth}
    return marked, [prim for prim in added.values() if prim not in marked]


def _shapes(top: Usd.Prim) -> list[Usd.Prim]:
    """A shape, and the shapes below it: solid ones, and of these the visible ones, if there are any."""
    below = Usd.PrimRange(top, Usd.TraverseInstanceProxies())
    found = [prim for prim in below if prim.IsA(UsdGeom.Gprim) and not is_deformable(prim)]
    solid = [prim for prim in found if prim == top or is_solid(prim)]
    return [prim for prim in solid if prim == top or is_shown(UsdGeom.Imageable(prim))] or solid or found


def _obstacle(prim: Usd.Prim, start: float) -> Obstacle:
    """A collider, moving by the keys noted on it as long as its samples say the same."""
    if is_scattered(prim):
        rule = "make its instances prims of their own"
        raise UsdError(f"Collider {prim.GetPath()} is scattered by a point instancer, which cannot be read; {rule}.")
    obstacle = read_obstacle(prim, start)
    rest = world_matrix(prim, Usd.TimeCode.Default())
    motion, codes = noted_motion(prim, rest), transform_codes(prim)
    if motion is None or getattr(obstacle, "sample_times", None) is not None:
        return obstacle
    seconds = [(code - start) / prim.GetStage().GetTimeCodesPerSecond() for code in codes]
    matrices = [world_matrix(prim, code) for code in codes]
    agrees = same_motion(motion, obstacle.centre, rest, seconds, matrices)
    return replace(obstacle, motion=motion) if agrees else obstacle
