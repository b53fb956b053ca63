"""Bare networks of springs as prims: balls for the particles, straight curves for the springs."""

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from ..schema import Network
from .roles import NETWORK_ROLE, REST_LENGTHS, SPRINGS_ROLE, mark
from .samples import SAMPLE_OVERHEAD, checked, integers, vectors
from .stage import bind_color

BALL = 5.0  # diameter of the heaviest particle's ball over that of a spring
PARTICLE_COLOR = (0.72, 0.20, 0.12)
SPRING_COLOR = (0.35, 0.37, 0.42)


class NetworkPrim:
    """A network: an Xform with its ``particles`` (UsdGeomPoints) and its ``springs`` (linear UsdGeomBasisCurves).

    Both have velocities; the default value of points and extent is the start. The volume of a ball goes with its mass.

    Args:
        stage: to define it on.
        path: of the Xform.
        network: what to draw.
    """

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, network: Network):
        self.prim = UsdGeom.Xform.Define(stage, path).GetPrim()
        self.ends = np.asarray(network.springs).ravel()
        self.count = len(network.points)
        self.particles = UsdGeom.Points.Define(stage, path.AppendChild("particles"))
        self.particles.CreateIdsAttr(Vt.Int64Array(range(self.count)))
        balls = BALL * network.width * np.cbrt(network.masses / network.masses.max())
        self.particles.CreateWidthsAttr(Vt.FloatArray.FromNumpy(balls.astype(np.float32)))
        self.particles.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
        self.springs = UsdGeom.BasisCurves.Define(stage, path.AppendChild("springs"))
        self.springs.CreateTypeAttr(UsdGeom.Tokens.linear)
        self.springs.CreateCurveVertexCountsAttr(integers(np.full(len(network.springs), 2)))
        self.springs.CreateWidthsAttr([network.width])
        self.springs.SetWidthsInterpolation(UsdGeom.Tokens.constant)
        lengths = self.springs.GetPrim().CreateAttribute(REST_LENGTHS, Sdf.ValueTypeNames.DoubleArray)
        lengths.Set(Vt.DoubleArray.FromNumpy(np.ascontiguousarray(network.rest_lengths, np.float64)))
        for drawn, role, color in (
            (self.particles, NETWORK_ROLE, PARTICLE_COLOR),
            (self.springs, SPRINGS_ROLE, SPRING_COLOR),
        ):
            mark(drawn.GetPrim(), role, network.name)
            bind_color(drawn.GetPrim(), color, roughness=0.4)
        self._set_points(self.checked(network.points, "points"), Usd.TimeCode.Default())

    def write(self, code: float, points: np.ndarray, velocities: np.ndarray) -> int:
        """Sets one frame: points [m] and velocities [m/s], shape [n, 3]; returns the bytes held in memory."""
        stored, speeds = self.checked(points, "points"), self.checked(velocities, "velocities")
        held = self._set_points(stored, code)
        self.particles.GetVelocitiesAttr().Set(vectors(speeds), code)
        self.springs.GetVelocitiesAttr().Set(vectors(speeds[self.ends]), code)
        return 2 * held

    def drop(self, code: float) -> None:
        """Takes back what was set at time ``code``."""
        for drawn in (self.particles, self.springs):
            for attribute in (drawn.GetPointsAttr(), drawn.GetVelocitiesAttr(), drawn.GetExtentAttr()):
                attribute.ClearAtTime(code)

    def checked(self, values: np.ndarray, what: str) -> np.ndarray:
        """``values`` as stored; UsdError when they are not one vector per particle."""
        return checked(values, self.count, self.prim.GetName(), what)

    def _set_points(self, points: np.ndarray, code: Usd.TimeCode | float) -> int:
        held = 0
        for drawn, placed in ((self.particles, points), (self.springs, points[self.ends])):
            stored = vectors(placed)
            drawn.GetPointsAttr().Set(stored, code)
            extent = type(drawn).ComputeExtent(stored, drawn.GetWidthsAttr().Get())
            drawn.CreateExtentAttr().Set(extent, code)
            held += placed.nbytes + 2 * SAMPLE_OVERHEAD
        return held
