"""Checks of one cloth of a cache, frame by frame."""

from collections import defaultdict

import numpy as np
from pxr import Usd, UsdGeom

from ...transforms import apply
from .check_static import extent_fault, sampling_faults, topology_faults
from .faces import face_fault, mesh_triangles
from .moving import transform_codes
from .opening import world_matrix
from .report import ClothCheck
from .roles import REST_LENGTHS, REST_SHAPE, SPRINGS_ROLE, name_of, role_of
from .samples import as_vectors
from .surface import summed_area_vectors, summed_areas
from .value_types import refuse_other_types
from .velocity_fit import VelocityFit

UNIT = 1e-3  # how far from 1 the length of a normal may be
SHARP = 0.1  # normals are compared where faces do not cancel: |sum of area vectors| over sum of areas
AGREE = 0.5  # least cosine between a normal and the area-weighted one; other writers weight faces differently
PER_POINT = (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying)
REST = Usd.TimeCode.Default()


class SampleCheck:
    """Goes through one mesh, or the points or curves of a bare network. Call :meth:`frame` in order, then ``result``.

    Attributes:
        codes: time codes of its points, in order.
        frames: the same, to look one up.
        count: number of points, by its rest pose.
        triangles: of a mesh, int32, shape [m, 3].
    """

    def __init__(self, prim: Usd.Prim):
        refuse_other_types(prim)
        self.prim = prim
        self.shape = UsdGeom.PointBased(prim)
        self.mesh = UsdGeom.Mesh(prim) if prim.IsA(UsdGeom.Mesh) else None
        self.codes: list[float] = self.shape.GetPointsAttr().GetTimeSamples()
        self.frames = frozenset(self.codes)
        self.finite = True
        self.max_strain = 0.0
        self._faults: dict[str, list[Usd.TimeCode]] = defaultdict(list)
        self._moves = bool(transform_codes(prim))
        self._fit = VelocityFit(prim.GetStage().GetTimeCodesPerSecond())
        self._has_normals = self._should_have_normals()
        rest = self._rest_points()
        self.count = len(rest)
        self.triangles = self._checked_triangles(rest)
        # many writers leave the default of what they sample unset
        self._matrix = world_matrix(prim, self.codes[0] if self._moves and self.codes else REST)
        self._edges, self._rest_lengths = self._strainable(apply(self._matrix, self._unstrained(rest)))
        self._check_sampling()
        if self.shape.GetPointsAttr().Get() is not None and np.isfinite(rest).all():
            self._check_surface(rest, REST)

    @property
    def longest_edge(self) -> float:
        """Of its triangles without strain [m]; 0 for networks, which have none."""
        return float(self._rest_lengths.max(initial=0.0)) if len(self.triangles) else 0.0

    @property
    def errors(self) -> list[str]:
        """What is wrong, a sentence each; complete after :meth:`result`."""
        return [f"{self.prim.GetPath()} {fault}{_when(codes)}." for fault, codes in self._faults.items()]

    def frame(self, code: float) -> np.ndarray | None:
        """Checks the samples at ``code``; returns the points in the world [m], or None if they are unusable."""
        at = Usd.TimeCode(code)
        points = self._vectors(self.shape.GetPointsAttr(), at)
        velocities = self._vectors(self.shape.GetVelocitiesAttr(), at)
        if points is None:
            return None
        self._fit.add(code, points, velocities)
        self._check_surface(points, at)
        world = apply(world_matrix(self.prim, at) if self._moves else self._matrix, points)
        lengths = np.linalg.norm(world[self._edges[:, 1]] - world[self._edges[:, 0]], axis=1)
        self.max_strain = max(self.max_strain, float(np.abs(lengths / self._rest_lengths - 1.0).max(initial=0.0)))
        return world

    def result(self) -> ClothCheck:
        """What was found, once all frames have been gone through."""
        if self._fit.fault:
            self._faults[self._fit.fault] = []
        return ClothCheck(
            name=name_of(self.prim),
            prim=str(self.prim.GetPath()),
            particles=self.count,
            triangles=len(self.triangles),
            frames=len(self.codes),
            finite=self.finite,
            max_strain=self.max_strain,
            velocity_gain=self._fit.gain,
        )

    def _rest_points(self) -> np.ndarray:
        attribute = self.shape.GetPointsAttr()
        rest = attribute.Get()
        if rest is None:
            self._faults["has no rest pose: its points have no default value"] = []
            rest = attribute.Get(Usd.TimeCode.EarliestTime())
        points = as_vectors(rest)
        if not np.isfinite(points).all():
            self.finite = False
            self._faults["has points that are not finite"].append(REST)
        return points

    def _unstrained(self, rest: np.ndarray) -> np.ndarray:
        """Where the points are without strain: the rest pose, or a shape of its own that the mesh has for that."""
        attribute = self.prim.GetAttribute(REST_SHAPE)
        own = attribute.Get() if attribute else None
        if own is None or not len(own):
            return rest
        points = self._vectors(attribute, REST)
        return rest if points is None else points

    def _should_have_normals(self) -> bool:
        """Faceted meshes should; whatever has ``primvars:normals`` instead, or subdivides, is left alone."""
        if self.mesh is None or UsdGeom.PrimvarsAPI(self.prim).HasPrimvar("normals"):
            return False
        faceted = self.mesh.GetSubdivisionSchemeAttr().Get() == UsdGeom.Tokens.none
        return faceted or self.shape.GetNormalsAttr().HasAuthoredValue()

    def _checked_triangles(self, rest: np.ndarray) -> np.ndarray:
        none = np.zeros((0, 3), np.int32)
        if self.mesh is None:
            return none
        fault = face_fault(self.mesh, len(rest))
        self._faults.update({text: [] for text in [*topology_faults(self.mesh), *([fault] if fault else [])]})
        return none if fault or not self.finite else mesh_triangles(self.mesh, rest)

    def _strainable(self, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of points whose distance has a rest length, and those [m]: edges of triangles, springs of a network."""
        if role_of(self.prim) == SPRINGS_ROLE:
            lengths = np.array(self.prim.GetAttribute(REST_LENGTHS).Get(), float)
            return np.arange(2 * len(lengths)).reshape(-1, 2), lengths
        edges = np.unique(np.sort(self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
        lengths = np.linalg.norm(rest[edges[:, 1]] - rest[edges[:, 0]], axis=1)
        return edges[lengths > 0.0], lengths[lengths > 0.0]

    def _check_sampling(self) -> None:
        followers = [self.shape.GetVelocitiesAttr(), self.shape.GetExtentAttr()]
        if self._has_normals:
            followers.append(self.shape.GetNormalsAttr())
        self._faults.update({fault: [] for fault in sampling_faults(self.shape, followers)})

    def _check_surface(self, points: np.ndarray, at: Usd.TimeCode) -> None:
        """Extent and normals that go with ``points``."""
        fault = extent_fault(self.shape, at)
        if fault:
            self._faults[fault].append(at)
        normals = self._vectors(self.shape.GetNormalsAttr(), at) if self._has_normals else None
        if normals is None:
            return
        if np.abs(np.linalg.norm(normals, axis=1) - 1.0).max(initial=0.0) > UNIT:
            self._faults["has normals that are not of unit length"].append(at)
        if len(normals) == len(points) and len(self.triangles):
            sums, areas = summed_area_vectors(points, self.triangles), summed_areas(points, self.triangles)
            lengths = np.linalg.norm(sums, axis=1)
            clear = lengths > SHARP * areas
            if np.any(np.einsum("nc,nc->n", normals, sums)[clear] < AGREE * lengths[clear]):
                self._faults["has normals that do not fit the winding of its faces"].append(at)

    def _vectors(self, attribute: Usd.Attribute, at: Usd.TimeCode) -> np.ndarray | None:
        """The value of ``attribute``, float64, shape [n, 3]; None, and a fault, where it cannot be used."""
        value, name = attribute.Get(at), attribute.GetName()
        if value is None:
            return None  # the check of the time codes says so
        vectors = as_vectors(value)
        per_point = name != "normals" or self.shape.GetNormalsInterpolation() in PER_POINT
        if per_point and len(vectors) != self.count:
            self._faults[f"has {len(vectors)} {name} for {self.count} points"].append(at)
            return None
        if not np.isfinite(vectors).all():
            self.finite = False
            self._faults[f"has {name} that are not finite"].append(at)
            return None
        return vectors


def _when(codes: list[Usd.TimeCode]) -> str:
    frames = [code.GetValue() for code in codes if not code.IsDefault()]
    if not codes:
        return ""
    if not frames:
        return " in its default value"
    return f" at frame {frames[0]:g}" if len(frames) == 1 else f" at {len(frames)} frames, first {frames[0]:g}"
