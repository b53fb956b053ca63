"""Random scenes in which cloth meets cloth and obstacles in every way; each belongs to a seed.

Everything starts apart: things have layers of space of their own. Obstacles that move keep away from other obstacles
and from pins, so that nothing is asked of cloth that it cannot do without passing through something.
"""

import math
from typing import Any

from warpcloth.scenes.load import scene_from_data
from warpcloth.scenes.schema import Scene

from warpcloth.integrators import INTEGRATORS

from .draw import Draw
from .things import Table, radius_of, random_cloth, random_solid, reach_along

GAP = 0.06  # [m] between the layers of space
FASTEST = 10.0  # [m/s]
PEAK = {"linear": 1.0, "smooth": 1.5}  # greatest speed of a motion, of its mean
LAST_SEED = 2**32 - 1
SCHEMES = sorted(name for name, scheme in INTEGRATORS.items() if not scheme.adaptive)


def random_scene(seed: int) -> Scene:
    """The scene that belongs to a seed, a whole number from 0 on; an ordinary scene, to be simulated as any other."""
    draw = Draw(seed)
    integrator = "xpbd" if draw.chance(0.5) else draw.one_of(SCHEMES)
    arrangement = draw.one_of(ARRANGEMENTS)
    tables = arrangement(draw, math.isfinite(INTEGRATORS[integrator].stable_step(1.0, 0.0)))
    fps = draw.one_of([24.0, 30.0, 60.0])
    data = {
        "title": f"Random contact {seed}: {arrangement.__name__}",
        "frames": round(draw.number(0.6, 1.2) * fps),
        "fps": fps,
        "seed": seed,
        "simulation": {"integrator": integrator, "contact": "all"},
        **tables,
    }
    return scene_from_data(data, name=f"random_{seed}")


def dropped(draw: Draw, explicit: bool) -> Table:
    """Layers of cloth fall or are thrown on obstacles on the ground; sometimes something shoots through above those."""
    obstacles: list[Table] = [{"shape": "plane", "friction": draw.number(0.0, 1.0)}]
    height = 0.0
    for _ in range(draw.whole(0, 2)):
        size = draw.number(0.05, 0.25)
        place = [draw.number(-0.2, 0.2), draw.number(-0.2, 0.2), round(size + GAP, 4)]
        obstacles.append(random_solid(draw, place, size))
        height = max(height, 2.0 * size + GAP)
    if draw.chance(0.3):
        size = draw.number(0.04, 0.15)
        height += GAP + 2.0 * size
        obstacles.append(_passing(draw, round(height - size, 4), size))
    down = [draw.number(-1.0, 1.0), draw.number(-1.0, 1.0), -draw.number(0.0, FASTEST)]
    return {"cloth": _stacked(draw, explicit, draw.whole(1, 4), height, down), "obstacle": obstacles}


def thrown(draw: Draw, explicit: bool) -> Table:
    """Cloths fly at each other, and perhaps meet an obstacle between them."""
    obstacles, reach = [], 0.0
    if draw.chance(0.5):
        reach = draw.number(0.04, 0.2)
        obstacles.append(random_solid(draw, [0.0, 0.0, 1.0], reach))
    cloths = []
    for sign in (-1.0, 1.0):
        cloth = random_cloth(draw, explicit)
        cloth["rotation"] = [draw.number(-30.0, 30.0), draw.number(60.0, 120.0), draw.number(-30.0, 30.0)]
        x = sign * round(reach + GAP + reach_along(cloth, 0), 4)
        cloth["position"] = [x, draw.number(-0.1, 0.1), 1.0 + draw.number(-0.1, 0.1)]
        cloth["velocity"] = [-sign * draw.number(1.0, FASTEST), *draw.numbers(2, -2.0, 2.0)]
        cloths.append(cloth)
    return {"cloth": cloths, "obstacle": obstacles}


