"""Shear test in a picture frame: a square frame of four hinged bars turns into a rhombus, with all yarns turning along.

Threads keep their length, so that only shear is resisted. The shear stress is the work of the frame per area and angle,
τ = dE/(A dγ), and G = τ/γ at small angles. The angle goes up to 8°, as in the KES test.
"""

from dataclasses import replace

import numpy as np

from .result import POINTS, Check, Curve, Panel, Result
from .settle import damping_time
from .setup import Progress, Setup
from .specimen import rectangle
from .strained import Deformation, strained

NAME = "shear"
TITLE = "Shear test in a picture frame"
SIDE = 0.1  # [m]
ANGLES = (0.5, 1.0, 2.0, 4.0, 8.0)  # [°]
SMALL = 0.02  # share of an angle over which work is compared
CELLS = 16
TOLERANCE = 0.02


def run(setup: Setup, progress: Progress) -> Result:
    """Shear stress over the angle against G γ."""
    rows, shear = [], setup.fabric.shear_stiffness
    for angle in ANGLES:
        progress(f"{angle:g}°")
        stress, settled = sheared(setup, angle)
        rows.append((angle, stress, shear * float(np.deg2rad(angle)), settled))
    measured = rows[0][1] / float(np.deg2rad(ANGLES[0]))
    reference = np.linspace(0.0, ANGLES[-1], 2)
    curves = [
        Curve("G γ put in", reference, shear * np.deg2rad(reference)),
        Curve("simulated", [row[0] for row in rows], [row[1] for row in rows], POINTS),
    ]
    return Result(
        test=NAME,
        title=TITLE,
        method=f"A square of {1e3 * SIDE:g} mm in a hinged frame; stress from the work of the frame, against G γ.",
        setup=setup.summary(),
        columns=("angle °", "stress N/m", "G γ N/m", "settled"),
        rows=rows,
        values={"shear_stiffness": measured},
        checks=[Check("G [N/m]", measured, shear, TOLERANCE)],
        panels=[Panel("shear angle [°]", "shear stress [N/m]", curves)],
    )


def sheared(setup: Setup, angle: float) -> tuple[float, bool]:
    """Shear stress [N/m] at a shear angle [°], and whether the specimen settled."""
    fabric = replace(setup.fabric, damping_time=damping_time(SIDE), bending_hysteresis=0.0, bend_stiffness=0.0)
    half = 0.5 * SIDE
    cloth = rectangle((-half, -half), (half, half), SIDE / setup.cells(CELLS), setup, fabric, springs="woven")
    border = np.flatnonzero(np.abs(cloth.points[:, :2]).max(axis=1) > half * (1.0 - 1e-6))
    energies, settled = [], True
    for share in (1.0 - SMALL, 1.0 + SMALL):
        held = strained(cloth, border, _rhombus(np.deg2rad(angle) * share), setup, SIDE)
        energies.append(held.energy)
        settled = settled and held.settled
    return float((energies[1] - energies[0]) / (2.0 * SMALL * np.deg2rad(angle) * SIDE * SIDE)), settled


def _rhombus(angle: float) -> Deformation:
    """A frame whose right angles have become smaller or larger by ``angle`` [rad]."""
    c, s = np.cos(0.5 * angle), np.sin(0.5 * angle)
    matrix = np.array([[c, s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def deformed(points: np.ndarray) -> np.ndarray:
        return np.asarray(points @ matrix)

    return deformed
