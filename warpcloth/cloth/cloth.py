"""Cloth: a rest mesh with springs, masses and pins."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import validate
from ..errors import InputError, MeshError
from ..fabric import Fabric
from ..meshes import cloth_mesh, load_mesh
from ..meshes.check import checked_arrays
from ..transforms import apply, as_matrix, unturned
from ..validate import Array, ReadOnly
from .arguments import checked_fabric, cloth_label, disc_radius, grid_resolution, grid_size, require, rigid_matrix
from .bending import BendingElements
from .bending_grid import grid_bending
from .bending_mesh import mesh_bending
from .bending_sheet import BendingSheet
from .disc import disc_points, disc_triangles, rim
from .grid import DIAGONALS, GridShape
from .inflation import Inflation, check_closed
from .pins import Pin, resolve_pins
from .springs import MESH_SPRINGS, SpringNetwork, lumped_masses, mesh_springs, triangle_areas
from .woven import WovenTriangles, woven_triangles

MAX_RINGS = 2048  # 12.6 million vertices


@dataclass(frozen=True, eq=False)
class Cloth(ReadOnly):
    """A piece of cloth on the host; all arrays are read-only.

    Args:
        name: unique within a simulation.
        points: rest pose in world space [m], shape [n, 3].
        triangles: counter-clockwise vertex indices, shape [m, 3], int32.
        springs: the spring network over the n particles.
        masses: [kg], shape [n], > 0.
        fabric: what it is made of.
        uvs: texture coordinates, shape [k, 2], or None.
        uv_indices: index into ``uvs`` of each corner, shape [m, 3], or None.
        pins: disjoint groups of held vertices.
        velocity: initial velocity of every free particle [m/s], shape [3].
        corner_share: share of each corner in its triangle's mass [-], shape [m, 3]; thirds for None.
        inflation: pressure inside a closed cloth; None: none.
        bending: bending elements over the particles.
        woven: springs along the yarns inside triangles, besides ``springs``.

    Raises:
        InputError: on values out of range; MeshError: on vertices that no triangle gives a mass.
    """

    name: str
    points: Array
    triangles: Array
    springs: SpringNetwork
    masses: Array
    fabric: Fabric
    uvs: Array = None
    uv_indices: Array = None
    pins: tuple[Pin, ...] = ()
    velocity: Array = (0.0, 0.0, 0.0)
    corner_share: Array = None
    inflation: Inflation | None = None
    bending: BendingElements = field(default_factory=BendingElements.none)
    woven: WovenTriangles = field(default_factory=WovenTriangles.none)

    def __post_init__(self):
        label = cloth_label(self.name)
        points, triangles = checked_arrays(self.points, self.triangles, label)
        values: dict[str, Any] = {"points": points, "triangles": triangles}
        values["masses"] = validate.array(self.masses, f"{label}: masses", (len(points),))
        values["velocity"] = validate.vector(self.velocity, f"{label}: velocity")
        values["pins"] = tuple(validate.listed(self.pins))
        share = np.full(triangles.shape, 1.0 / 3.0) if self.corner_share is None else self.corner_share
        values["corner_share"] = validate.array(share, f"{label}: corner_share", (len(triangles), 3))
        require(self.springs, SpringNetwork, f"{label}: springs")
        require(self.fabric, Fabric, f"{label}: fabric")
        require(self.bending, BendingElements, f"{label}: bending")
        require(self.woven, WovenTriangles, f"{label}: woven")
        for pin in values["pins"]:
            require(pin, Pin, f"{label}: each of pins")
        if self.inflation is not None:
            require(self.inflation, Inflation, f"{label}: inflation")
            check_closed(points, triangles, label)
        if (self.uvs is None) != (self.uv_indices is None):
            raise InputError(f"{validate.sentence(label)}: uvs and uv_indices must be given together.")
        if self.uvs is not None:
            values["uvs"] = validate.array(self.uvs, f"{label}: uvs", (None, 2))
            shape = (len(triangles), 3)
            values["uv_indices"] = validate.array(self.uv_indices, f"{label}: uv_indices", shape, np.int32)
        for name, value in values.items():
            object.__setattr__(self, name, value)
        self._check_references(validate.sentence(label))

    @staticmethod
    def grid(
        size: Any = (1.0, 1.0),
        resolution: Any = (32, 32),
        fabric: Fabric | None = None,
        pins: Any = None,
        transform: Any = None,
        name: str = "cloth",
        velocity: Any = (0.0, 0.0, 0.0),
        *,
        diagonals: str = "alternate",
    ) -> "Cloth":
        """A rectangle in the local xy plane, centred on the origin, facing +z; vertex (i, j) has index j nx + i.

        Args:
            size: width along x and height along y [m].
            resolution: vertices along x and along y, at least 2 each.
            fabric: defaults to ``Fabric()``.
            pins: vertex indices, "left", "right", "bottom", "top", corners such as "top_left", ``pin(...)``,
                ``pin_box(...)``, ``pin_nearest(...)``, or a list of these.
            transform: rigid 4 × 4 matrix, or translation [m].
            diagonals: "alternate" or "same" direction of the triangles' diagonals; springs do not depend on it.

        Raises:
            InputError: on a value out of range.
        """
        label = cloth_label(name)
        shape = GridShape(*grid_size(size, label), *grid_resolution(resolution, label))
        triangles = shape.triangles(validate.choice(diagonals, DIAGONALS, f"{label}: diagonals"))
        fabric, flat = checked_fabric(fabric, label), shape.points()
        placed = apply(rigid_matrix(transform, label), flat)
        return Cloth(
            name=name,
            points=placed,
            triangles=triangles,
            springs=shape.springs(flat, fabric),
            masses=shape.masses(fabric.areal_density),
            fabric=fabric,
            uvs=shape.uvs(),
            uv_indices=triangles,
            pins=resolve_pins(pins, placed, shape.named_vertices(), label),
            velocity=velocity,
            corner_share=shape.corner_share(triangles),
            bending=grid_bending(shape, placed, BendingSheet.of(fabric)),
        )

    @staticmethod
    def disc(
        radius: float = 0.5,
        resolution: int = 16,
        fabric: Fabric | None = None,
        pins: Any = None,
        transform: Any = None,
        name: str = "cloth",
        velocity: Any = (0.0, 0.0, 0.0),
        *,
        springs: str = "stretch",
    ) -> "Cloth":
        """A disc in the local xy plane, centred on the origin, facing +z: rings of nearly equilateral triangles.

        Args:
            radius: [m].
            resolution: rings around the centre, at least 1; ring i has 6 i vertices.
            pins: as for :meth:`grid`, with the names "rim" and "center".
            transform: rigid 4 × 4 matrix, or translation [m].
            springs: as for :meth:`from_mesh`.

        Raises:
            InputError: on a value out of range.
        """
        label = cloth_label(name)
        radius = disc_radius(radius, label)
        rings = validate.integer(resolution, f"{label}: resolution", minimum=1, maximum=MAX_RINGS)
        flat, triangles, fabric = disc_points(radius, rings), disc_triangles(rings), checked_fabric(fabric, label)
        placed, kind = apply(rigid_matrix(transform, label), flat), _kind(springs, label)
        named = {"rim": rim(rings), "center": np.zeros(1, np.int32)}
        return Cloth(
            name=name,
            points=placed,
            triangles=triangles,
            springs=mesh_springs(flat, triangles, fabric, kind),
            masses=lumped_masses(flat, triangles, fabric.areal_density),
            fabric=fabric,
            uvs=0.5 + 0.5 * flat[:, :2] / radius,
            uv_indices=triangles,
            pins=resolve_pins(pins, placed, named, label),
            velocity=velocity,
            bending=mesh_bending(flat, triangles, BendingSheet.of(fabric)),
            woven=woven_triangles(flat, triangles, fabric) if kind == "woven" else WovenTriangles.none(),
        )

    @staticmethod
    def from_mesh(
        source: Any,
        fabric: Fabric | None = None,
        pins: Any = None,
        transform: Any = None,
        name: str | None = None,
        velocity: Any = (0.0, 0.0, 0.0),
        *,
        springs: str = "stretch",
        prim: str | None = None,
        inflation: Inflation | None = None,
    ) -> "Cloth":
        """Cloth from a mesh file, an asset such as ``"warp:square_cloth.usd"``, or a ``trimesh.Trimesh``.

        Args:
            source: path, asset name, ``trimesh.Trimesh`` or ``TriangleMesh``; the shape read is the rest shape.
            pins: vertex indices, ``pin_box(...)``, ``pin_nearest(...)``, or a list of these.
            transform: 4 × 4 matrix, which may scale, or translation [m].
            name: defaults to the name of the file or prim.
            springs: what the mesh's springs have of the fabric: "stretch", "shear" or both, along the yarns inside its
                triangles ("woven") or between vertices ("fitted"); see :func:`~warpcloth.cloth.springs.mesh_springs`.
            prim: path or name of a mesh in a USD or glTF file with several; a parent of some means them joined.
            inflation: pressure inside a mesh that is closed.

        Raises:
            MeshError: when the mesh cannot be read, is empty, branches, or has triangles without area;
                InputError: on other values out of range.
        """
        mesh = load_mesh(source, prim=prim)
        name = mesh.name if name is None else name
        label = cloth_label(name)
        matrix = as_matrix(transform, f"{label}: transform")
        mesh = cloth_mesh(mesh.transformed(matrix))
        rest = unturned(mesh.points, matrix)  # the warp turns with the mesh
        fabric, kind = checked_fabric(fabric, label), _kind(springs, label)
        return Cloth(
            name=name,
            points=mesh.points,
            triangles=mesh.triangles,
            springs=mesh_springs(rest, mesh.triangles, fabric, kind),
            masses=lumped_masses(mesh.points, mesh.triangles, fabric.areal_density),
            fabric=fabric,
            uvs=mesh.uvs,
            uv_indices=mesh.uv_indices,
            pins=resolve_pins(pins, mesh.points, {}, label),
            velocity=velocity,
            inflation=inflation,
            bending=mesh_bending(rest, mesh.triangles, BendingSheet.of(fabric)),
            woven=woven_triangles(rest, mesh.triangles, fabric) if kind == "woven" else WovenTriangles.none(),
        )

    @property
    def area(self) -> float:
        """Area of the rest pose [m²]."""
        return float(triangle_areas(self.points, self.triangles).sum())

    @property
    def mass(self) -> float:
        """Total mass [kg]."""
        return float(self.masses.sum())

    @property
    def pinned(self) -> np.ndarray:
        """Indices of all held vertices, sorted, shape [k]."""
        groups = [pin.indices for pin in self.pins]
        return np.unique(np.concatenate(groups)) if groups else np.zeros(0, np.int32)

    def _check_references(self, label: str) -> None:
        count = len(self.points)
        light = np.flatnonzero(self.masses <= 0.0)
        if light.size:
            raise MeshError(f"{label}: vertex {light[0]} has no mass, so no triangle with an area holds it.")
        if len(self.springs) and self.springs.indices.max() >= count:
            raise InputError(f"{label}: a spring refers to vertex {self.springs.indices.max()} of {count}.")
        if self.bending.particles.max(initial=0) >= count:
            raise InputError(f"{label}: bending refers to vertex {self.bending.particles.max()} of {count}.")
        if self.woven.corners.max(initial=0) >= count:
            raise InputError(f"{label}: woven triangles refer to vertex {self.woven.corners.max()} of {count}.")
        if self.uvs is not None and self.uv_indices is not None:
            last = len(self.uvs) - 1
            if self.uv_indices.min() < 0 or self.uv_indices.max() > last:
                raise MeshError(f"{label}: uv_indices refer to texture coordinates outside 0 to {last}.")
        held = np.concatenate([np.zeros(0, np.int32), *(pin.indices for pin in self.pins)])
        if held.size and (held.min() < 0 or held.max() >= count):
            raise InputError(f"{label}: pins refer to vertices outside 0 to {count - 1}.")
        if len(np.unique(held)) < held.size:
            twice = np.flatnonzero(np.bincount(held) > 1)[0]
            raise InputError(f"{label}: vertex {twice} is in two pins, of which at least one moves.")


def _kind(springs: str, label: str) -> str:
    return validate.choice(springs, MESH_SPRINGS, f"{label}: springs")
