"""What a model is made from: cloths of all worlds, or a bare network, joined into numpy arrays."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from . import validate
from .cloth.bending import BendingElements
from .cloth.inflation import enclosed_volume
from .cloth.woven import WovenTriangles
from .errors import InputError
from .motion import Motion
from .obstacles import Obstacle

if TYPE_CHECKING:
    from .cloth import Cloth

BEND_KIND = 2


@dataclass
class Parts:
    """Host arrays in SI units: n particles, s springs, t triangles.

    ``moving`` has a row (particles, motion, their rest positions, pivot) for each group of moving pins; ``ranges`` the
    fields of a ``ClothRange`` for each cloth; ``bags`` a row (pressure, ambient, volume, gas, side) for each inflated
    one, and ``bag`` the number of that row for each triangle, −1 on others. ``bend_damping`` is the stiffness of
    bending elements times their damping time [N m³ s].
    """

    positions: np.ndarray
    velocities: np.ndarray
    masses: np.ndarray
    pinned: np.ndarray
    world: np.ndarray
    radius: np.ndarray
    friction: np.ndarray
    springs: np.ndarray
    rest_lengths: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    kinds: np.ndarray
    limits: np.ndarray
    limit_stiffness: np.ndarray
    triangles: np.ndarray
    corner_share: np.ndarray
    air_drag: np.ndarray
    air_friction: np.ndarray
    bending: BendingElements
    bend_damping: np.ndarray
    woven: WovenTriangles = field(default_factory=WovenTriangles.none)
    bags: list[tuple[float, float, float, bool, float]] = field(default_factory=list)
    bag: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    moving: list[tuple[np.ndarray, Motion, np.ndarray, np.ndarray]] = field(default_factory=list)
    ranges: list[tuple[int, str, int, int, int, int]] = field(default_factory=list)

    @property
    def groups(self) -> np.ndarray:
        """0 for in-plane springs, 1 for bending ones, int32, shape [s]."""
        return (self.kinds == BEND_KIND).astype(np.int32)


def pairs_of_worlds(worlds: Any) -> "list[tuple[list[Cloth], list[Obstacle]]]":
    """Worlds as pairs of (cloths, obstacles).

    Raises:
        InputError: there is none, or one is no such pair.
    """
    items = [item for item in validate.listed(worlds) if item is not worlds]  # one thing alone is no list of worlds
    if not items:
        raise InputError(
            f"A model needs a list of at least one world, (cloths, obstacles), got {validate.shown(worlds)}."
        )
    for w, item in enumerate(items):
        if not isinstance(item, Sequence) or isinstance(item, str) or len(item) != 2:
            raise InputError(f"worlds[{w}] must be a pair (cloths, obstacles), got {validate.shown(item)}.")
    return [things_of_world(f"worlds[{w}]: ", *item) for w, item in enumerate(items)]


def things_of_world(label: str, cloths: Any, obstacles: Any) -> "tuple[list[Cloth], list[Obstacle]]":
    """The cloths and obstacles of a world, of which one alone needs no list.

    Raises:
        InputError: something else is among them.
    """
    from .cloth import Cloth

    rows = [validate.listed(items) for items in (cloths, obstacles)]
    for k, obstacle in enumerate(rows[1]):
        if not isinstance(obstacle, Obstacle):
            what = f"{label}obstacles[{k}] must be an obstacle such as warpcloth.Sphere"
            raise InputError(f"{what}, got {type(obstacle).__name__}.")
    return validate.instances(rows[0], Cloth, f"{label}cloths"), rows[1]


def parts_of_worlds(worlds: Sequence[Sequence["Cloth"]]) -> Parts:
    """All cloths of all worlds, one after the other.

    Raises:
        InputError: a world without cloth, or with two cloths of one name.
    """
    pieces, bending, woven, moving, ranges, bags = [], [], [], [], [], []
    first = tri_first = 0
    for world, cloths in enumerate(worlds):
        _check_names(world, cloths)
        for cloth in cloths:
            pieces.append(_piece(world, cloth, first))
            pieces[-1]["bag"] = np.full(len(cloth.triangles), -1 if cloth.inflation is None else len(bags), np.int32)
            bags += _bags(cloth)
            bending.append((cloth.bending, first))
            woven.append((cloth.woven, first))
            moving += _moving_pins(cloth, first)
            stop, tri_stop = first + len(cloth.points), tri_first + len(cloth.triangles)
            ranges.append((world, cloth.name, first, stop, tri_first, tri_stop))
            first, tri_first = stop, tri_stop
    joined = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    elements = BendingElements.joined(*zip(*bending, strict=True))
    yarns = WovenTriangles.joined(*zip(*woven, strict=True))
    return Parts(**joined, bending=elements, woven=yarns, moving=moving, ranges=ranges, bags=bags)


def _check_names(world: int, cloths: Sequence["Cloth"]) -> None:
    if not cloths:
        raise InputError(f"World {world} has no cloth; give each world at least one.")
    names = [cloth.name for cloth in cloths]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"Two cloths of one world are named '{twice[0]}'; give each its own name.")


def _piece(world: int, cloth: "Cloth", first: int) -> dict[str, np.ndarray]:
    n = len(cloth.points)
    pinned = np.zeros(n, bool)
    for pin in cloth.pins:
        pinned[pin.indices] = True
    velocities = np.where(pinned[:, None], 0.0, np.broadcast_to(cloth.velocity, (n, 3)))
    net = cloth.springs
    return {
        "positions": cloth.points,
        "velocities": velocities,
        "masses": cloth.masses,
        "pinned": pinned,
        "world": np.full(n, world, np.int32),
        "radius": np.full(n, 0.5 * cloth.fabric.thickness),
        "friction": np.full(n, cloth.fabric.friction),
        "springs": net.indices + first,
        "rest_lengths": net.rest_lengths,
        "stiffness": net.stiffness,
        "damping": net.damping,
        "kinds": net.kinds,
        "limits": np.full(len(net), cloth.fabric.strain_limit or 0.0),
        "limit_stiffness": net.limit_stiffness,
        "triangles": cloth.triangles + first,
        "corner_share": cloth.corner_share,
        "air_drag": np.full(len(cloth.triangles), cloth.fabric.air_drag),
        "air_friction": np.full(len(cloth.triangles), cloth.fabric.air_friction),
        "bend_damping": cloth.fabric.damping_time * cloth.bending.stiffness,
    }


def _bags(cloth: "Cloth") -> list[tuple[float, float, float, bool, float]]:
    if cloth.inflation is None:
        return []
    inside, volume = cloth.inflation, enclosed_volume(cloth.points, cloth.triangles)
    return [(inside.pressure, inside.ambient, abs(volume), inside.gas, np.sign(volume))]


def _moving_pins(cloth: "Cloth", first: int) -> list[tuple[np.ndarray, Motion, np.ndarray, np.ndarray]]:
    rows = []
    for pin in cloth.pins:
        if pin.motion is not None:
            rest = cloth.points[pin.indices]
            pivot = rest.mean(axis=0) if pin.motion.pivot is None else pin.motion.pivot
            rows.append((pin.indices + first, pin.motion, rest, pivot))
    return rows


def parts_of_network(
    positions: Any, masses: Any, springs: Any, rest_lengths: Any, k_s: Any, k_d: Any, pinned: Any, velocities: Any
) -> Parts:
    """A checked bare network; arguments as for ``Model.from_springs``."""
    x = validate.array(positions, "positions", (None, 3))
    n = len(x)
    if n == 0:
        raise InputError("A network needs at least one particle.")
    ends = validate.array(springs, "springs", (None, 2), np.int32)
    s = len(ends)
    _check_ends(ends, n)
    pins = np.zeros(n, bool)
    pins[_particle_numbers(pinned, n)] = True
    v = np.zeros((n, 3)) if velocities is None else validate.array(velocities, "velocities", (n, 3))
    return Parts(
        positions=x,
        velocities=np.where(pins[:, None], 0.0, v),
        masses=_column(masses, n, "masses", positive=True),
        pinned=pins,
        world=np.zeros(n, np.int32),
        radius=np.full(n, 1.0e-3),
        friction=np.full(n, 0.5),
        springs=ends,
        rest_lengths=_column(rest_lengths, s, "rest_lengths", positive=True),
        stiffness=_column(k_s, s, "k_s"),
        damping=_column(k_d, s, "k_d"),
        kinds=np.zeros(s, np.uint8),
        limits=np.zeros(s),
        limit_stiffness=np.zeros(s),
        triangles=np.zeros((0, 3), np.int32),
        corner_share=np.zeros((0, 3)),
        air_drag=np.zeros(0),
        air_friction=np.zeros(0),
        bending=BendingElements.none(),
        bend_damping=np.zeros(0),
        ranges=[(0, "network", 0, n, 0, 0)],
    )


def _column(values: Any, count: int, what: str, *, positive: bool = False) -> np.ndarray:
    """``values``, a number or one per item, as float64 of shape [count]; negative ones are refused."""
    if validate.axes(values) == 0:
        bound = {"above": 0.0} if positive else {"minimum": 0.0}
        return np.full(count, validate.number(values, what, **bound))
    column = validate.array(values, what, (count,))
    wrong = column <= 0.0 if positive else column < 0.0
    if wrong.any():
        k = int(np.argmax(wrong))
        raise InputError(
            f"{what}[{k}] is {column[k]:g}, but must be {'greater than 0' if positive else '0 or greater'}."
        )
    return column


def _check_ends(ends: np.ndarray, n: int) -> None:
    wrong = (ends < 0).any(axis=1) | (ends >= n).any(axis=1) | (ends[:, 0] == ends[:, 1])
    if wrong.any():
        k = int(np.argmax(wrong))
        raise InputError(
            f"springs[{k}] joins particles {ends[k].tolist()}, but must join two different ones of 0 to {n - 1}."
        )


def _particle_numbers(pinned: Any, n: int) -> np.ndarray:
    numbers = validate.array(pinned, "pinned", (None,), np.int32)
    wrong = (numbers < 0) | (numbers >= n)
    if wrong.any():
        raise InputError(f"pinned names particle {numbers[wrong][0]}, but particles are numbered 0 to {n - 1}.")
    return numbers
