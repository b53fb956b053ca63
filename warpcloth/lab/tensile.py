"""Tensile test: a strip is pulled along warp and weft; strain by extensometer in its middle, load over its width.

Young's modulus Y is the load over the strain at the smallest extension. Beyond the fabric's strain limit the curve
bends up to the sum of both stiffnesses.
"""

from dataclasses import replace

import numpy as np

from ..fabric import Fabric
from .result import POINTS, Check, Curve, Panel, Result
from .settle import damping_time
from .setup import Progress, Setup
from .specimen import rectangle
from .strained import gradient, strained

NAME = "tensile"
TITLE = "Tensile test"
LENGTH, WIDTH = 0.2, 0.05  # [m] of the free strip
GAUGE = 0.25  # of the length, the middle part that is measured, or a cell to either side where that is more
EXTENSIONS = (0.002, 0.01, 0.02, 0.04)
CELLS = 32
TOLERANCE = 0.02


def run(setup: Setup, progress: Progress) -> Result:
    """Load and strain along warp and weft against Y."""
    rows, checks, curves = [], [], []
    for direction, fabric in (("warp", setup.fabric), ("weft", turned(setup.fabric))):
        points = []
        for extension in EXTENSIONS:
            progress(f"{direction}, {100.0 * extension:g} %")
            strain, load, settled = pulled(setup, fabric, extension)
            points.append((strain, load))
            rows.append((direction, 100.0 * strain, load, load_at(fabric, strain), settled))
        young = points[0][1] / points[0][0]
        checks.append(Check(f"Y along the {direction} [N/m]", young, fabric.stretch_stiffness, TOLERANCE))
        reference = np.linspace(0.0, points[-1][0], 50)
        curves.append(Curve(f"{direction}, put in", 100.0 * reference, [load_at(fabric, e) for e in reference]))
        curves.append(Curve(f"{direction}, simulated", [100.0 * e for e, _ in points], [t for _, t in points], POINTS))
    return Result(
        test=NAME,
        title=TITLE,
        method=f"Strips of {1e3 * LENGTH:g} mm × {1e3 * WIDTH:g} mm clamped at both ends and pulled; strain of the "
        f"middle {100.0 * gauge(setup.cells(CELLS)):.3g} %, load per width at the clamps; against Y ε, and what the "
        "strain limit adds.",
        setup=setup.summary(),
        columns=("along", "strain %", "load N/m", "load put in N/m", "settled"),
        rows=rows,
        values={"young_warp": checks[0].value, "young_weft": checks[1].value},
        checks=checks,
        panels=[Panel("strain [%]", "load [N/m]", curves)],
    )


def pulled(setup: Setup, fabric: Fabric, extension: float) -> tuple[float, float, bool]:
    """Strain in the middle [-], load [N/m], and whether the strip settled, at an extension of its ends [-]."""
    cells = setup.cells(CELLS)
    fabric = replace(fabric, damping_time=damping_time(LENGTH), bending_hysteresis=0.0, bend_stiffness=0.0)
    lower, upper = (-0.5 * LENGTH, -0.5 * WIDTH), (0.5 * LENGTH, 0.5 * WIDTH)
    cloth = rectangle(lower, upper, LENGTH / cells, setup, fabric, springs="woven")
    x = cloth.points[:, 0]
    ends = np.abs(np.abs(x) - 0.5 * LENGTH) < 1e-6 * LENGTH
    stretch = np.array([1.0 + extension, 1.0, 1.0])
    held = strained(cloth, np.flatnonzero(ends), lambda points: points * stretch, setup, LENGTH)
    strain = gradient(cloth.points, held.positions, np.abs(x) < 0.5 * gauge(cells) * LENGTH + 1e-9)[0, 0] - 1.0
    load = -float(held.forces[ends & (x > 0.0), 0].sum()) / WIDTH
    return float(strain), load, held.settled


def gauge(cells: int) -> float:
    """Share of the strip's length that is measured; it always holds two columns of vertices, as a strain needs."""
    return max(GAUGE, 2.0 / cells)


def turned(fabric: Fabric) -> Fabric:
    """The fabric cut across: its weft along the specimen."""
    (warp, weft), (bend, bend_weft) = fabric.stretch, fabric.bending
    scale = weft / warp  # the limit's stiffness is that along the warp
    return replace(
        fabric, stretch_stiffness=weft, stretch_stiffness_weft=warp, bending_rigidity=bend_weft,
        bending_rigidity_weft=bend, limit_stiffness=fabric.limit_stiffness * scale,
    )  # fmt: skip


def load_at(fabric: Fabric, strain: float) -> float:
    """Load [N/m] that the fabric's properties ask for."""
    beyond = 0.0 if fabric.strain_limit is None else max(0.0, strain - fabric.strain_limit)
    return fabric.stretch_stiffness * strain + fabric.limit_stiffness * beyond
