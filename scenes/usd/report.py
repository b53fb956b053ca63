"""What a check of a cache found."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

DEEPEST_M = 1e-3  # penetration that still counts as contact: contact response holds cloth within it [m]


@dataclass(frozen=True)
class ClothCheck:
    """One cloth, or one bare network, of a cache.

    Attributes:
        name: as given to the simulation.
        prim: path in the stage.
        particles: number of points.
        triangles: number of triangles, 0 for a network.
        frames: number of samples of its points.
        finite: whether all points, velocities and normals are finite numbers.
        max_strain: largest |length / rest length − 1| of an edge at any frame; the rest pose is the default value.
        velocity_gain: velocities over central differences of the points, fitted over all frames: 1 where they agree;
            None if nothing moves or there are too few frames.
    """

    name: str
    prim: str
    particles: int
    triangles: int
    frames: int
    finite: bool
    max_strain: float
    velocity_gain: float | None


@dataclass(frozen=True)
class CheckReport:
    """What :func:`check_cache` found.

    Attributes:
        path: the file.
        frames: number of frames.
        fps: frames per second.
        particles: points of all cloths together.
        obstacles: number of colliders in the file.
        finite: whether every sample is a finite number.
        intersections: pairs of cloth triangles that meet, at the worst of the frames that were looked at.
        obstacle_intersections: pairs of a cloth's triangle and one of a box or mesh that meet, likewise.
        checked_frames: number of frames that were looked at for these.
        max_penetration_m: greatest depth of a point below the surface of an obstacle at any frame [m].
        deepest_frame: time code of that, None if no point is ever inside.
        max_strain: largest |strain| of an edge at any frame.
        usd_errors: what is wrong with the file, a sentence each; validators' messages among them.
        cloths: each cloth by itself.
    """

    path: Path
    frames: int
    fps: float
    particles: int
    obstacles: int
    finite: bool
    intersections: int
    obstacle_intersections: int
    checked_frames: int
    max_penetration_m: float
    deepest_frame: float | None
    max_strain: float
    usd_errors: tuple[str, ...]
    cloths: tuple[ClothCheck, ...]

    @property
    def ok(self) -> bool:
        """Whether the file is sound, finite, and nowhere deeper than 1 mm in an obstacle.

        Intersections are reported, not judged: a simulation may have been run without self-contact.
        """
        return self.finite and not self.usd_errors and self.max_penetration_m <= DEEPEST_M

    def as_dict(self) -> dict[str, Any]:
        """All findings by name, and ``ok``."""
        return asdict(self) | {"ok": self.ok, "usd_errors": list(self.usd_errors)}

    def __str__(self) -> str:
        where = "" if self.deepest_frame is None else f" at frame {self.deepest_frame:g}"
        looked = "every" if self.checked_frames > 1 else "last"
        met = f"{self.intersections} intersecting pairs of triangles, {self.obstacle_intersections} with obstacles"
        size = f"{self.particles} particles, {self.obstacles} obstacles"
        lines = [
            f"{self.path.name}: {'sound' if self.ok else 'NOT sound'}",
            f"  {self.frames} frames at {self.fps:g} per second, {size}",
            f"  samples {'are all finite' if self.finite else 'are NOT all finite'}",
            f"  largest strain {100.0 * self.max_strain:.2f} %",
            f"  deepest penetration {1e3 * self.max_penetration_m:.3f} mm{where}",
            f"  {met} ({looked} frame)",
            f"  {len(self.usd_errors)} errors in the file" + (":" if self.usd_errors else ""),
        ]
        return "\n".join(lines + [f"    {error}" for error in self.usd_errors])
