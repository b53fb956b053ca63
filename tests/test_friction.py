"""Coulomb's law where it has closed forms: cloth on cloth, a strip over a cylinder, a strip over a table's edge."""

import math
from dataclasses import replace

import numpy as np
import pytest

import warpcloth as wc
from warpcloth.cloth.pins import Pin

MU, G = 0.3, 9.81
SUBSTEPS = (10, 100)  # of frames of 1/60 s
THRESHOLD = math.degrees(math.atan(MU))


def strip(length: float, spacing: float, fabric: wc.Fabric) -> wc.Cloth:
    """Two rows of particles along x, flat and at rest."""
    return wc.Cloth.grid((length, spacing), (round(length / spacing) + 1, 2), fabric)


def slide(angle: float, substeps: int, frames: int) -> tuple[float, float]:
    """Way [m] and speed [m/s] of a patch on a sheet that is held everywhere, both tilted by ``angle`` [degrees]."""
    fabric = wc.Fabric(
        thickness=0.004, friction=MU, stretch_stiffness=20.0, shear_stiffness=4.0, bend_stiffness=0.2
    )  # soft enough for 10 substeps
    held = wc.Cloth.grid((0.9, 0.9), (14, 14), fabric, name="held", pins=[np.arange(14 * 14)])
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


@pytest.mark.parametrize("substeps", SUBSTEPS)
def test_cloth_sticks_to_cloth_up_to_the_angle_of_friction(substeps):
    """0.2° above it, the patch gains 0.036 m/s in a second; below, it keeps what it gains in a fraction of a step."""
    dt = 1.0 / 60.0 / substeps
    assert slide(THRESHOLD + 0.2, substeps, 60)[1] == pytest.approx(0.0357, rel=0.15)
    assert slide(THRESHOLD - 0.2, substeps, 60)[1] < 0.5 * G * math.sin(math.radians(THRESHOLD)) * dt


@pytest.mark.parametrize("substeps", SUBSTEPS)
def test_capstan(substeps):
    """A strip drawn over half a cylinder: its tensions stand as exp(μ π), whatever the radius and the speed.

    It starts in that state, so that no waves run along it; tensions still vary by a few per cent as particle by
    particle leaves the cylinder, so they are averaged over the second half of a second and a half.
    """
    radius, leg, spacing, speed, strain, stiffness = 0.1, 0.2, 0.02, 0.05, 0.05, 20.0
    fabric = wc.Fabric(
        areal_density=0.8, thickness=0.004, friction=MU, stretch_stiffness=stiffness, shear_stiffness=0.0,
        bend_stiffness=0.0, damping_time=2e-3,
    )  # fmt: skip
    flat = strip(0.72, spacing, fabric)
    s = flat.points[:, 0] - flat.points[:, 0].min()
    way = np.linspace(0.0, 1.0, 20001)
    stretch = 1.0 + strain * np.exp(MU * np.clip((way - leg) / radius, 0.0, math.pi))
    rest = np.concatenate([[0.0], np.cumsum(np.diff(way) / (0.5 * (stretch[1:] + stretch[:-1])))])
    way = np.interp(s, rest, way)
    turn = np.clip((way - leg) / radius, 0.0, math.pi)
    height = radius * np.sin(turn) + np.minimum(way - leg, 0.0) - np.maximum(way - leg - math.pi * radius, 0.0)
    points = np.stack([-radius * np.cos(turn), flat.points[:, 1], height], axis=1)
    up, down = (wc.Motion.keyframes([(0.0, (0, 0, 0)), (10.0, (0, 0, 10.0 * v))]) for v in (speed, -speed))
    pins = (Pin(np.flatnonzero(s == s.min()), up), Pin(np.flatnonzero(s == s.max()), down))
    cylinder = wc.Capsule((0, -0.5, 0), (0, 0.5, 0), radius - 0.003, friction=MU)
    model = wc.Model.build(replace(flat, points=points, pins=pins), cylinder)
    sim = wc.Simulation(model, gravity=(0, 0, 0), substeps=substeps)
    sim.state.particle_qd.assign(speed * np.stack([np.sin(turn), 0.0 * turn, np.cos(turn)], axis=1))
    ratios = []
    for _ in range(90):
        sim.step(1.0 / 60.0)
        ratios.append(tension(sim, 1.0) / tension(sim, -1.0))
    assert np.mean(ratios[45:]) == pytest.approx(math.exp(MU * math.pi), rel=0.02)
    assert sim.metrics()["max_penetration_m"] < 1e-4


