"""A mesh of a stage as a cloth."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from warpcloth.cloth import Cloth, Inflation
from warpcloth.errors import InputError, UsdError
from warpcloth.fabric import Fabric
from warpcloth.meshes import TriangleMesh
from warpcloth.meshes.check import refuse_non_finite
from warpcloth.meshes.usd import prim_mesh
from warpcloth.validate import sentence

from ..usd.faces import changing_faces
from ..usd.opening import world_matrix
from ..usd.roles import REST_SHAPE, SIM_API, has_schema
from ..usd.samples import as_vectors
from ..usd.value_types import refuse_other_types
from .materials import read_fabric
from .notes import noted
from .pins import MeshAnimation, read_pins
from .rest_shapes import read_rest_shape

SINGLE = 4.0 * np.finfo(np.float32).eps  # relative, of coordinates in a stage
FLAT = "flat"  # bends to be flat, whatever the rest shape


@dataclass(frozen=True, eq=False)
class ShotCloth:
    """A cloth, and the mesh it comes from.

    Attributes:
        mesh: the prim.
        cloth: what is simulated, in metres and Z up.
        particle_of: particle of each of the mesh's points, −1 for points that no face uses, shape [n]. Points in
            the same place at rest are one particle, see :meth:`warpcloth.meshes.TriangleMesh.welded`.
    """

    mesh: UsdGeom.Mesh
    cloth: Cloth
    particle_of: np.ndarray


def read_cloth(
    mesh: UsdGeom.Mesh, name: str, start: float, fabric: Fabric | None = None, springs: str | None = None
) -> ShotCloth:
    """The cloth that a mesh is at time code ``start``.

    Its rest shape is ``physics:restShapePoints``, or else the default value of its points, or else their first sample.

    Args:
        mesh: the prim.
        name: to give to the cloth.
        start: time code of second 0.
        fabric: what it is made of; None: by its material.
        springs: see :meth:`warpcloth.Cloth.from_mesh`; None: by its own attribute. A grid has its own.

    Raises:
        UsdError: its topology changes, or its attributes, fabric or pins cannot be used; MeshError: it is not fit to
            be cloth.
    """
    prim = mesh.GetPrim()
    refuse_other_types(prim)
    _check_topology(mesh)
    animation = MeshAnimation.of(mesh, start)
    whole = prim_mesh(mesh, str(prim.GetPath()))
    rest, particle_of = replace(whole, points=_rest_points(mesh, whole)).weld()
    first = animation.points(start)
    options = {
        "name": name,
        "fabric": read_fabric(prim) if fabric is None else fabric,
        "pins": read_pins(animation, first, particle_of),
        "velocity": noted(prim, "velocity") or (0.0, 0.0, 0.0),
    }
    try:
        kind = springs or noted(prim, "springs") or "stretch"
        cloth = _built(prim, rest, world_matrix(prim, start), kind, options)
    except InputError as error:
        raise type(error)(f"Prim {prim.GetPath()} cannot be cloth: {error}") from error
    cloth = _bent(prim, cloth)
    of_particle = np.zeros(len(cloth.points), np.int64)
    of_particle[particle_of[particle_of >= 0]] = np.flatnonzero(particle_of >= 0)
    return ShotCloth(mesh, _starting(cloth, first[of_particle]), particle_of)


def _check_topology(mesh: UsdGeom.Mesh) -> None:
    changing = changing_faces(mesh)
    if changing:
        what = f"{changing} that changes over time"
        raise UsdError(f"Cloth {mesh.GetPath()} has a {what}; cloth keeps its faces from beginning to end.")


def _rest_points(mesh: UsdGeom.Mesh, whole: TriangleMesh) -> np.ndarray:
    """Rest shape in the mesh's own frame, shape [n, 3]."""
    prim = mesh.GetPrim()
    attribute = prim.GetAttribute(REST_SHAPE)
    rest = as_vectors(attribute.Get()) if attribute else np.zeros((0, 3))
    if not len(rest):
        return whole.points
    label = f"cloth {prim.GetPath()}: {REST_SHAPE}"
    if len(rest) != len(whole.points):
        rule = f"must be one for each of its {len(whole.points)} points"
        raise UsdError(f"{sentence(label)} {rule}, and there are {len(rest)}.")
    refuse_non_finite(rest, label)
    return rest


def _built(prim: Usd.Prim, rest: TriangleMesh, matrix: np.ndarray, springs: str, options: dict[str, Any]) -> Cloth:
    """The cloth at rest where the prim is."""
    shape = read_rest_shape(prim)
    if shape is not None and len(rest.points) == shape.vertices:
        cloth = shape.cloth(prim, matrix, rest.triangles, springs, options)
        if cloth is not None:
            return cloth
    pressure = noted(prim, "pressure")
    inflation = None
    if pressure is not None:
        more = {"ambient": noted(prim, "ambient")} if noted(prim, "ambient") is not None else {}
        inflation = Inflation(pressure, bool(noted(prim, "gas")), **more)
    return Cloth.from_mesh(rest, transform=matrix, springs=springs, inflation=inflation, **options)


def _bent(prim: Usd.Prim, cloth: Cloth) -> Cloth:
    """The cloth with rest curvature as ``physics:restBendAnglesDefault`` says, which by default is none."""
    attribute = prim.GetAttribute("physics:restBendAnglesDefault")
    said = attribute.Get() if attribute else None
    if (said or FLAT) != FLAT or not has_schema(prim, SIM_API) or not len(cloth.bending):
        return cloth
    flat = np.zeros_like(cloth.bending.rest_curvature)
    return replace(cloth, bending=replace(cloth.bending, rest_curvature=flat))


def _starting(cloth: Cloth, first: np.ndarray) -> Cloth:
    """The cloth with its particles at ``first`` [m], shape [n, 3], if they are anywhere but at rest."""
    rounding = SINGLE * np.abs(first).max()
    return cloth if np.abs(first - cloth.points).max() <= rounding else replace(cloth, points=first)
