"""Samples made ready to be simulated, and which of them can share a model."""

import json
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

from .. import stability
from ..cloth import Cloth
from ..contact.intervals import intervals_needed
from ..contact.travel import travel_step, travels
from ..integrators import INTEGRATORS, make_integrator
from ..motion import Motion
from ..scenes import Scene
from ..scenes.built import BuiltScene, make_model
from ..stability import MAX_SUBSTEPS
from ..surface import median_edge
from .inputs import input_hashes
from .sweep import Sample

IRRELEVANT = {"title", "description", "frames", "obstacle"}  # to automatic substeps


@dataclass(frozen=True, eq=False)
class Prepared:
    """A sample with its meshes read and its substeps fixed, so that nothing about it depends on its neighbours.

    Attributes:
        sample: the sample.
        built: its scene, as the simulator takes it; ``substeps`` is a number.
        inputs: hashes of the files that it was read from, see :func:`.inputs.input_hashes`.
    """

    sample: Sample
    built: BuiltScene
    inputs: dict[str, str]

    @property
    def scene(self) -> Scene:
        """The scene, with its substeps."""
        return self.built.scene

    @cached_property
    def companions(self) -> str:
        """Samples in which this is the same can be worlds of one model, and are each what they are alone."""
        scene = self.scene
        coupled = self.built.network is not None or INTEGRATORS[scene.simulation.integrator].couples_worlds
        options = scene.simulation.model_dump(mode="json", exclude={"gravity"})
        fabrics = [cloth.fabric for cloth in self.built.cloths]
        damped = [any(f.damping_time > 0.0 for f in fabrics), scene.air.density > 0.0]  # schemes look at these
        limited = any(f.strain_limit is not None for f in fabrics)
        alone = self.sample.index if coupled else None
        facts = [scene.fps, options, contact_intervals(self.built), damped, limited, alone]
        return json.dumps(facts, sort_keys=True)

    @cached_property
    def last_motion(self) -> float:
        """When the last prescribed motion of a pin or an obstacle ends [s]; infinite if it, or the wind, goes on."""
        if self.scene.air.build(self.scene.seed).changes:
            return math.inf
        times = [0.0, *(_end(obstacle.motion) for obstacle in self.built.obstacles if obstacle.motion is not None)]
        times += [_end(pin.motion) for cloth in self.built.cloths for pin in cloth.pins if pin.motion is not None]
        samples = [getattr(obstacle, "sample_times", None) for obstacle in self.built.obstacles]
        return max([*times, *(float(own[-1]) for own in samples if own is not None)])


def prepare(sample: Sample) -> Prepared:
    """Reads the sample's meshes and fixes its substeps.

    Automatic substeps are rounded up to four significant binary digits (on average by 4 %), so that samples of much the
    same fabric can be stepped together.

    Raises:
        InputError: a mesh that cannot be read, …
        SimulationError: it would need too many substeps.
    """
    inputs = input_hashes(sample.scene)
    built = BuiltScene.of(sample.scene)
    options = sample.scene.simulation
    if options.substeps != "auto":
        return Prepared(sample, built, inputs)
    if built.network is None:
        facts = sample.scene.model_dump(mode="json", exclude=IRRELEVANT)
        if all(table.jitter == 0.0 for table in sample.scene.cloth):
            del facts["seed"]
        substeps = _substeps(json.dumps(facts, sort_keys=True), _Cloths(built.cloths, sample.scene))
    else:
        substeps = _needed(BuiltScene(sample.scene, [], [], built.network))
    detections = math.ceil(contact_intervals(built) * max(1.0, INTEGRATORS[options.integrator].steps_per_travel))
    fewest = min(MAX_SUBSTEPS, max(rounded_up(substeps), detections))
    scene = sample.scene.changed({"simulation.substeps": fewest})
    return Prepared(sample, BuiltScene(scene, built.cloths, built.obstacles, built.network), inputs)


def contact_intervals(built: BuiltScene) -> int:
    """Detections of contact among cloths in a frame; 1 where there are none."""
    if built.scene.simulation.contact != "all" or not built.cloths:
        return 1
    edge = min(median_edge(cloth.points, cloth.triangles) for cloth in built.cloths)
    return intervals_needed(edge, built.obstacles, 1.0 / built.scene.fps)


def rounded_up(substeps: int) -> int:
    """The next number with at most four significant binary digits."""
    unit = 1 << max(0, substeps.bit_length() - 4)
    return min(MAX_SUBSTEPS, -(-substeps // unit) * unit)


class _Cloths:
    """Cloths that a cache does not look at: the text beside them says what they are."""

    def __init__(self, cloths: list[Cloth], scene: Scene):
        self.cloths, self.scene = cloths, scene

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, _Cloths)

    def __hash__(self) -> int:
        return 0


@lru_cache(maxsize=256)
def _substeps(facts: str, cloths: _Cloths) -> int:
    """Automatic substeps of cloths; ``facts`` are all of the scene that has a say in them."""
    return _needed(BuiltScene(cloths.scene, cloths.cloths, [], None))


def _needed(built: BuiltScene) -> int:
    options = built.scene.simulation
    model = make_model([built])
    integrator = make_integrator(options.integrator, model, options.integrator_options)
    dt = 1.0 / built.scene.fps
    airs = [built.scene.air.build(built.scene.seed)]
    pace = stability.pace(model, integrator, airs, options.gravity)
    stable = stability.count_steps(integrator, pace.step, dt, MAX_SUBSTEPS)
    ways = 0 if options.contact == "none" else travels(travel_step(model), dt)
    return min(MAX_SUBSTEPS, max(stable, math.ceil(pace.haste * integrator.steps_per_travel * ways)))


def _end(motion: Motion) -> float:
    return math.inf if motion.loop and len(motion.times) > 1 else float(motion.times[-1])
