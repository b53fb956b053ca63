"""The files that a scene is read from, which its results must not replace."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from warpcloth.errors import UsdError
from warpcloth.meshes import resolve_asset
from warpcloth.meshes.load import USD_SUFFIXES
from warpcloth.validate import at_home

from .schema import Scene
from .schema.files import mesh_source

if TYPE_CHECKING:
    from pxr import Usd


def spare_sources(output: Path, scene: Scene) -> None:
    """Refuses to write over a mesh or stage of a scene, or over a file that one of these refers to.

    Args:
        output: file to write.
        scene: one whose meshes and stage are there and can be read.

    Raises:
        UsdError: naming the file.
    """
    output = at_home(output)
    if not os.path.exists(output):  # which, unlike Path.exists, takes names that no file can have
        return
    named = [getattr(table, "path", None) for table in (*scene.cloth, *scene.obstacle, scene.stage)]
    paths = [resolve_asset(mesh_source(path, scene.folder)) for path in named if path is not None]
    spare([output], (file for path in paths for file in _files(path)), f"scene {scene.name}")


def spare(outputs: Iterable[Path], sources: Iterable[Path], whole: str) -> None:
    """Refuses to write over ``sources``, which ``whole`` consists of; errors as for :func:`spare_sources`."""
    there = {source.resolve() for source in sources}
    for output in outputs:
        if output.resolve() in there:
            rule = "give another name with -o"
            raise UsdError(f"Cannot write {output.name}: the {whole} consists of it; {rule}.")


def layer_files(stage: "Usd.Stage") -> list[Path]:
    """The files that a stage consists of."""
    from pxr import Ar

    # what lies in a package has a path such as set.usdz[table.usda]
    paths = [layer.realPath for layer in stage.GetUsedLayers() if layer.realPath]
    return [Path(Ar.SplitPackageRelativePathOuter(path)[0]) for path in paths]


def _files(path: Path) -> list[Path]:
    """A mesh file or stage, and the files that it refers to."""
    if path.suffix.lower() not in USD_SUFFIXES:
        return [path]
    from pxr import Usd

    from .usd.failures import quietly

    with quietly():
        return [path, *layer_files(Usd.Stage.Open(str(path.absolute())))]
