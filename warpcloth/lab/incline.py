"""Friction on an incline: cloth slides with g (sin θ − μ cos θ) on steep ones and sticks on those below tan θ = μ."""

from dataclasses import replace

import numpy as np

from ..cloth import Cloth
from ..fabric import STANDARD_GRAVITY, Fabric
from ..model import Model
from ..obstacles import Plane
from ..simulation import Simulation
from .result import POINTS, Check, Curve, Panel, Result
from .setup import Progress, Setup
from .specimen import rectangle

NAME = "incline"
TITLE = "Friction on an incline"
SIDE, TIME, FRAMES = 0.1, 0.5, 200  # [m], [s]
CELLS = 4
STEEP = (10.0, 20.0)  # above the angle at which it would begin to slide [°]
SHALLOW = 0.8  # of that angle
TOLERANCE, CREEP = 0.02, 0.5  # relative; and [mm] that cloth at rest may have moved


def run(setup: Setup, progress: Progress) -> Result:
    """Distances after half a second against Coulomb's law."""
    friction = setup.fabric.friction
    threshold = float(np.rad2deg(np.arctan(friction)))
    rows, checks, curves = [], [], []
    for angle in (SHALLOW * threshold, *(threshold + more for more in STEEP)):
        progress(f"{angle:.1f}°")
        way = slid(setup, angle)
        acceleration = max(0.0, acceleration_at(angle, friction))
        expected = 0.5 * acceleration * TIME**2
        rows.append((angle, 1e3 * float(way[-1]), 1e3 * expected))
        if acceleration == 0.0:
            checks.append(Check(f"creep in {TIME:g} s at {angle:.1f}° [mm]", rows[-1][1], 0.0, CREEP, absolute=True))
        else:
            checks.append(Check(f"distance in {TIME:g} s at {angle:.1f}° [mm]", *rows[-1][1:], TOLERANCE))
        t = np.linspace(0.0, TIME, FRAMES + 1)
        curves.append(Curve(f"{angle:.1f}°, Coulomb", t, 1e3 * 0.5 * acceleration * t**2))
        curves.append(Curve(f"{angle:.1f}°, simulated", t[::20], 1e3 * way[::20], POINTS))
    return Result(
        test=NAME,
        title=TITLE,
        method=f"A square of {1e3 * SIDE:g} mm on a plane with the fabric's own friction, μ = {friction:g}, at rest at "
        "first; against ½ g (sin θ − μ cos θ) t².",
        setup=setup.summary(),
        columns=("angle °", "distance mm", "Coulomb mm"),
        rows=rows,
        values={"threshold_deg": threshold},
        checks=checks,
        panels=[Panel("time [s]", "distance [mm]", curves)],
    )


def acceleration_at(angle: float, friction: float) -> float:
    """g (sin θ − μ cos θ) [m/s²]; negative where it sticks."""
    theta = np.deg2rad(angle)
    return float(STANDARD_GRAVITY * (np.sin(theta) - friction * np.cos(theta)))


def slid(setup: Setup, angle: float) -> np.ndarray:
    """Mean way down the plane [m] at the ends of all frames, shape [frames + 1]."""
    theta, fabric = np.deg2rad(angle), replace(setup.fabric, bend_stiffness=0.0)
    gap = 1e-3
    cloth = square(setup, fabric, gap + 0.5 * fabric.thickness)
    plane = Plane(friction=fabric.friction, thickness=gap)
    gravity = STANDARD_GRAVITY * np.array([np.sin(theta), 0.0, -np.cos(theta)])
    simulation = Simulation(Model.build(cloth, plane, precision="float64"), setup.integrator, gravity)
    start, ways = cloth.points[:, 0].mean(), [0.0]
    for _ in range(FRAMES):
        simulation.step(TIME / FRAMES)
        ways.append(float(simulation.state.particle_q.numpy()[:, 0].mean() - start))
    return np.array(ways)


def square(setup: Setup, fabric: Fabric, height: float) -> Cloth:
    """The specimen, level at a height [m]; its mesh as ``setup`` asks."""
    half = 0.5 * SIDE
    flat = rectangle((-half, -half), (half, half), SIDE / setup.cells(CELLS), setup, fabric, springs="woven")
    return replace(flat, points=np.add(flat.points, (0.0, 0.0, height)))
