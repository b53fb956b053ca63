"""A sweep: what its file says, frozen, and each of its samples as a scene."""

import copy
import hashlib
import itertools
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from .. import __version__
from ..errors import SceneError
from ..scenes import Scene, load_scene
from ..scenes.load import STAGES, bundled_scenes, find_scene, parse_toml, read_text, scene_from_data
from ..scenes.overrides import apply_overrides
from ..scenes.schema import explain, suggest
from ..scenes.schema.paths import assign
from ..validate import at_home
from .draws import coordinates, grid_coordinates, quantile
from .schema import ParameterTable, SweepTable

FORMAT = 1  # of the frozen sweep; another one means that samples would differ


@dataclass(frozen=True)
class Sample:
    """One drape of a sweep.

    Attributes:
        index: its number, from 0.
        parameters: value of each parameter by its path.
        scene: the scene that it is.
    """

    index: int
    parameters: dict[str, Any]
    scene: Scene


@dataclass(frozen=True)
class Sweep:
    """A sweep that depends on no file any more but the meshes.

    Attributes:
        name: of the sweep file, without the ending.
        table: what the file says, with patterns of files replaced by the files.
        base: the scene's tables, complete and with absolute mesh paths.
        folder: of the sweep file, where relative mesh paths among the values start from.
        own: what the scene's file itself says, where samples differ in the stage that says the rest; else None.
    """

    name: str
    table: SweepTable
    base: dict[str, Any]
    folder: Path
    own: dict[str, Any] | None = None

    @cached_property
    def coordinates(self) -> np.ndarray:
        """Of all samples, shape [count, parameters]."""
        table = self.table
        if table.design == "grid":
            return grid_coordinates(table.parameter, table.count, table.seed)
        return coordinates(table.design, table.count or 0, len(table.parameter), table.seed)

    @cached_property
    def quantiles(self) -> dict[str, Callable[[float], Any]]:
        """Of each parameter by its path: the value at a coordinate."""
        return {parameter.path: quantile(parameter) for parameter in self.table.parameter}

    @property
    def count(self) -> int:
        """Number of samples."""
        return len(self.coordinates)

    def sample(self, index: int) -> Sample:
        """The sample of that number.

        Raises:
            SceneError: its parameters do not make a scene.
        """
        pairs = zip(self.quantiles.items(), self.coordinates[index], strict=True)
        parameters = {path: value_at(float(u)) for (path, value_at), u in pairs}
        try:
            data = self._tables(parameters)
            data["seed"] = int(np.random.SeedSequence([self.table.seed, index]).generate_state(1)[0])
            for path, value in parameters.items():
                assign(data, path, copy.deepcopy(value))
                if _has_tables(value):  # complete them, for later parameters to change
                    data = _complete(scene_from_data(_absolute(data, self.folder)))
            scene = scene_from_data(_absolute(data, self.folder), name="scene", folder=Path("/"))
        except SceneError as error:
            raise SceneError(f"sample {index}: {error}") from None
        return Sample(index, parameters, scene)

    def _tables(self, parameters: dict[str, Any]) -> dict[str, Any]:
        """The scene's tables before parameters change them: of the stage that these choose, if they do."""
        if self.own is None:
            return copy.deepcopy(self.base)
        data = copy.deepcopy(self.own)
        for path, value in parameters.items():
            if path.partition(".")[0] == "stage":
                assign(data, path, copy.deepcopy(value))
        return _complete(scene_from_data(_absolute(data, self.folder)))

    def check(self) -> None:
        """Makes every sample once.

        Raises:
            SceneError: one of them is no valid scene.
        """
        for index in range(self.count):
            self.sample(index)

    def as_json(self) -> str:
        """All of it as text, the same whenever the sweep is the same."""
        facts = {"format": FORMAT, "version": __version__, "name": self.name, "folder": str(self.folder)}
        facts |= {"sweep": self.table.model_dump(mode="json", exclude_none=True), "scene": self.base}
        facts |= {} if self.own is None else {"own": self.own}
        return json.dumps(facts, sort_keys=True, indent=1, ensure_ascii=False)

    @staticmethod
    def from_json(text: str) -> "Sweep":
        """The sweep that :meth:`as_json` wrote."""
        facts = json.loads(text)
        table = SweepTable.model_validate(facts["sweep"])
        return Sweep(facts["name"], table, facts["scene"], Path(facts["folder"]), facts.get("own"))

    @property
    def identity(self) -> str:
        """A hash of all that decides what the samples are."""
        return hashlib.sha256(self.as_json().encode()).hexdigest()


