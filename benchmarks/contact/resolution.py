"""A scene with finer or coarser cloth."""

import math

from warpcloth.scenes.load import scene_from_data
from warpcloth.scenes.schema import Scene

from warpcloth import validate
from warpcloth.errors import InputError


def with_resolution(scene: Scene, side: int) -> Scene:
    """The scene with about ``side``² vertices in each cloth, and cells as square as they can be.

    Raises:
        InputError: ``side`` is out of range, or a cloth is a mesh from a file or a network.
    """
    side = validate.integer(side, "resolution", minimum=3, maximum=2000)
    if scene.network is not None:
        raise InputError(f"The resolution of '{scene.name}' is that of its network of springs and cannot be chosen.")
    data = scene.model_dump()
    for index, table in enumerate(scene.cloth):
        if table.shape == "mesh":
            raise InputError(f"The resolution of cloth.{index} of '{scene.name}' is that of its mesh; choose no other.")
        data["cloth"][index]["resolution"] = _rings(side) if table.shape == "disc" else _rows(table.size, side)
    return scene_from_data(data, name=scene.name, folder=scene.folder)


def _rings(side: int) -> int:
    """Rings of a disc of 1 + 3 r (r + 1) vertices."""
    return max(2, round(side / math.sqrt(3.0)))


def _rows(size: tuple[float, float], side: int) -> list[int]:
    """Vertices along the sides of a grid."""
    ratio = math.sqrt(size[0] / size[1])
    return [max(3, round(side * ratio)), max(3, round(side / ratio))]
