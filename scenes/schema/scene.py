"""The whole scene: what a scene file holds."""

import dataclasses
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Discriminator, Field, PrivateAttr, ValidationError, model_validator

from warpcloth import validate
from warpcloth.cloth import Cloth
from warpcloth.errors import InputError, SceneError

from .air import AirTable
from .cloth import DiscTable, GridTable, MeshClothTable
from .messages import explain
from .network import Network, NetworkTable
from .obstacle import BoxTable, CapsuleTable, LatheTable, MeshObstacleTable, PlaneTable, SphereTable
from .paths import assign
from .simulation import SimulationTable
from .stage import StageTable
from .table import Table, field
from .values import MOST_FRAMES, MOST_VERTICES, Number, Text, refuse

AnyCloth = Annotated[GridTable | DiscTable | MeshClothTable, Discriminator("shape")]
AnyObstacle = Annotated[
    PlaneTable | SphereTable | CapsuleTable | BoxTable | LatheTable | MeshObstacleTable, Discriminator("shape")
]


@dataclasses.dataclass(frozen=True)
class _Source:
    """Name of the file that a scene is from, for messages; scenes that differ in nothing else are equal."""

    file: str = dataclasses.field(default="", compare=False)


class Scene(Table):
    """A scene: cloths (or a network of springs), obstacles, and how long and how finely they are simulated."""

    title: Annotated[str, Text(most=200)] = field("", "One line for lists of scenes.")
    description: Annotated[str, Text()] = field("", "What there is to see.")
    frames: Annotated[int, Number("", 1, MOST_FRAMES, whole=True)] = field(
        120, "Frames to simulate; the file begins with frame 0, the start, and ends with this one."
    )
    fps: Annotated[float, Number("1/s", 0.001, 1e5)] = field(24.0, "Frames per second.")
    seed: Annotated[int, Number("", 0, 2**32 - 1, whole=True)] = field(0, "Seed of all random numbers in the scene.")
    simulation: SimulationTable = field(SimulationTable(), "How it is simulated.")
    air: AirTable = field(AirTable(), "The air around the cloths.")
    cloth: list[AnyCloth] = Field([], description="The cloths.", max_length=10_000)
    obstacle: list[AnyObstacle] = Field([], description="What the cloths collide with.", max_length=10_000)
    network: NetworkTable | None = field(None, "A bare network of springs instead of cloths.")
    stage: StageTable | None = field(None, "A USD stage with the cloths and what they collide with.")

    _name: str = PrivateAttr("scene")
    _folder: Path = PrivateAttr(Path())
    _source: _Source = PrivateAttr(_Source())

    @property
    def name(self) -> str:
        """Name of the scene: that of its file, without the ending."""
        return self._name

    @property
    def folder(self) -> Path:
        """Folder that relative mesh paths start from."""
        return self._folder

    @property
    def cloth_names(self) -> list[str]:
        """Names of the cloths, as given or made up."""
        return _names([(table.name, "cloth") for table in self.cloth])

    @property
    def obstacle_names(self) -> list[str]:
        """Names of the obstacles, as given or made up."""
        return _names([(table.name, table.shape) for table in self.obstacle])

    def placed(self, name: str, folder: Path, source: str = "") -> Self:
        """The same scene, with a name, the folder that its mesh paths start from, and its file's name for messages."""
        scene = self.model_copy()
        scene._name, scene._folder, scene._source = name, folder, _Source(source)
        return scene

    def changed(self, values: Mapping[str, Any]) -> Self:
        """The same scene with some fields changed, and validated again.

        Args:
            values: By dotted path of the field, e.g. ``{"frames": 10, "simulation.substeps": 4}``; numpy's scalars are
                numbers, too.

        Raises:
            SceneError: A path leads nowhere, or a value is not one that its field can have.
            InputError: The values are not given by paths.
        """
        if not isinstance(values, Mapping) or not all(isinstance(path, str) for path in values):
            raise InputError(f'Values must be a dict such as {{"frames": 10}}, got {validate.shown(values)}.')
        data = self.model_dump()
        for path, value in values.items():
            assign(data, path, value.item() if isinstance(value, np.generic) else value)
        try:
            return type(self).model_validate(data).placed(self._name, self._folder, self._source.file)
        except ValidationError as error:
            raise SceneError(explain(error)) from None

    @model_validator(mode="after")
    def _something_to_simulate(self) -> Self:
        whole = {"[network]": self.network, "[stage]": self.stage}
        alone = [name for name, table in whole.items() if table is not None]
        if not self.cloth and not alone:
            raise refuse("must have a [[cloth]], a [network] or a [stage] to simulate")
        others = [name for name, there in (("[[cloth]]", self.cloth), ("[[obstacle]]", self.obstacle)) if there]
        others += alone[1:]
        if alone and others:
            raise refuse(f"must not have {others[0]} beside a {alone[0]}, which is simulated alone")
        if self.network is not None and (any(self.air.wind) or self.air.turbulence > 0.0):
            raise refuse("must not have wind beside a [network], which has no surface that air could push")
        return self

    @model_validator(mode="after")
    def _not_too_many_vertices(self) -> Self:
        count = sum(table.vertices for table in self.cloth if not isinstance(table, MeshClothTable))
        if count > MOST_VERTICES:
            raise refuse(f"must have at most {MOST_VERTICES:,} vertices of cloth in all, and has {count:,}")
        return self

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        given = [table.name for table in (*self.cloth, *self.obstacle) if table.name is not None]
        twice = [name for name, count in Counter(given).items() if count > 1]
        if twice:
            raise refuse(f"must give every cloth and obstacle its own name, but {twice[0]!r} occurs twice")
        return self

    def build(self) -> tuple[list[Cloth], list[Any]]:
        """The simulator's cloths and obstacles; both empty for a network or a stage, which are not made of tables.

        Raises:
            InputError: A mesh that cannot be read, a pin that finds no vertex, …; the message names file and table.
        """
        file = f"{self._source.file}: " if self._source.file else ""
        cloths = [
            self._jittered(_located(f"{file}cloth.{index}", table.build, name, self._folder), table.jitter, index)
            for index, (table, name) in enumerate(zip(self.cloth, self.cloth_names, strict=True))
        ]
        obstacles = [
            _located(f"{file}obstacle.{index}", table.build, name, self._folder)
            for index, (table, name) in enumerate(zip(self.obstacle, self.obstacle_names, strict=True))
        ]
        return cloths, obstacles

    def build_network(self) -> Network | None:
        """The network of springs as arrays, or ``None`` where the scene has cloths."""
        return None if self.network is None else self.network.build()

    def _jittered(self, cloth: Cloth, deviation: float, index: int) -> Cloth:
        """The cloth with its unpinned points displaced at random; its springs keep their rest lengths."""
        if deviation == 0.0:
            return cloth
        noise = np.random.default_rng([self.seed, index]).normal(0.0, deviation, cloth.points.shape)
        for pin in cloth.pins:
            noise[pin.indices] = 0.0
        return dataclasses.replace(cloth, points=cloth.points + noise)


def _located(where: str, build: Any, *arguments: Any) -> Any:
    """What ``build`` returns; its errors say which table of the scene they are about."""
    try:
        return build(*arguments)
    except InputError as error:
        raise SceneError(f"{where}: {error}") from error


def _names(wanted: list[tuple[str | None, str]]) -> list[str]:
    """Given names as they are; the others from their kind, numbered where that occurs more than once."""
    taken = {name for name, _ in wanted if name is not None}
    names = []
    for name, kind in wanted:
        number, candidate = 1, kind
        while name is None and candidate in taken:
            number += 1
            candidate = f"{kind}_{number}"
        names.append(name or candidate)
        taken.add(names[-1])
    return names