def tension(sim: wc.Simulation, side: float) -> float:
    """Mean elastic force [N] of the springs along the strip where it hangs free on one side of x = 0."""
    x = sim.state.particle_q.numpy().astype(np.float64)
    ends, rest = sim.model.spring_indices.numpy(), sim.model.spring_rest_length.numpy()
    middle, d = x[ends].mean(axis=1), x[ends[:, 1]] - x[ends[:, 0]]
    length = np.linalg.norm(d, axis=1)
    chosen = (np.abs(middle[:, 2] + 0.08) < 0.03) & (side * middle[:, 0] > 0.0) & (np.abs(d[:, 2]) > 0.5 * length)
    assert chosen.sum() >= 4
    return float((sim.model.spring_stiffness.numpy() * (length / rest - 1.0))[chosen].mean())


@pytest.mark.parametrize("substeps", SUBSTEPS)
def test_strip_over_the_edge_of_a_table(substeps):
    """It slides off when overhang over length exceeds μ/(1 + μ), the edge being smooth and without friction."""
    for share, slides in ((0.97, False), (1.03, True)):
        drop = dropped_from_table(share * MU / (1.0 + MU), substeps)
        assert drop > 0.05 if slides else abs(drop) < 1e-3


def dropped_from_table(share: float, substeps: int) -> float:
    """How far [m] the hanging end has sunk after a second; ``share`` is what hangs, of the length of the strip.

    The edge is a quarter of a cylinder: a depth of one radius on the length of a quarter circle. By what that is longer
    it neither pulls nor holds, so it is left out of the length. Tension is there from the start, as large as friction
    can hold, so that the strip does not fall into it.
    """
    length, spacing, radius, density, stiffness = 0.6, 0.01, 0.04, 0.5, 10.0
    fabric = wc.Fabric(
        areal_density=density, thickness=0.004, friction=MU, stretch_stiffness=stiffness, shear_stiffness=0.0,
        bend_stiffness=0.0, damping_time=3e-4,
    )  # fmt: skip
    hanging = share * (length - (0.5 * math.pi - 1.0) * radius)
    lying = hanging * (1.0 - share) / share
    flat = strip(length, spacing, fabric)
    s = flat.points[:, 0] - flat.points[:, 0].min()
    at = np.linspace(0.0, length, 20001)
    weight = density * G * np.minimum(np.minimum(hanging * at / lying, hanging), length - at)
    way = np.concatenate([[0.0], np.cumsum(np.diff(at) * (1.0 + 0.5 * (weight[1:] + weight[:-1]) / stiffness))])
    way = np.interp(s, at, way) - np.interp(lying, at, way)
    turn = np.clip(way / radius, 0.0, 0.5 * math.pi)
    height = radius * (np.cos(turn) - 1.0) - np.maximum(way - 0.5 * math.pi * radius, 0.0)
    points = np.stack([np.minimum(way, 0.0) + radius * np.sin(turn), flat.points[:, 1], height], axis=1)
    table = wc.Box((-1.0, 0.0, -0.503), (2.0, 1.0, 1.0), friction=MU)
    edge = wc.Capsule((0, -0.5, -radius), (0, 0.5, -radius), radius - 0.003, friction=0.0)
    sim = wc.Simulation(wc.Model.build(replace(flat, points=points), [table, edge]), substeps=substeps)
    sim.run(60)
    return float(points[:, 2].min() - sim.state.particle_q.numpy()[:, 2].min())
