"""Scenes as the simulator sees them: one model of one or several scenes, and what of it belongs to which."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpcloth.cloth import Cloth
from warpcloth.errors import InputError
from warpcloth.model import Model
from warpcloth.simulation import Simulation
from warpcloth.validate import at_home

from .schema import Network, Scene
from .schema.values import FARTHEST
from .sources import spare_sources
from .usd import CacheWriter

if TYPE_CHECKING:
    from .shots.shot import Shot
    from .usd.frames import FrameWriter


FARTHEST_CLOTH = 2.0 * FARTHEST  # m; a grid of the largest size at the farthest position lies within


@dataclass(frozen=True, eq=False)
class BuiltScene:
    """A scene with its cloths and obstacles, or its network, as the simulator takes them; ``shot`` is its stage."""

    scene: Scene
    cloths: list[Cloth]
    obstacles: list[Any]
    network: Network | None
    shot: "Shot | None" = None

    @staticmethod
    def of(scene: Scene) -> "BuiltScene":
        """Builds all that the scene describes.

        Raises:
            InputError: a mesh that cannot be read, a pin that finds no vertex, …
        """
        if scene.stage is not None:
            shot = _shot(scene)
            network = None if shot.network is None else shot.network.network
            built = BuiltScene(scene, shot.cloths, shot.obstacles, network, shot)
        else:
            built = BuiltScene(scene, *scene.build(), scene.build_network())
        if scene.simulation.precision == "float32":
            _refuse_far_cloth(built.cloths)
        return built

    def writer(self, output: Path) -> CacheWriter:
        """A cache for this scene, with all there is to see.

        Raises:
            UsdError: nothing can be written to ``output``, or the scene is read from it.
        """
        spare_sources(output, self.scene)
        shown = self.cloths if self.network is None else [self.network]
        return CacheWriter(output, shown, self.obstacles, self.scene.fps, provenance(self.scene))

    def result_writer(self, output: Path) -> "FrameWriter":
        """A cache for this scene; that of a stage is a layer over it."""
        if self.shot is None:
            return self.writer(output)
        from .shots.layers import ShotWriter

        return ShotWriter(output, self.shot, self.scene.fps, provenance(self.scene), self.scene.frames)


def _refuse_far_cloth(cloths: Sequence[Cloth]) -> None:
    """Refuses cloth that stages or mesh files have so far out that single precision cannot tell its points apart."""
    for cloth in cloths:
        reach = float(np.abs(cloth.points).max())
        if reach > FARTHEST_CLOTH:
            raise InputError(
                f"Cloth '{cloth.name}' reaches {reach:,.0f} m from the origin, too far for single precision; move or "
                f"scale it to within {FARTHEST_CLOTH:,.0f} m, or use precision float64."
            )


def _shot(scene: Scene) -> "Shot":
    """What is simulated of the scene's stage."""
    from .shots.shot import read_shot

    table = scene.stage
    assert table is not None
    fabric = None if table.fabric is None else table.fabric.build()
    return read_shot(scene.folder / at_home(table.path), table.cloth, table.collider, fabric, table.springs)


def provenance(scene: Scene) -> dict[str, Any]:
    """Facts about a scene that its cache keeps."""
    options = scene.simulation
    return {
        "version": version("warpcloth"),
        "scene": scene.name,
        "integrator": options.integrator,
        "integrator_options": options.integrator_options,
        "substeps": str(options.substeps),
        "precision": options.precision,
        "device": options.device,
        "seed": scene.seed,
    }


def make_model(scenes: Sequence[BuiltScene]) -> Model:
    """A world for each scene; they have the same device and precision. A network has a model for itself."""
    options = scenes[0].scene.simulation
    placed: dict[str, Any] = {
        "device": None if options.device == "auto" else options.device,
        "precision": options.precision,
    }
    net = scenes[0].network
    if net is None:
        return Model.build_worlds([(built.cloths, built.obstacles) for built in scenes], **placed)
    laws = (net.springs, net.rest_lengths, net.k_s, net.k_d)
    return Model.from_springs(net.points, net.masses, *laws, net.pinned, **placed)


def make_simulation(
    scenes: Sequence[BuiltScene],
    model: Model,
    *,
    profile: bool = False,
    untangled: bool = False,
    check_start: bool = True,
    threads: int | None = None,
) -> Simulation:
    """The simulation of :func:`make_model`'s model; but for gravity and air the scenes have the same options.

    Args:
        scenes: what the model was made of. model: the model.
        profile, untangled, check_start, threads: see :class:`warpcloth.Simulation`.

    Raises:
        InputError: an option that the integrator does not take.
        BadStartError: cloth starts inside an obstacle, or intersecting.
    """
    table = scenes[0].scene.simulation
    return Simulation(
        model,
        integrator=table.integrator,
        integrator_options=table.integrator_options,
        gravity=[built.scene.simulation.gravity for built in scenes],
        substeps=table.substeps,
        contact=table.contact,
        air=[built.scene.air.build(built.scene.seed) for built in scenes],
        profile=profile,
        untangled=untangled,
        check_start=check_start,
        threads=threads,
    )


def by_cloth(scenes: Sequence[BuiltScene], model: Model, values: np.ndarray) -> list[dict[str, np.ndarray]]:
    """For each scene the rows of ``values``, one per particle of the model, that belong to each of its cloths."""
    if scenes[0].network is not None:
        return [{scenes[0].network.name: values}]
    rows: list[dict[str, np.ndarray]] = [{} for _ in scenes]
    for cloth in model.cloths:
        rows[cloth.world][cloth.name] = values[cloth.start : cloth.stop]
    return rows
