"""Checking a finished cache."""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom

from ...diagnostics import PenetrationProbe
from ...errors import InputError, UsdError
from ...facets import faceted
from ...intersections import count_intersections
from ...obstacles import Obstacle
from .check_samples import SampleCheck
from .check_stage import metadata_errors, range_errors, validator_errors, why_nothing_is_sampled
from .failures import as_usd_error, quietly
from .obstacle_reader import is_collider, read_obstacles
from .opening import frame_rate, open_stage
from .report import CheckReport, ClothCheck
from .roles import CLOTH_ROLE, NETWORK_ROLE, SPRINGS_ROLE, role_of

ROLES = (CLOTH_ROLE, NETWORK_ROLE, SPRINGS_ROLE)


def check_cache(path: str | os.PathLike, *, every: bool = False) -> CheckReport:
    """Verifies a cache of ours, or any stage in which points of meshes are sampled.

    Looked at: metadata; at every frame and in the rest pose, whether samples are there, finite, of the right number and
    consistent with each other (extents, normals against winding, velocities against points), and topology fixed;
    strain of every edge; penetration into the colliders in the file; intersections; OpenUSD's and NVIDIA's validators.

    Args:
        path: a USD file.
        every: count intersections at every frame, not at the last one only.

    Raises:
        UsdError: when the file cannot be read, or nothing in it has sampled points.
    """
    stage = open_stage(path)
    with as_usd_error(f"Cannot read {path}"), quietly():
        return _Check(Path(path), stage).report(every)


class _Check:
    """The check of one stage."""

    def __init__(self, path: Path, stage: Usd.Stage):
        self.path, self.stage = path, stage
        prims = simulated_prims(stage)
        if not prims:
            raise UsdError(f"Nothing to check in {path}: {why_nothing_is_sampled(stage)}.")
        self.ours = any(role_of(prim) for prim in prims)
        self.errors = metadata_errors(stage, self.ours)
        self.checks = [SampleCheck(prim) for prim in prims]
        self.obstacles = self._read_obstacles()
        longest = max(check.longest_edge for check in self.checks)
        self.facets = faceted([(0, obstacle, -1) for obstacle in self.obstacles], {0: longest})
        self.probe = PenetrationProbe(self.obstacles)
        self.codes = sorted(set().union(*(check.codes for check in self.checks)))
        self.deepest = 0.0
        self.deepest_frame: float | None = None
        self.intersections, self.obstacle_intersections = 0, 0

    def report(self, every: bool) -> CheckReport:
        for code in self.codes:
            states = [check.frame(code) if code in check.frames else None for check in self.checks]
            self._measure_contact(code, states, crossings=every or code == self.codes[-1])
        cloths = self._cloths()
        errors = [*self.errors, *range_errors(self.stage, self.codes)]
        errors += [error for check in self.checks for error in check.errors]
        return CheckReport(
            path=self.path.absolute(),
            frames=len(self.codes),
            fps=frame_rate(self.stage),
            particles=sum(cloth.particles for cloth in cloths),
            obstacles=len(self.obstacles),
            finite=all(check.finite for check in self.checks),
            intersections=self.intersections,
            obstacle_intersections=self.obstacle_intersections,
            checked_frames=len(self.codes) if every else 1,
            max_penetration_m=self.deepest,
            deepest_frame=self.deepest_frame,
            max_strain=max(cloth.max_strain for cloth in cloths),
            usd_errors=tuple(errors + validator_errors(self.stage)),
            cloths=tuple(cloths),
        )

    def _read_obstacles(self) -> list[Obstacle]:
        try:
            return read_obstacles(self.stage)
        except InputError as error:  # the rest can still be checked
            self.errors.append(str(error))
            return []

    def _measure_contact(self, code: float, states: Sequence[np.ndarray | None], crossings: bool) -> None:
        present = [(check, points) for check, points in zip(self.checks, states, strict=True) if points is not None]
        if not present:
            return
        points = np.concatenate([state for _, state in present])
        depth = self.probe.depth(points, code / self.stage.GetTimeCodesPerSecond())
        if depth > self.deepest:
            self.deepest, self.deepest_frame = depth, code
        if crossings:
            starts = np.cumsum([0] + [len(state) for _, state in present])
            faces = [check.triangles + start for (check, _), start in zip(present, starts, strict=False)]
            self._count_intersections(points, np.concatenate(faces), code / self.stage.GetTimeCodesPerSecond())

    def _count_intersections(self, points: np.ndarray, faces: np.ndarray, t: float) -> None:
        corners = [points, *(solid.at(t) for solid in self.facets)]
        starts = np.cumsum([len(part) for part in corners])
        solids = [solid.triangles + start for solid, start in zip(self.facets, starts, strict=False)]
        cloth, solid = count_intersections(np.concatenate(corners), np.concatenate([faces, *solids]), len(faces))
        self.intersections = max(self.intersections, cloth)
        self.obstacle_intersections = max(self.obstacle_intersections, solid)

    def _cloths(self) -> list[ClothCheck]:
        """One entry for each cloth, and one for a network, whose points have no strain but its curves have."""
        results = [(role_of(check.prim), check.result()) for check in self.checks]
        strains = {result.name: result.max_strain for role, result in results if role == SPRINGS_ROLE}
        return [
            replace(result, max_strain=strains[result.name]) if role == NETWORK_ROLE else result
            for role, result in results
            if role != SPRINGS_ROLE
        ]


def simulated_prims(stage: Usd.Stage) -> list[Usd.Prim]:
    """What a cache of ours has under its cloths; of another stage, the meshes with sampled points but no collider."""
    prims = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
    shapes = [prim for prim in prims if prim.IsA(UsdGeom.PointBased)]
    sampled = [prim for prim in shapes if UsdGeom.PointBased(prim).GetPointsAttr().GetNumTimeSamples() > 0]
    if any(role_of(prim) in ROLES for prim in sampled):
        return [prim for prim in shapes if role_of(prim) in ROLES]
    return [prim for prim in sampled if prim.IsA(UsdGeom.Mesh) and not is_collider(prim)]
