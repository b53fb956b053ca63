"""A strip that hangs from one end stretches under its own weight: by σ g L²/(2 Y), the strain being σ g (L − s)/Y."""

from dataclasses import replace

import numpy as np

from ..cloth import Pin
from ..fabric import STANDARD_GRAVITY
from ..model import Model
from .result import POINTS, Check, Curve, Panel, Result
from .settle import damping_time, settle
from .setup import Progress, Setup
from .specimen import rectangle

NAME = "hang"
TITLE = "Hanging strip"
LENGTH, WIDTH = 1.0, 0.1  # [m]
CELLS = 40
TOLERANCE = 0.02


def run(setup: Setup, progress: Progress) -> Result:
    """Displacements along the strip against the closed form."""
    progress("hanging")
    fabric = replace(
        setup.fabric, damping_time=damping_time(LENGTH), strain_limit=None, bending_hysteresis=0.0, bend_stiffness=0.0
    )
    lower, upper = (0.0, -0.5 * WIDTH), (LENGTH, 0.5 * WIDTH)
    cloth = rectangle(lower, upper, LENGTH / setup.cells(CELLS), setup, fabric, springs="woven")
    s = cloth.points[:, 0]
    pins = (Pin(np.flatnonzero(s < 1e-6).astype(np.int32)),)
    down = (STANDARD_GRAVITY, 0.0, 0.0)
    rest = settle(Model.build(replace(cloth, pins=pins), precision="float64"), setup, LENGTH, gravity=down)
    moved = rest.positions[:, 0] - s
    scale = fabric.areal_density * STANDARD_GRAVITY / fabric.stretch_stiffness
    rows = []
    for share in (0.25, 0.5, 0.75, 1.0):
        place = float(s[np.abs(s - share * LENGTH).argmin()])  # where there are vertices, as near as can be
        expected = scale * (place * LENGTH - 0.5 * place**2)
        there = np.abs(s - place) < 1e-6 * LENGTH
        rows.append((place / LENGTH, 1e6 * float(moved[there].mean()), 1e6 * expected, rest.settled))
    line = np.linspace(0.0, LENGTH, 50)
    curves = [
        Curve("σ g (L s − s²/2)/Y", line, 1e6 * scale * (LENGTH * line - 0.5 * line**2)),
        Curve("simulated", s, 1e6 * moved, POINTS),
    ]
    return Result(
        test=NAME,
        title=TITLE,
        method=f"A strip of {LENGTH:g} m × {WIDTH:g} m hangs from one end, against the closed form.",
        setup=setup.summary(),
        columns=("s/L", "displacement µm", "closed form µm", "settled"),
        rows=rows,
        values={"extension_m": 1e-6 * rows[-1][1]},
        checks=[Check("extension of the strip [µm]", rows[-1][1], rows[-1][2], TOLERANCE)],
        panels=[Panel("s [m]", "displacement [µm]", curves)],
    )
