"""Cloth whose rough motion is damped within a step or much faster: implicit schemes converge, and gain nothing."""

import warnings
from itertools import pairwise

import numpy as np
import pytest
from integrator_problems import phase

import warpcloth as wc
from warpcloth.cloth import Cloth
from warpcloth.errors import ConvergenceWarning
from warpcloth.fabric import Fabric

SCHEMES = ["implicit_euler", "bdf2", "implicit_midpoint", "implicit_trapezoid"]
FRAME = 1.0 / 60.0


def rough(name: str, damping_time: float, precision: str = "float64", substeps: int = 1, n: int = 13) -> wc.Simulation:
    """Free cloth of 500 N/m, every vertex of which moves another way at 0.5 m/s, at rest as a whole."""
    cloth = Cloth.grid((0.5, 0.5), (n, n), Fabric(stretch_stiffness=500.0, damping_time=damping_time))
    model = wc.Model.build(cloth, precision=precision)
    velocities = 0.3 * np.random.default_rng(0).normal(size=(n * n, 3))
    model.particle_qd.assign(velocities - momentum(model, velocities) / model.particle_mass.numpy().sum())
    return wc.Simulation(model, name, (0, 0, 0), substeps)


def momentum(model: wc.Model, velocities: np.ndarray) -> np.ndarray:
    return model.particle_mass.numpy() @ velocities


@pytest.mark.parametrize(("precision", "substeps"), [("float32", 1), ("float64", 1), ("float64", 4)])
@pytest.mark.parametrize("damping_time", [0.005, 0.03, 0.1])
@pytest.mark.parametrize("name", SCHEMES)
def test_rough_cloth_only_loses_energy(name, damping_time, precision, substeps):
    """With half of n wᵀ in the matrices of springs (see their law), implicit Euler gained 110-fold energy at 0.03 s."""
    sim = rough(name, damping_time, precision, substeps)
    energies = [sim.energy()["total"]]
    with warnings.catch_warnings():
        warnings.simplefilter("error", ConvergenceWarning)
        for _ in range(12):
            sim.step(FRAME)
            energies.append(sim.energy()["total"])
    assert sim.metrics()["unconverged_steps"] == 0
    assert energies[1] < 0.6 * energies[0]
    assert max(later / earlier for earlier, later in pairwise(energies)) < 1.05
    drift = momentum(sim.model, phase(sim)[1]) / sim.model.particle_mass.numpy().sum()
    assert np.abs(drift).max() < (1e-8 if precision == "float64" else 1e-2)


@pytest.mark.parametrize("name", ["implicit_euler", "bdf2"])
def test_damping_far_stronger_than_steps_resolve_gains_nothing(name):
    """600 steps long, where not all of them converge: 114-fold energy and 0.56 m/s, or 156-fold, before."""
    sim = rough(name, 10.0, substeps=4)
    start = sim.energy()["total"]
    for _ in range(8):
        sim.step(FRAME)
        assert sim.energy()["total"] < 0.1 * start
    assert np.abs(momentum(sim.model, phase(sim)[1])).max() < 1e-6 * sim.model.particle_mass.numpy().sum()
