"""Which prims of a stage are cloth."""

from collections.abc import Iterator, Sequence
from difflib import get_close_matches

from pxr import Sdf, Usd, UsdGeom

from warpcloth.errors import UsdError
from warpcloth.meshes.usd import is_shown

from ..usd.roles import SIM_API, has_schema, name_of

BODY_API = "PhysicsDeformableBodyAPI"


def cloth_meshes(stage: Usd.Stage, wanted: Sequence[str], file: str) -> list[UsdGeom.Mesh]:
    """The meshes that are cloth, in the order of the stage.

    Args:
        stage: any stage.
        wanted: paths of meshes, or of parents of some; if there are none, meshes that are surface deformables.
        file: name of the stage, for messages.

    Raises:
        UsdError: there is no cloth, or a path that leads to none.
    """
    meshes = list(_meshes(stage))
    if wanted:
        chosen = {mesh.GetPath() for path in wanted for mesh in _below(stage, path, meshes, file)}
    else:
        chosen = {mesh.GetPath() for mesh in meshes if is_deformable(mesh.GetPrim())}
    found = [mesh for mesh in meshes if mesh.GetPath() in chosen]
    if not found:
        some = ", ".join(str(mesh.GetPath()) for mesh in meshes[:3]) + (", …" if len(meshes) > 3 else "")
        hint = f"choose from its meshes with --cloth ({some})" if meshes else "it has no mesh at all"
        raise UsdError(f"Nothing in {file} says that it is cloth by {SIM_API}; {hint}.")
    return found


def is_deformable(prim: Usd.Prim) -> bool:
    """Whether a prim is the simulated surface of a deformable body that is enabled."""
    if not has_schema(prim, SIM_API):
        return False
    body = prim
    while body and not has_schema(body, BODY_API):
        body = body.GetParent()
    enabled = (body or prim).GetAttribute("physics:bodyEnabled")
    return not enabled or enabled.Get() is not False


def cloth_names(meshes: Sequence[UsdGeom.Mesh]) -> list[str]:
    """A name for each mesh: its own, numbered where that occurs again."""
    names: list[str] = []
    for mesh in meshes:
        base = candidate = name_of(mesh.GetPrim())
        number = 1
        while candidate in names:
            number += 1
            candidate = f"{base}_{number}"
        names.append(candidate)
    return names


def prim_at(stage: Usd.Stage, path: str, file: str) -> Usd.Prim:
    """The prim at a path that a user has given.

    Raises:
        UsdError: there is none, and the message has the closest path; or it is abstract or inactive.
    """
    prim = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    if prim and prim.IsAbstract():
        rule = "name one that inherits from it or refers to it"
        raise UsdError(f"Prim {path} in {file} is or belongs to a class, which is nowhere itself; {rule}.")
    if prim and prim.IsActive() and not prim.IsPseudoRoot():
        return prim
    off = _inactive(stage, path)
    if off:
        what = f"Prim {path} in {file} is inactive" if off == path else f"In {file}, {off} above {path} is inactive"
        raise UsdError(f"{what} and takes part in nothing; activate it or name another prim.")
    every = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
    known = [str(prim.GetPath()) for prim in every if not prim.IsPseudoRoot()]
    close = get_close_matches(path, known, n=1, cutoff=0.5)
    raise UsdError(f"There is no prim {path} in {file}" + (f"; did you mean {close[0]}?" if close else "."))


def _inactive(stage: Usd.Stage, path: str) -> str | None:
    """Path of the inactive prim that is at a path, or above it: OpenUSD does not know what is below that."""
    places = Sdf.Path(path).GetPrefixes() if Sdf.Path.IsValidPathString(path) else []
    prims = [stage.GetPrimAtPath(place) for place in places]
    return next((str(prim.GetPath()) for prim in prims if prim and not prim.IsActive()), None)


def is_scattered(prim: Usd.Prim) -> bool:
    """Whether a prim is or belongs to a prototype of a point instancer, and so has no place of its own."""
    while prim and not prim.IsA(UsdGeom.PointInstancer):
        prim = prim.GetParent()
    return bool(prim)


def _meshes(stage: Usd.Stage) -> Iterator[UsdGeom.Mesh]:
    """All meshes, those of instances too, but not what a point instancer scatters: those have no place of their own."""
    walk = iter(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    for prim in walk:
        if prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()
        elif prim.IsA(UsdGeom.Mesh):
            yield UsdGeom.Mesh(prim)


def _below(stage: Usd.Stage, path: str, meshes: Sequence[UsdGeom.Mesh], file: str) -> list[UsdGeom.Mesh]:
    prim = prim_at(stage, path, file)
    below = [mesh for mesh in meshes if mesh.GetPath().HasPrefix(prim.GetPath())]
    found = [mesh for mesh in below if mesh.GetPrim() == prim or is_shown(mesh)] or below
    if not found and is_scattered(prim):
        rule = "make its instances prims of their own"
        raise UsdError(f"Prim {path} in {file} is scattered by a point instancer and cannot be cloth; {rule}.")
    if not found:
        kind = prim.GetTypeName() or "prim"
        raise UsdError(f"Prim {path} in {file} is a {kind} with no mesh in it, and cloth must be a mesh.")
    return found
