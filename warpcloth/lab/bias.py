"""Bias extension: a strip cut at 45° to the yarns is pulled, and shears in its middle like a trellis.

Yarns that keep their length and turn at their crossings make the shear angle of the middle of a strip of length L and
width W (L >= 2 W), drawn out by δ,

    γ = 90° − 2 arccos( (L − W + δ)/(√2 (L − W)) )

(Cao et al., Composites A 39, 2008). Next to the clamps yarns cannot turn; between lies half of the angle. In elastic
cloth the angle varies a little over the middle; what is compared is its mean along the axis. The mesh is a square grid
along the yarns, cut along its diagonals, as a strip is cut from cloth: it is a whole number of diagonals wide, as near
to a third of its length as can be, and W is that width.
"""

from dataclasses import replace

import numpy as np

from ..cloth import Cloth, SpringNetwork
from ..fabric import Fabric
from .result import POINTS, Check, Curve, Panel, Result
from .settle import damping_time
from .setup import Progress, Setup
from .strained import strained

NAME = "bias"
TITLE = "Bias extension"
WIDTH, LENGTH = 0.1, 0.3  # [m]; the width of meshes that can have it
EXTENSIONS = (0.02, 0.05, 0.1)  # of the strip
MESH = {"mesh": "grid", "angle": 45.0, "seed": None}  # whatever the setup asks; see bias_strip
CELLS = 48  # along the strip, each a diagonal of the mesh's cells long
TOLERANCE = 0.1
INEXTENSIBLE = 100.0  # stretch over shear stiffness from which the trellis is a reference; knits and stretch denim give


def run(setup: Setup, progress: Progress) -> Result:
    """Shear angle in the middle against that of a trellis."""
    rows, checks, width = [], [], strip_width(setup.cells(CELLS))
    for extension in EXTENSIONS:
        progress(f"{100.0 * extension:g} %")
        angle, load, settled = drawn(setup, extension)
        rows.append((100.0 * extension, angle, trellis_angle(extension, width), load, settled))
        if min(setup.fabric.stretch) > INEXTENSIBLE * setup.fabric.shear_stiffness:
            what = f"shear angle at {100.0 * extension:g} % [°]"
            checks.append(Check(what, angle, trellis_angle(extension, width), TOLERANCE))
    line = np.linspace(0.0, EXTENSIONS[-1], 40)
    curves = [
        Curve("trellis", 100.0 * line, [trellis_angle(e, width) for e in line]),
        Curve("simulated", [row[0] for row in rows], [row[1] for row in rows], POINTS),
    ]
    loads = [Curve("simulated", [row[0] for row in rows], [row[3] for row in rows], POINTS)]
    return Result(
        test=NAME,
        title=TITLE,
        method=f"A strip of {1e3 * LENGTH:g} mm × {1e3 * width:.4g} mm, cut at 45° to the yarns and pulled at its "
        "ends; the mesh is always a grid along the yarns. Against the trellis of yarns that do not stretch.",
        setup={**setup.summary(), **MESH},
        columns=("extension %", "shear angle °", "trellis °", "load N/m", "settled"),
        rows=rows,
        values={"load": {f"{row[0]:g} %": row[3] for row in rows}},
        checks=checks,
        panels=[
            Panel("extension [%]", "shear angle [°]", curves),
            Panel("extension [%]", "load [N/m]", loads),
        ],
    )


def trellis_angle(extension: float, width: float = WIDTH) -> float:
    """γ [°] of a strip of that width [m] drawn out by ``extension`` of its length."""
    free = LENGTH - width
    return float(90.0 - 2.0 * np.rad2deg(np.arccos((free + extension * LENGTH) / (np.sqrt(2.0) * free))))


def drawn(setup: Setup, extension: float) -> tuple[float, float, bool]:
    """Mean shear angle along the axis of the middle [°], load [N/m], and whether the strip settled."""
    fabric = replace(setup.fabric, damping_time=damping_time(LENGTH), bending_hysteresis=0.0, bend_stiffness=0.0)
    cloth, width = bias_strip(setup.cells(CELLS), fabric), strip_width(setup.cells(CELLS))
    x = cloth.points[:, 0]
    ends = np.abs(x) > 0.5 * LENGTH * (1.0 - 1e-6)
    narrow = 1.0 - extension  # near where it will be, for the start
    scale = np.where(ends[:, None], [1.0 + extension, 1.0, 1.0], [1.0 + extension, narrow, 1.0])
    held = strained(cloth, np.flatnonzero(ends), lambda points: points * scale, setup, LENGTH)
    axis = np.flatnonzero(np.abs(cloth.points[:, 1]) < 1e-6 * WIDTH)
    axis = axis[np.argsort(x[axis])]
    reach = 0.5 * (LENGTH - width)
    drawn_out = np.interp([-reach, reach], x[axis], held.positions[axis, 0])
    half_angle = np.arccos(np.clip((drawn_out[1] - drawn_out[0]) / (2.0 * reach * np.sqrt(2.0)), -1.0, 1.0))
    load = -float(held.forces[ends & (x > 0.0), 0].sum()) / width
    return 90.0 - 2.0 * float(np.rad2deg(half_angle)), load, held.settled


def strip_width(cells: int) -> float:
    """Of the strip with so many cells along it [m]; half of them more would cut its corners off, which are clamped."""
    odd = cells % 2
    return (odd + 2 * round(0.5 * (cells * WIDTH / LENGTH - odd))) * LENGTH / cells


def bias_strip(cells: int, fabric: Fabric) -> Cloth:
    """The strip along x with its yarns at ±45°: a grid along the yarns, of which what lies outside is cut off."""
    half = LENGTH / cells / 2.0  # of a cell's diagonal
    count = int(np.ceil((LENGTH + WIDTH) / (2.0 * half))) + 1
    side = 2.0 * count * half * np.sqrt(2.0)
    grid = Cloth.grid((side, side), (2 * count + 1, 2 * count + 1), fabric)
    turned = grid.points @ np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2.0)]]).T / np.sqrt(2.0)
    outside = np.abs(turned[:, :2]) > 0.5 * np.array([LENGTH, strip_width(cells)]) + 0.1 * half
    keep = ~outside.any(axis=1)
    triangles = grid.triangles[keep[grid.triangles].all(axis=1)]
    used = np.flatnonzero(keep)  # with odd numbers of cells no triangle has the corners, but springs have
    number = np.full(len(keep), -1, np.int32)
    number[used] = np.arange(len(used))
    net = grid.springs
    inside = (number[net.indices] >= 0).all(axis=1)
    values = (net.rest_lengths, net.stiffness, net.damping, net.kinds, net.limit_stiffness)
    springs = SpringNetwork(number[net.indices[inside]], *(value[inside] for value in values))
    return Cloth("specimen", turned[used], number[triangles], springs, grid.masses[used], fabric)
