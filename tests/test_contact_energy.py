"""Energy and rest: contact adds no more energy than obstacles put in, and what lies stays where it lies."""

import math
from dataclasses import replace

import numpy as np
import pytest

import warpcloth as wc

FABRIC = wc.Fabric(thickness=0.004, friction=0.5, stretch_stiffness=40.0, shear_stiffness=8.0, bend_stiffness=0.2)
SCHEMES = [("symplectic_euler", 20), ("xpbd", 20), ("implicit_euler", 10)]


def sheet(height: float, angle: float = 0.2, name: str = "cloth", size: float = 0.24, n: int = 9) -> wc.Cloth:
    turn = np.eye(4)
    turn[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    turn[2, 3] = height
    return wc.Cloth.grid((size, size), (n, n), FABRIC, name=name, transform=turn)


def assert_energy_only_falls(sim: wc.Simulation, frames: int) -> None:
    """But for rises within 1e-4 of all that is lost."""
    energies = [sim.energy()["total"]]
    for _ in range(frames):
        sim.step(1.0 / 60.0)
        energies.append(sim.energy()["total"])
    lost = energies[0] - min(energies)
    assert lost > 0.3 * energies[0]
    assert np.max(energies - np.minimum.accumulate(energies)) < 1e-4 * lost


OBSTACLES = {"sphere": wc.Sphere((0, 0, 0), 0.12), "plane": wc.Plane()}


@pytest.mark.parametrize("obstacle", OBSTACLES)
@pytest.mark.parametrize(("name", "substeps"), SCHEMES)
def test_a_drop_on_an_obstacle_adds_no_energy(name, substeps, obstacle):
    model = wc.Model.build(sheet(0.2), OBSTACLES[obstacle], precision="float64")
    assert_energy_only_falls(wc.Simulation(model, name, substeps=substeps), 45)


@pytest.mark.parametrize(("name", "substeps"), SCHEMES)
def test_a_drop_of_cloth_on_cloth_adds_no_energy(name, substeps):
    cloths = [sheet(0.1, 0.2, "lower", 0.18, 7), sheet(0.13, 0.6, "upper", 0.18, 7)]
    model = wc.Model.build(cloths, wc.Plane(), precision="float64")
    assert_energy_only_falls(wc.Simulation(model, name, substeps=substeps, contact="all"), 45)


@pytest.mark.parametrize("name", ["symplectic_euler", "xpbd"])
def test_layers_thrown_together_lose_energy_and_as_much_at_any_step(name):
    """Three sheets hit a hanging one at 8 m/s, more at once than one exchange of impulses can stop."""
    fabric = replace(FABRIC, stretch_stiffness=300.0, shear_stiffness=60.0, thickness=0.0025)
    bed = wc.Cloth.grid((0.3, 0.3), (11, 11), fabric, pins=["left", "right"])
    falling = [
        replace(sheet(0.03 + 0.03 * k, 0.4 * (k + 1), f"layer {k}"), fabric=fabric, velocity=(0, 0, -8.0))
        for k in range(3)
    ]
    model, ends = wc.Model.build([bed, *falling]), []
    for substeps in (150, 600, 2400):
        sim = wc.Simulation(model, name, substeps=substeps, contact="all")
        energies = [sim.energy()["total"]]
        for _ in range(5):
            sim.step(1.0 / 60.0)
            energies.append(sim.energy()["total"])
        assert np.diff(energies).max() < 0.0
        ends.append(energies[-1] / energies[0])
    assert np.ptp(ends) < 0.1
    assert ends[0] < 0.5


@pytest.mark.parametrize("speed", [1.0, 6.0])
@pytest.mark.parametrize(("name", "substeps"), SCHEMES)
def test_a_spinning_sphere_puts_in_what_its_torque_does(name, substeps, speed):
    """Only friction has a moment about the axis: its work on the sphere's side is ω times the cloth's gain of angular
    momentum, and the cloth has at most that; at the end it turns with the sphere."""
    angles = np.linspace(0.0, 2.0 * speed, 81)
    spin = wc.Motion.keyframes([(2.0 * k / 80, (0, 0, 0), (0, 0, a)) for k, a in enumerate(angles)])
    model = wc.Model.build(sheet(0.1235), wc.Sphere((0, 0, 0), 0.12, motion=spin), precision="float64")
    sim = wc.Simulation(model, name, substeps=substeps)
    mass = model.particle_mass.numpy()

    def measures() -> tuple[float, float, float]:
        """Energy [J], angular momentum [kg m²/s], moment of inertia [kg m²]."""
        x, v = sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()
        momentum = np.sum(mass * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]))
        return sim.energy()["total"], momentum, np.sum(mass * (x[:, 0] ** 2 + x[:, 1] ** 2))

    balance = []
    for _ in range(90):
        energy, momentum, inertia = measures()
        balance.append(energy - speed * momentum)
        sim.step(1.0 / 60.0)
    assert momentum / inertia == pytest.approx(speed, rel=0.02)
    assert np.diff(balance).max() < 1e-4 * (balance[0] - balance[-1])


@pytest.mark.parametrize("contact", ["obstacles", "all"])
def test_cloth_left_on_a_sphere_for_a_minute_does_not_creep(contact):
    sim = wc.Simulation(wc.Model.build(sheet(0.14), wc.Sphere((0, 0, 0), 0.12)), substeps=20, contact=contact)
    sim.run(600)
    early = sim.state.particle_q.numpy().copy()
    sim.run(3000)
    assert np.abs(sim.state.particle_q.numpy() - early).max() < 2e-5
    assert np.abs(sim.state.particle_qd.numpy()).max() < 1e-4
    assert sim.settled
    assert sim.metrics()["max_penetration_m"] == 0.0


def test_a_pile_comes_to_rest_and_stays():
    """Layers press on each other through one exchange of impulses a substep, so velocities at its end keep about 2 g dt
    that positions do not have; with 40 substeps that, too, is below the 0.01 m/s of cloth at rest."""
    layers = [sheet(0.02 + 0.02 * k, 0.5 * k, f"layer {k}", 0.15, 6) for k in range(3)]
    sim = wc.Simulation(wc.Model.build(layers, wc.Plane()), "xpbd", substeps=40, contact="all")
    sim.run(60)
    total = float(sim.model.particle_mass.numpy().sum())
    for _ in range(60):
        before = sim.state.particle_q.numpy().copy()
        sim.step(1.0 / 60.0)
        assert sim.energy()["kinetic"] < 0.5 * total * 0.01**2
        assert np.sqrt(np.mean(np.square(60.0 * (sim.state.particle_q.numpy() - before)))) < 2e-3
    assert sim.settled
    heights = [sim.state.particle_q.numpy()[c.start : c.stop, 2].mean() for c in sim.model.cloths]
    assert np.all(np.diff(heights) > 0.002)
