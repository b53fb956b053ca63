"""Random cloths and obstacles: tables of a scene file."""

from typing import Any

import numpy as np

from warpcloth.fabric_library import fabrics
from warpcloth.transforms import rotation_matrix

from .draw import Draw

Table = dict[str, Any]
COARSE = 0.025  # [m] finest cells for explicit schemes, with fabric soft enough for some hundred substeps
# Assets: path, scale at which all of it is within a metre of its middle, and that middle in the file [m].
MESHES = (
    ("warp:bunny.usd", 0.9, (-0.149, -0.073, 0.831)),
    ("warp:bear.usd", 0.19, (0.0, 0.0, 2.771)),
    ("warp:rocks.usd", 0.05, (0.07, 0.028, 5.234)),
    ("warp:cube.usd", 0.577, (0.0, 0.0, 0.0)),
    ("warp:sphere.usd", 1.0, (0.0, 0.0, 0.0)),
)


def random_cloth(draw: Draw, explicit: bool, most: float = 0.8, grid: bool = False) -> Table:
    """A cloth in the xy plane, of random shape (or a grid), size, cells and fabric, at most ``most`` [m] wide."""
    width = draw.number(0.3 * most, most)
    cell = draw.number(COARSE, 0.05) if explicit else draw.number(0.01, 0.05)
    table: Table = {"fabric": random_fabric(draw, explicit)}
    if draw.chance(0.2) and not grid:
        rings = int(np.clip(round(0.5 * width / cell), 2, 18))
        return {"shape": "disc", "radius": round(0.5 * width, 4), "resolution": rings, **table}
    size = [width, draw.number(0.4 * width, width)]
    resolution = [int(np.clip(round(side / cell) + 1, 3, 41)) for side in size]
    return {"shape": "grid", "size": size, "resolution": resolution, **table}


def random_fabric(draw: Draw, explicit: bool) -> Any:
    """The name of a fabric of the library, or a table of properties; a soft one for explicit schemes."""
    if not explicit and draw.chance(0.5):
        return draw.one_of(list(fabrics()))
    return {
        "name": "random",
        "areal_density": draw.number(0.1, 0.4),
        "thickness": round(1e-3 * draw.number(0.2, 3.0), 6),
        "stretch_stiffness": draw.number(100.0, 400.0 if explicit else 5000.0),
        "shear_stiffness": draw.number(5.0, 100.0),
        "bend_stiffness": draw.number(0.0, 3.0),
        "damping_time": 3e-4,
        "friction": draw.number(0.0, 1.0),
    }


def radius_of(cloth: Table) -> float:
    """Half the greatest extent of a cloth [m]."""
    return float(cloth.get("radius") or 0.5 * np.hypot(*cloth["size"]))


def reach_along(cloth: Table, axis: int) -> float:
    """How far a cloth that has its rotation reaches from its centre along an axis [m], at most."""
    normal = rotation_matrix(np.radians(cloth["rotation"]))[:, 2]
    return radius_of(cloth) * float(np.sqrt(max(0.0, 1.0 - normal[axis] ** 2)))


def random_solid(draw: Draw, place: list[float], size: float) -> Table:
    """An obstacle of random shape around ``place`` [m], within ``size`` [m] of it."""
    common = {"friction": draw.number(0.0, 1.0), "thickness": round(1e-3 * draw.number(0.5, 3.0), 6)}
    kind = draw.one_of(["sphere", "capsule", "box", "mesh"])
    turn = draw.numbers(3, -180.0, 180.0)
    if kind == "sphere":
        return {"shape": "sphere", "center": place, "radius": round(size, 4), **common}
    if kind == "capsule":
        axis = rotation_matrix(np.radians(turn))[:, 2] * 0.7 * size
        ends = [[round(float(x), 4) for x in np.array(place) + sign * axis] for sign in (-1.0, 1.0)]
        return {"shape": "capsule", "start": ends[0], "end": ends[1], "radius": round(0.3 * size, 4), **common}
    if kind == "box":
        sides = [round(2.0 * size / np.sqrt(3.0) * draw.number(0.2, 1.0), 4) for _ in range(3)]
        return {"shape": "box", "center": place, "size": sides, "rotation": turn, **common}
    name, scale, centre = draw.one_of(MESHES)
    # The file's middle goes to ``place``.
    offset = scale * size * rotation_matrix(np.radians(turn)) @ np.array(centre)
    position = [round(float(p - o), 4) for p, o in zip(place, offset, strict=True)]
    table = {"path": name, "position": position, "rotation": turn, "scale": round(scale * size, 5)}
    return {"shape": "mesh", **table, **common}