def curtains(draw: Draw, explicit: bool) -> Table:
    """Something flies through one to three curtains, below their pins."""
    cloths: list[Table] = []
    for number in range(draw.whole(1, 3)):
        cloth = random_cloth(draw, explicit, grid=True)
        top = round(1.0 - 0.5 * cloth["size"][1], 4)
        cloth |= {"rotation": [90.0, 0.0, 0.0], "position": [0.0, round(-0.05 * number, 4), top]}
        cloths.append({**cloth, "pins": [{"edge": "top"}]})
    size = draw.number(0.03, 0.12)
    solid = random_solid(draw, [0.0, round(size + GAP, 4), round(0.7 - size, 4)], size)
    way = draw.number(0.4, 1.2)
    solid["motion"] = _there(draw, [0.0, -way, 0.0], way)
    return {"cloth": cloths, "obstacle": [solid]}


def hammock(draw: Draw, explicit: bool) -> Table:
    """Cloths fall into a cloth that hangs by two edges."""
    bed = random_cloth(draw, explicit, grid=True)
    bed["pins"] = [{"edge": "left"}, {"edge": "right"}]
    down = [0.0, 0.0, -draw.number(0.0, FASTEST)]
    return {"cloth": [bed, *_stacked(draw, explicit, draw.whole(1, 3), 0.0, down, radius_of(bed))], "obstacle": []}


def wrung(draw: Draw, explicit: bool) -> Table:
    """A cloth is twisted by two edges that approach; another may fall on it."""
    cloth = random_cloth(draw, explicit, grid=True)
    (width, height), last, closer = cloth["size"], draw.number(0.5, 1.0), draw.number(0.1, 0.3)
    # Each end turns so far that the long edges, now helices, are not stretched.
    most = math.degrees(width * math.sqrt(1.0 - (1.0 - 2.0 * closer) ** 2) / height)
    pins = []
    for edge, sign in (("left", 1.0), ("right", -1.0)):
        end = {"time": last, "position": [round(sign * closer * width, 4), 0.0, 0.0]}
        end["rotation"] = [round(sign * draw.number(0.3, 1.0) * most, 2), 0.0, 0.0]
        keys = [{"time": 0.0}, end]
        pins.append({"edge": edge, "motion": {"interpolation": draw.one_of(["linear", "smooth"]), "keys": keys}})
    above = _stacked(draw, explicit, draw.whole(0, 1), radius_of(cloth), [0.0, 0.0, 0.0])
    return {"cloth": [{**cloth, "pins": pins}, *above], "obstacle": []}


ARRANGEMENTS = (dropped, dropped, thrown, curtains, hammock, wrung)


def _stacked(
    draw: Draw, explicit: bool, count: int, height: float, velocity: list[float], most: float = 0.4
) -> list[Table]:
    """So many cloths above each other and above ``height`` [m]; their radius is at most ``most`` [m]."""
    cloths = []
    for _ in range(count):
        cloth = random_cloth(draw, explicit, min(0.8, 1.4 * most))
        cloth["rotation"] = [*draw.numbers(2, -25.0, 25.0), draw.number(-180.0, 180.0)]
        half = reach_along(cloth, 2)
        height += GAP + half
        cloth["position"] = [draw.number(-0.1, 0.1), draw.number(-0.1, 0.1), round(height, 4)]
        cloth["velocity"] = velocity
        cloths.append(cloth)
        height += half
    return cloths


def _passing(draw: Draw, height: float, size: float) -> Table:
    """An obstacle that crosses over the middle, perhaps spinning, at up to 10 m/s."""
    solid = random_solid(draw, [-0.8, draw.number(-0.1, 0.1), height], size)
    solid["motion"] = _there(draw, [1.6, 0.0, 0.0], 1.6)
    return solid


def _there(draw: Draw, displacement: list[float], way: float) -> dict[str, Any]:
    """Motion over a way [m], perhaps spinning, perhaps after a while."""
    begin, fastest = draw.number(0.0, 0.3), draw.number(0.1 * FASTEST, FASTEST)
    rotation, interpolation = draw.numbers(3, -360.0, 360.0), draw.one_of(list(PEAK))
    end = {
        "time": round(begin + PEAK[interpolation] * way / fastest, 4),
        "position": displacement,
        "rotation": rotation,
    }
    return {"interpolation": interpolation, "keys": [{"time": begin}, end]}