def load_sweep(path: str | Path, overrides: Iterable[str] = ()) -> Sweep:
    """Reads and validates a sweep file and the scene it names.

    Args:
        path: of the TOML file.
        overrides: changes ``path=value`` of the sweep's own fields, e.g. ``count=10``.

    Raises:
        SceneError: there is no such file, or it is not a sweep; the message says where and what would be right.
    """
    file = at_home(path).absolute()
    if file.suffix != ".toml" or not file.is_file():
        near = [p.name for p in file.parent.glob("*.toml")] if file.parent.is_dir() else []
        raise SceneError(f"there is no sweep file {str(path)!r}{suggest(file.name, near)}")
    file = file.parent.resolve() / file.name  # a sweep is the same whichever way its file is named
    try:
        data = parse_toml(read_text(file))
        apply_overrides(data, overrides)
        table = SweepTable.model_validate(data)
        name = table.scene if table.scene in bundled_scenes() else str(file.parent / at_home(table.scene))
        scene, own = load_scene(name), _own_tables(name, table)
        parameters = [_with_files(parameter, file.parent) for parameter in table.parameter]
    except ValidationError as error:
        raise SceneError(f"{file.name}: {explain(error, 'the sweep')}") from None
    except SceneError as error:
        raise SceneError(f"{file.name}: {error}") from None
    table = table.model_copy(update={"parameter": parameters})
    place = scene.folder.absolute()
    base, own = _absolute(_complete(scene), place), None if own is None else _absolute(own, place)
    sweep = Sweep(file.stem, table, base, file.parent, own)
    return Sweep.from_json(sweep.as_json())  # as whoever goes on with it will read it


def _own_tables(scene: str, table: SweepTable) -> dict[str, Any] | None:
    """What a scene's file says by itself, if the sweep has a parameter for its stage."""
    if not any(parameter.path in ("stage", "stage.path") for parameter in table.parameter):
        return None
    path = find_scene(scene)
    return {"stage": {"path": path.name}} if path.suffix in STAGES else parse_toml(read_text(path))


def _with_files(parameter: ParameterTable, folder: Path) -> ParameterTable:
    """A pattern of files becomes the list of them."""
    if parameter.glob is None:
        return parameter
    pattern = at_home(parameter.glob)
    root = Path(pattern.anchor) if pattern.is_absolute() else folder
    try:
        files = sorted(str(path) for path in root.glob(str(pattern.relative_to(pattern.anchor))) if path.is_file())
    except (ValueError, IndexError):  # patterns that pathlib knows nothing to do with, such as "" and "a**"
        files = []
    if not files:
        raise SceneError(f"no file matches the pattern {parameter.glob!r} of the parameter {parameter.path!r}")
    return parameter.model_copy(update={"glob": None, "values": files})


def _has_tables(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and any(isinstance(item, dict) for item in value))


def _complete(scene: Scene) -> dict[str, Any]:
    """The tables of a scene with every field that has a value."""
    return scene.model_dump(mode="json", exclude_none=True)


def _absolute(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The same tables, with paths of meshes and stages that no longer depend on a folder."""
    lists = [tables for tables in (data.get("cloth"), data.get("obstacle")) if isinstance(tables, list)]
    for table in (*itertools.chain(*lists), data.get("stage")):
        path = table.get("path") if isinstance(table, dict) else None
        if isinstance(path, str) and not path.startswith("warp:"):
            table["path"] = str(folder / at_home(path))
    return data
