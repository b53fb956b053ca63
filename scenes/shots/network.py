"""Bare networks of springs in a stage. No standard has words for them, so all but where they are is a note."""

from dataclasses import dataclass

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from warpcloth.errors import UsdError
from warpcloth.transforms import apply

from ..schema import Network
from ..usd.opening import local_matrix, world_matrix
from ..usd.roles import NETWORK_ROLE, REST_LENGTHS, SPRINGS_ROLE, name_of, role_of
from ..usd.samples import SAMPLE_OVERHEAD, as_vectors, checked, integers, vectors
from .notes import agree, double_vectors, doubles, note, noted

FIELDS = ("masses", "k_s", "k_d")  # noted on the particles, in SI units


@dataclass(frozen=True, eq=False)
class ShotNetwork:
    """A network, and the prims that show its particles and its springs."""

    network: Network
    particles: UsdGeom.Points
    springs: UsdGeom.BasisCurves


def note_network(prim: Usd.Prim, network: Network) -> None:
    """Notes on the prim of its particles what a network is made of."""
    kinds = Sdf.ValueTypeNames
    note(prim, "positions", double_vectors(network.points), kinds.Double3Array)
    note(prim, "springs", Vt.Vec2iArray([Gf.Vec2i(*pair) for pair in network.springs.tolist()]), kinds.Int2Array)
    for name in FIELDS:
        note(prim, name, doubles(getattr(network, name)), kinds.DoubleArray)
    note(prim, "pinned", integers(np.array(network.pinned, np.int32)), kinds.IntArray)
    note(prim, "width", network.width, kinds.Double)


def read_network(stage: Usd.Stage) -> ShotNetwork | None:
    """The network that was exported to a stage, or None.

    Raises:
        UsdError: its arrays do not fit together.
    """
    shown = {
        role: [prim for prim in stage.Traverse() if role_of(prim) == role] for role in (NETWORK_ROLE, SPRINGS_ROLE)
    }
    wanted = [prim for prim in shown[NETWORK_ROLE] if noted(prim, "springs") is not None]
    curves = [prim for prim in shown[SPRINGS_ROLE] if wanted and name_of(prim) == name_of(wanted[0])]
    if not wanted or not curves:
        return None
    prim = wanted[0]
    local = as_vectors(UsdGeom.Points(prim).GetPointsAttr().Get())
    points = apply(world_matrix(prim, Usd.TimeCode.Default()), agree(noted(prim, "positions"), local))
    pairs = np.array(noted(prim, "springs"), np.int32).reshape(-1, 2)
    values = {name: np.array(noted(prim, name) or [], float) for name in FIELDS}
    lengths = np.array(curves[0].GetAttribute(REST_LENGTHS).Get() or [], float)
    sizes = {"masses": len(points), "k_s": len(pairs), "k_d": len(pairs)}
    if any(len(values[name]) != size for name, size in sizes.items()) or len(lengths) != len(pairs):
        what = f"{len(points)} particles and {len(pairs)} springs"
        raise UsdError(f"Network {prim.GetPath()} has {what}, but its masses, stiffnesses or lengths are not as many.")
    pinned = sorted(noted(prim, "pinned") or [])
    width = noted(prim, "width") or 0.01
    network = Network(name_of(prim), points, springs=pairs, rest_lengths=lengths, pinned=pinned, width=width, **values)
    return ShotNetwork(network, UsdGeom.Points(prim), UsdGeom.BasisCurves(curves[0]))


class NetworkOver:
    """Points, velocities and extents of a network's particles and springs, in their own frame and units.

    Args:
        layer: a stage of nothing but the layer to write to.
        part: the network and its prims.
    """

    def __init__(self, layer: Usd.Stage, part: ShotNetwork):
        self.network = part.network
        everything = np.arange(len(part.network.points))
        self.drawn = [
            (shape, type(shape)(layer.OverridePrim(shape.GetPath())), which)
            for shape, which in ((part.particles, everything), (part.springs, np.ravel(part.network.springs)))
        ]
        self.to_local = local_matrix(part.particles.GetPrim(), Usd.TimeCode.Default())

    def write(self, code: float, points: np.ndarray, velocities: np.ndarray) -> int:
        """Sets one frame: points [m] and velocities [m/s], shape [n, 3]; returns the bytes held in memory."""
        placed = apply(self.to_local, self.checked(points, "points").astype(float))
        speeds = self.checked(velocities, "velocities").astype(float) @ self.to_local[:3, :3].T
        for source, over, which in self.drawn:
            stored = vectors(placed[which])
            over.CreatePointsAttr().Set(stored, code)
            over.CreateVelocitiesAttr().Set(vectors(speeds[which]), code)
            over.CreateExtentAttr().Set(type(source).ComputeExtent(stored, source.GetWidthsAttr().Get()), code)
        return 5 * placed.nbytes + 6 * SAMPLE_OVERHEAD

    def drop(self, code: float) -> None:
        """Takes back what was set at time ``code``."""
        for _, over, _ in self.drawn:
            for attribute in (over.GetPointsAttr(), over.GetVelocitiesAttr(), over.GetExtentAttr()):
                if attribute:
                    attribute.ClearAtTime(code)

    def checked(self, values: np.ndarray, what: str) -> np.ndarray:
        """``values`` as stored; UsdError when they are not one vector per particle."""
        return checked(values, len(self.network.points), self.network.name, what)
