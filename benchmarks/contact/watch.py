"""One scene simulated with every frame checked."""

import time
import warnings
from dataclasses import asdict, dataclass, field
from typing import Any

from warpcloth.scenes.built import BuiltScene, make_model, make_simulation
from warpcloth.scenes.schema import Scene

from warpcloth.errors import ContactWarning, SimulationError
from warpcloth.simulation import Simulation

DEEPEST = 1e-4  # [m] of penetration that is still none
STRETCHED = 1.0  # mean strain beyond which cloth counts as torn apart


@dataclass
class Outcome:
    """What was seen of a scene; ``failures`` says in words what must not happen and did, and at which frame.

    Attributes:
        frames, wanted: frames simulated, and how many there are. particles, substeps: of the simulation.
        intersections, obstacle_intersections: pairs of triangles that meet, in the worst frames.
        penetration_m: greatest depth of a particle in an obstacle [m].
        mean_strain, max_strain: of the structural springs, in the worst frames; end_strain: the mean in the last one.
        stopped: whether an error ended the simulation. torn: whether the cloth was stretched beyond all use at the end.
        locked: whether the guard had to hold much of the cloth back for long.
        held, pinched, impacts, rounds: what the guard did in all; see ``ClothContact.metrics``.
        cpu_s: processor time [s], compiling included.
    """

    frames: int = 0
    wanted: int = 0
    particles: int = 0
    substeps: int = 0
    intersections: int = 0
    obstacle_intersections: int = 0
    penetration_m: float = 0.0
    mean_strain: float = 0.0
    max_strain: float = 0.0
    end_strain: float = 0.0
    stopped: bool = False
    torn: bool = False
    locked: bool = False
    held: int = 0
    pinched: int = 0
    impacts: int = 0
    rounds: int = 0
    cpu_s: float = 0.0
    failures: list[str] = field(default_factory=list)

    @property
    def finished(self) -> bool:
        """Whether all frames were simulated."""
        return self.frames == self.wanted

    def as_dict(self) -> dict[str, Any]:
        """The fields, ready for JSON."""
        return {**asdict(self), "finished": self.finished}


def watch(scene: Scene, seconds: float | None = None) -> Outcome:
    """Simulates a scene and checks every frame, for at most so many seconds of processor time.

    Raises:
        InputError: the scene cannot be built.
    """
    begun, out = time.process_time(), Outcome(wanted=scene.frames)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            built = BuiltScene.of(scene)
            simulation = make_simulation([built], make_model([built]))
            out.particles = simulation.model.particle_count
            for number in range(1, scene.frames + 1):
                simulation.step(1.0 / scene.fps)
                look(simulation, number, out)
                if seconds is not None and time.process_time() - begun > seconds:
                    break
        except SimulationError as error:
            out.stopped = True
            out.failures.append(f"frame {out.frames + 1}: {error}")
    out.torn = out.end_strain > STRETCHED
    if out.torn:
        out.failures.append(f"frame {out.frames}: mean strain of {out.end_strain:.0%}")
    out.locked = any(issubclass(item.category, ContactWarning) for item in caught)
    out.cpu_s = time.process_time() - begun
    return out


def look(simulation: Simulation, number: int, out: Outcome) -> None:
    """Adds to ``out`` what frame ``number`` shows; a kind of failure is told once, at its first frame."""
    found = simulation.metrics()
    meeting = found["intersections"] + found["obstacle_intersections"]
    depth = found["max_penetration_m"]
    if meeting > 0 and out.intersections + out.obstacle_intersections == 0:
        out.failures.append(f"frame {number}: {meeting} pairs of triangles meet")
    if depth > DEEPEST and out.penetration_m <= DEEPEST:
        out.failures.append(f"frame {number}: a particle is {1e3 * depth:.2g} mm deep in an obstacle")
    out.frames, out.substeps, out.end_strain = number, simulation.substeps, found["mean_strain"]
    out.intersections = max(out.intersections, found["intersections"])
    out.obstacle_intersections = max(out.obstacle_intersections, found["obstacle_intersections"])
    out.penetration_m = max(out.penetration_m, depth)
    out.mean_strain = max(out.mean_strain, found["mean_strain"])
    out.max_strain = max(out.max_strain, found["max_strain"])
    for name in ("held", "pinched", "impacts", "rounds"):
        setattr(out, name, found.get(f"contact_{name}", 0))
