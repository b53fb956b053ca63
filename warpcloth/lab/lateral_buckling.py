"""Lateral buckling: a narrow strip clamped with its width upright falls over to one side when it is too long.

A cantilever of length L and weight q per length that bends sideways with E I and twists with G J buckles under its own
weight at q L³/√(E I G J) = 12.854 (Prandtl 1899; Timoshenko and Gere, Theory of Elastic Stability, 1961). A strip of
cloth of width b has q = σ g b, E I = B b and G J = 2 (1 − ν) B b; so with Γ = σ g L³/B it buckles at Γ* = 18.178 where
ν = 0, which is a fabric's twist ratio of 1, and that is what is tested here whatever its own one is. Without resistance
to twist it would do so at any length.

Two columns of vertices are clamped. That holds twist from the second column on, from where lengths count here, and
bending from half a cell before it, which does not matter: a strip about to buckle bends sideways where it has twisted.

The test tilts gravity a little to the side and measures how far the tip of ever longer strips goes that way. Its
resistance, the load over its way, falls nearly linearly with Γ² and vanishes at Γ*² (Southwell's method). With the
angle ψ(s) of gravity to the twisted strip, s from the tip, it is 2 ψ(1)/∫ s³ ψ ds; ψ″ = −(Γ²/8) s⁴ ψ, ψ′(0) = 0.
"""

from dataclasses import replace

import numpy as np

from ..cloth import Pin
from ..fabric import STANDARD_GRAVITY
from ..model import Model
from .result import POINTS, Check, Curve, Panel, Result
from .settle import damping_time, settle
from .setup import Progress, Setup
from .specimen import rectangle

NAME = "lateral-buckling"
TITLE = "Lateral buckling"
CRITICAL = 18.178
GAMMAS = (8.0, 12.0, 15.0, 17.0)
CELLS = 32
WIDTH = 2  # of the strip, in cells
TILT = 1e-3  # of gravity [rad]
STIFF = 1e5  # stretch stiffness over the strip's weight per width, so that it stays straight in its own plane
BALANCE = 1e-7
TOLERANCE = 0.05


def run(setup: Setup, progress: Progress) -> Result:
    """Resistance of strips to a small sideways load, and the Γ at which it vanishes."""
    resistances = []
    for gamma in GAMMAS:
        progress(f"Γ = {gamma:g}")
        resistances.append(resistance(setup, gamma))
    critical = extrapolated(GAMMAS, resistances)
    gammas = np.linspace(0.0, CRITICAL, 60)
    line = Curve("narrow strip", gammas**2, [narrow_resistance(gamma) for gamma in gammas])
    points = Curve("simulated", [g * g for g in GAMMAS], resistances, POINTS)
    return Result(
        test=NAME,
        title=TITLE,
        method="A narrow strip clamped with its width upright, gravity tilted sideways by 0.001; the resistance to "
        "that load vanishes where the strip buckles, Γ* = 18.178 for Poisson's ratio 0 (Prandtl 1899).",
        setup=setup.summary(),
        columns=("Γ", "load over way of the tip", "of a narrow strip"),
        rows=[(gamma, value, narrow_resistance(gamma)) for gamma, value in zip(GAMMAS, resistances, strict=True)],
        values={"critical_gamma": critical},
        checks=[Check("critical Γ", critical, CRITICAL, TOLERANCE)],
        panels=[Panel("Γ²", "Γ tilt / (y/L)", [line, points])],
    )


def resistance(setup: Setup, gamma: float) -> float:
    """Γ times the tilt of gravity over the tip's sideways way per length."""
    fabric, cells = setup.fabric, setup.cells(CELLS)
    weight = fabric.areal_density * STANDARD_GRAVITY
    length = (gamma * fabric.bending[0] / weight) ** (1.0 / 3.0)
    cell, stiff = length / cells, STIFF * weight * length
    fabric = replace(
        fabric, stretch_stiffness=stiff, stretch_stiffness_weft=None, shear_stiffness=0.4 * stiff,
        bending_rigidity_weft=None, twist_ratio=1.0, bending_hysteresis=0.0, bend_stiffness=0.0, strain_limit=None,
        damping_time=damping_time(length) / np.sqrt(STIFF),
    )  # fmt: skip
    half = 0.5 * WIDTH * cell
    cloth = rectangle((-cell, -half), (length, half), cell, setup, fabric, lines=(0.0,))
    held = np.flatnonzero(cloth.points[:, 0] < 0.1 * cell).astype(np.int32)
    model = Model.build(replace(cloth, pins=(Pin(held),)), precision="float64")
    gravity = (0.0, -STANDARD_GRAVITY * np.cos(TILT), -STANDARD_GRAVITY * np.sin(TILT))
    rest = settle(model, setup, length, gravity=gravity, tolerance=BALANCE)
    tip = cloth.points[:, 0] > length - 1e-6 * cell
    return float(gamma * TILT * length / -rest.positions[tip, 2].mean())


def narrow_resistance(gamma: float) -> float:
    """Of a strip without width, by the power series of ψ."""
    term, end, integral = 1.0, 0.0, 0.0
    for k in range(30):
        end, integral = end + term, integral + term / (6 * k + 4)
        term *= -gamma * gamma / (8.0 * (6 * k + 6) * (6 * k + 5))
    return 2.0 * end / integral


def extrapolated(gammas: tuple[float, ...], resistances: list[float]) -> float:
    """Γ where the line through the last two points over Γ² is zero."""
    (a, b), (ra, rb) = np.square(gammas[-2:]), resistances[-2:]
    return float(np.sqrt(b + rb * (b - a) / (ra - rb)))
