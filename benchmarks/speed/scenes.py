"""The two scenes that tools are compared on, and what a good answer to them is; the same for every tool."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

import warpcloth as wc

DT = 1.0 / 60.0
DENSITY = 0.2  # [kg/m²]
CENTRE, RADIUS = (0.0, 0.0, 0.4), 0.25  # [m], of the ball
FRICTION = 0.5


@dataclass(frozen=True)
class Problem:
    """A square of 1 m in a scene.

    Attributes:
        frames: of 1/60 s. height: of the cloth at the start [m]. contact: see :class:`warpcloth.Simulation`.
        bars: what a good answer has at most, by name of a measure; ``swing`` within two bounds.
        fewest: substeps of XPBD with which an answer is still good, by n, where automatic ones are more.
    """

    name: str
    frames: int
    height: float
    contact: str
    bars: dict[str, Any] = field(default_factory=dict)
    fewest: dict[int, int] = field(default_factory=dict)


HANG = Problem("hang", 60, 1.2, "none", {"mean_strain": 0.005, "worst_strain": 0.025, "swing_m": (-0.48, -0.46)})
DRAPE = Problem(
    "drape",
    90,
    0.75,
    "all",
    {"mean_strain": 0.01, "worst_strain": 0.025, "intersections": 0, "penetration_m": 1e-4},
    {64: 8, 128: 14},
)
PROBLEMS = {problem.name: problem for problem in (HANG, DRAPE)}


def things(problem: Problem, n: int) -> tuple[wc.Cloth, list[Any]]:
    """The cloth, with n² vertices, and the obstacles of a problem."""
    pins = ["left"] if problem is HANG else []
    fabric = wc.Fabric(areal_density=DENSITY, friction=FRICTION)
    cloth = wc.Cloth.grid(
        (1.0, 1.0), (n, n), fabric, transform=(0.0, 0.0, problem.height), pins=pins, name=problem.name
    )
    if problem is HANG:
        return cloth, []
    return cloth, [wc.Sphere(CENTRE, RADIUS, friction=FRICTION), wc.Plane(friction=FRICTION)]


def simulation(problem: Problem, n: int, integrator: str, **options: Any) -> wc.Simulation:
    """Our simulation of a problem with n² vertices; with automatic substeps, or as few as are good, as peers have them,
    unless ``options`` say otherwise."""
    cloth, obstacles = things(problem, n)
    if integrator == "xpbd" and n in problem.fewest:
        options.setdefault("substeps", problem.fewest[n])
    return wc.Simulation(wc.Model.build([cloth], obstacles), integrator, contact=problem.contact, **options)


def edges(n: int) -> np.ndarray:
    """Pairs of neighbours along the rows and columns of a grid of n² vertices, shape [2 n (n − 1), 2]."""
    index = np.arange(n * n).reshape(n, n)
    along = np.stack([index[:, :-1].ravel(), index[:, 1:].ravel()], axis=1)
    across = np.stack([index[:-1].ravel(), index[1:].ravel()], axis=1)
    return np.concatenate([along, across])


def mean_strain(points: np.ndarray, pairs: np.ndarray) -> float:
    """Mean of |l/l₀ − 1| over ``pairs`` of a grid of 1 m [-]; ``points``: shape [n², 3]."""
    rest = 1.0 / (round(len(points) ** 0.5) - 1)
    return float(np.abs(np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1) / rest - 1.0).mean())


def penetration(points: np.ndarray) -> float:
    """Depth of the deepest vertex in the ball or the ground of the drape [m]; 0 outside."""
    ball = RADIUS - np.linalg.norm(points - np.array(CENTRE), axis=1)
    return float(max(ball.max(), -points[:, 2].min(), 0.0))


def swing(points: np.ndarray) -> float:
    """Mean x of the cloth that hangs, from the edge it hangs by [m]; 0.5 at the start."""
    return float(points[:, 0].mean()) + 0.5


def misses(problem: Problem, row: dict[str, Any]) -> list[str]:
    """Measures of a row that a good answer would not have; what is missing or not finite is one."""
    found = []
    for name, bar in problem.bars.items():
        low, high = bar if isinstance(bar, tuple) else (0.0, bar)
        value = row.get(name)
        if value is None or not low <= value <= high:
            found.append(name)
    return found
