"""Cantilever test (ASTM D1388, ISO 9073-7): a strip clamped level at one end bends under its own weight.

Strips of different lengths L follow one curve, H/W over Γ = w L³/B, w = σ g: the heavy elastica. The standard measures
the length at which the chord from clamp to tip falls at 41.5° (Γ = 8.0) and takes half of it for the bending length
c = (B/w)^(1/3), which gives B back.

Two columns of vertices are clamped, which clamps the strip half-way between them.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..cloth import Cloth, Pin
from ..fabric import STANDARD_GRAVITY, Fabric
from ..model import Model
from .elastica import heavy_elastica
from .result import POINTS, Check, Curve, Panel, Result
from .settle import damping_time, settle
from .setup import Progress, Setup
from .specimen import rectangle

NAME = "cantilever"
TITLE = "Cantilever bending"
GAMMAS = (0.5, 1.0, 2.0, 4.0, 8.0, 10.0, 20.0, 50.0, 100.0)
ANGLE = 41.5  # of the chord where the standard measures [°]
CELLS = 32
WIDTH = 3  # of the strip, in cells
STIFF = 1000.0  # stretch stiffness over the strip's weight per width: more would not show and only cost time
TOLERANCE, RIGIDITY_TOLERANCE = 0.01, 0.02


@dataclass(frozen=True, eq=False)
class Strip:
    """A strip at rest: outline and tip (x, y) over its length L, y downwards; whether it settled."""

    gamma: float
    reach: float
    drop: float
    settled: bool
    x: np.ndarray
    y: np.ndarray


def run(setup: Setup, progress: Progress) -> Result:
    """Strips at several Γ against the elastica, and the bending length by the rule of the standard."""
    strips = []
    for gamma in GAMMAS:
        progress(f"Γ = {gamma:g}")
        strips.append(bent_strip(setup, gamma))
    progress("41.5°")
    rigidity = measured_rigidity(setup)
    references = heavy_elastica(GAMMAS)
    rows, checks = [], []
    for strip, shape in zip(strips, references, strict=True):
        ratio, x, y = strip.drop / strip.reach, shape.x[-1], shape.y[-1]
        rows.append((strip.gamma, strip.reach, x, strip.drop, y, ratio, shape.drop, strip.settled))
        checks.append(Check(f"H/W at Γ = {strip.gamma:g}", ratio, shape.drop, TOLERANCE))
    true = setup.fabric.bending[0]
    checks.append(Check("bending rigidity by the 41.5° rule [N m]", rigidity, true, RIGIDITY_TOLERANCE))
    return Result(
        test=NAME,
        title=TITLE,
        method="Strips clamped level at one end, of lengths L with Γ = w L³/B, against the heavy elastica; "
        "B from the length at which the chord falls at 41.5° (ASTM D1388).",
        setup=setup.summary(),
        columns=("Γ", "x/L", "elastica x/L", "y/L", "elastica y/L", "H/W", "elastica H/W", "settled"),
        rows=rows,
        values={"bending_rigidity": rigidity, "bending_length": (rigidity / _weight(setup.fabric)) ** (1.0 / 3.0)},
        checks=checks,
        panels=_panels(strips),
    )


def bent_strip(setup: Setup, gamma: float, stiffness: float = STIFF) -> Strip:
    """A strip at rest whose length gives it Γ; its stretch stiffness over its weight per width is ``stiffness``."""
    fabric, cells = setup.fabric, setup.cells(CELLS)
    weight = _weight(fabric)
    length = (gamma * fabric.bending[0] / weight) ** (1.0 / 3.0)
    cell = length / (cells - 0.5)
    stiff = stiffness * weight * length
    fabric = replace(
        fabric, stretch_stiffness=stiff, stretch_stiffness_weft=None, shear_stiffness=0.4 * stiff,
        bending_hysteresis=0.0, bend_stiffness=0.0, strain_limit=None, damping_time=damping_time(length),
    )  # fmt: skip
    half = 0.5 * WIDTH * cell
    cloth = rectangle((-0.5 * cell, -half), (length, half), cell, setup, fabric, lines=(0.5 * cell,))
    held = np.flatnonzero(cloth.points[:, 0] < 0.6 * cell).astype(np.int32)
    rest = settle(Model.build(_clamped(cloth, held), precision="float64"), setup, length)
    tip = np.flatnonzero(cloth.points[:, 0] > length - 1e-6 * cell)
    x, y = rest.positions[:, 0] / length, -rest.positions[:, 2] / length
    order = np.argsort(cloth.points[:, 0], kind="stable")
    return Strip(gamma, float(x[tip].mean()), float(y[tip].mean()), rest.settled, x[order], y[order])


def measured_rigidity(setup: Setup) -> float:
    """B by the standard's rule: the bending length is half the length with a chord of 41.5°, found by a secant."""
    weight, goal = _weight(setup.fabric), np.tan(np.deg2rad(ANGLE))
    gammas, drops = [7.0, 9.0], []
    for gamma in gammas:
        strip = bent_strip(setup, gamma)
        drops.append(strip.drop / strip.reach - goal)
    gamma = gammas[0] - drops[0] * (gammas[1] - gammas[0]) / (drops[1] - drops[0])
    length = (gamma * setup.fabric.bending[0] / weight) ** (1.0 / 3.0)
    return float(weight * (0.5 * length) ** 3)


def _clamped(cloth: Cloth, held: np.ndarray) -> Cloth:
    return replace(cloth, pins=(Pin(held),))


def _weight(fabric: Fabric) -> float:
    """w = σ g [N/m²]."""
    return fabric.areal_density * STANDARD_GRAVITY


def _panels(strips: list[Strip]) -> list[Panel]:
    gammas = np.geomspace(0.3, 150.0, 60)
    master = Curve("elastica", gammas, [shape.drop for shape in heavy_elastica(gammas)])
    measured = Curve("simulated", [s.gamma for s in strips], [s.drop / s.reach for s in strips], POINTS)
    shapes = []
    for strip, shape in zip(strips, heavy_elastica(GAMMAS), strict=True):
        shapes.append(Curve("", shape.x, -shape.y))
        shapes.append(Curve("", strip.x, -strip.y, POINTS))
    return [Panel("Γ = w L³/B", "H/W", [master, measured], log="xy"), Panel("x/L", "y/L", shapes, equal=True)]
