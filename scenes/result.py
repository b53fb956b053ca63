"""What a simulated scene amounted to."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class SimulationResult:
    """Figures of one run; the state's are those of the last frame.

    Attributes:
        scene: Name of the scene.
        integrator: Name of the integrator.
        precision: ``float32`` or ``float64``.
        device: Device it ran on.
        threads: Cores of the CPU that a frame ran on.
        frames: Frames simulated; the file has one more, the start.
        fps: Frames per second.
        substeps: Integration steps per frame.
        particles: Number of particles.
        springs: Number of springs.
        triangles: Number of triangles.
        ms_per_frame: Median wall time of a frame without writing it [ms], the first frame aside where there are others.
        compile_s: Wall time of what happens once [s]: building the model, loading or compiling kernels.
        wall_s: Wall time of everything, writing included [s].
        mean_strain: Mean of the springs' |strain|.
        max_strain: Largest |strain| of a spring.
        intersections: Pairs of cloth triangles that meet. This and the next two are the worst of all frames, the start
            included, if every frame was checked.
        obstacle_intersections: Pairs of a cloth's triangle and a box's or mesh's that meet.
        max_penetration_m: Greatest depth of a particle below an obstacle's surface [m].
        checked_frames: Frames that were checked for those three.
        bad_frames: How many of these have triangles of cloth that meet.
        contact: What contact among cloths did, see :class:`warpcloth.contact.ContactStage`; empty without it.
        untangled: What was done about intersections at the start, see :class:`warpcloth.untangle.Untangled`; empty if
            that was not asked for.
        profile_ms: Mean wall time of each stage of a frame [ms], the first frame aside where there are others; empty
            without ``profile``.
        settled: Whether the cloth has come to rest.
        solver: What the integrator says of its own work, e.g. iterations; empty for explicit ones.
        interrupted: Whether it was stopped before its last frame.
        output: The cache that was written.
    """

    scene: str
    integrator: str
    precision: str
    device: str
    threads: int
    frames: int
    fps: float
    substeps: int
    particles: int
    springs: int
    triangles: int
    ms_per_frame: float
    compile_s: float
    wall_s: float
    mean_strain: float
    max_strain: float
    intersections: int
    obstacle_intersections: int
    max_penetration_m: float
    checked_frames: int
    bad_frames: int
    contact: dict[str, Any]
    untangled: dict[str, Any]
    profile_ms: dict[str, float]
    settled: bool
    solver: dict[str, Any]
    interrupted: bool
    output: Path

    def as_dict(self) -> dict[str, Any]:
        """The figures by name."""
        return asdict(self)
