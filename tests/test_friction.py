"""Coulomb's law where it has closed forms: cloth on cloth, a strip over a cylinder, a strip over a table's edge."""

import math

import numpy as np
import pytest
from friction_problems import CAPSTAN_RADIUS, EDGE_RADIUS, MU, G, capstan_start, capstan_tension, table_start

import warpcloth as wc

SUBSTEPS = (10, 100)  # of frames of 1/60 s
THRESHOLD = math.degrees(math.atan(MU))


def slide(angle: float, substeps: int, frames: int, rough: float = 1.0) -> tuple[float, float]:
    """Way [m] and speed [m/s] of a patch on a sheet that is held everywhere, both tilted by ``angle`` [degrees].

    The sheet is ``rough`` times as rough as their mean, and the patch by as much smoother.
    """
    fabric, below = (
        wc.Fabric(thickness=0.004, friction=mu, stretch_stiffness=20.0, shear_stiffness=4.0, bend_stiffness=0.2)
        for mu in (MU / rough, MU * rough)
    )  # soft enough for 10 substeps
    held = wc.Cloth.grid((0.9, 0.9), (14, 14), below, name="held", pins=[np.arange(14 * 14)])
    turn = np.array([[0.955, -0.296, 0, -0.2], [0.296, 0.955, 0, 0], [0, 0, 1, 0.0041], [0, 0, 0, 1]])
    turn[:2, :2] /= math.hypot(0.955, 0.296)
    patch = wc.Cloth.grid((0.15, 0.15), (6, 6), fabric, name="patch", transform=turn)
    tilt = math.radians(angle)
    gravity = (G * math.sin(tilt), 0.0, -G * math.cos(tilt))
    sim = wc.Simulation(wc.Model.build([held, patch]), gravity=gravity, substeps=substeps, contact="all")
    start = sim.state.particle_q.numpy()[14 * 14 :, 0].mean()
    sim.run(frames)
    assert sim.metrics()["contact_held"] == 0
    return sim.state.particle_q.numpy()[14 * 14 :, 0].mean() - start, sim.state.particle_qd.numpy()[14 * 14 :, 0].mean()


@pytest.mark.parametrize("substeps", SUBSTEPS)
def test_cloth_slides_on_cloth_as_coulomb_says(substeps):
    """30°, half a second: g (sin θ − μ cos θ) t²/2."""
    assert slide(30.0, substeps, 30)[0] == pytest.approx(0.294536, rel=0.01)


def test_the_friction_of_two_cloths_is_the_geometric_mean_of_theirs():
    assert slide(30.0, 10, 30, rough=3.0)[0] == pytest.approx(0.294536, rel=0.01)


@pytest.mark.parametrize("substeps", SUBSTEPS)
def test_cloth_sticks_to_cloth_up_to_the_angle_of_friction(substeps):
    """0.2° above it, the patch gains 0.036 m/s in a second; below, it keeps what it gains in a fraction of a step."""
    dt = 1.0 / 60.0 / substeps
    assert slide(THRESHOLD + 0.2, substeps, 60)[1] == pytest.approx(0.0357, rel=0.15)
    assert slide(THRESHOLD - 0.2, substeps, 60)[1] < 0.15 * G * math.sin(math.radians(THRESHOLD)) * dt


@pytest.mark.parametrize("substeps", SUBSTEPS)
def test_capstan(substeps):
    """A strip drawn over half a cylinder: its tensions stand as exp(μ π), whatever the radius and the speed.

    It starts in that state, so that no waves run along it; tensions still vary by a few per cent as particle by
    particle leaves the cylinder, so they are averaged over the second half of a second and a half.
    """
    start = capstan_start(moving=True)
    cylinder = wc.Capsule((0, -0.5, 0), (0, 0.5, 0), CAPSTAN_RADIUS - 0.003, friction=MU)
    sim = wc.Simulation(wc.Model.build(start.cloth, cylinder), gravity=(0, 0, 0), substeps=substeps)
    sim.state.particle_qd.assign(start.velocities)
    ratios = []
    for _ in range(90):
        sim.step(1.0 / 60.0)
        x = sim.state.particle_q.numpy().astype(np.float64)
        ratios.append(capstan_tension(x, start.cloth, 1.0) / capstan_tension(x, start.cloth, -1.0))
    assert np.mean(ratios[45:]) == pytest.approx(math.exp(MU * math.pi), rel=0.02)
    assert sim.metrics()["max_penetration_m"] < 1e-4


@pytest.mark.parametrize("substeps", SUBSTEPS)
def test_strip_over_the_edge_of_a_table(substeps):
    """It slides off when overhang over length exceeds μ/(1 + μ), the edge being smooth and without friction."""
    for share, slides in ((0.97, False), (1.03, True)):
        drop = dropped_from_table(share * MU / (1.0 + MU), substeps)
        assert drop > 0.05 if slides else abs(drop) < 1e-3


def dropped_from_table(share: float, substeps: int) -> float:
    """How far [m] the hanging end has sunk after a second; ``share`` is what hangs, of the length of the strip."""
    start, radius = table_start(share), EDGE_RADIUS
    table = wc.Box((-1.0, 0.0, -0.503), (2.0, 1.0, 1.0), friction=MU)
    edge = wc.Capsule((0, -0.5, -radius), (0, 0.5, -radius), radius - 0.003, friction=0.0)
    sim = wc.Simulation(wc.Model.build(start.cloth, [table, edge]), substeps=substeps)
    sim.run(60)
    return float(start.cloth.points[:, 2].min() - sim.state.particle_q.numpy()[:, 2].min())
