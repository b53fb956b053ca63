"""Cloth and chains some of whose particles are many times as heavy as others, and masses that are set later."""

from dataclasses import replace

import numpy as np
import pytest

import warpcloth as wc
from warpcloth.integrators.position_step import weight_contrast

NEWTON = ("implicit_euler", "implicit_midpoint", "implicit_trapezoid", "bdf2")


def chain(masses: np.ndarray, precision: str = "float32") -> wc.Model:
    """A level metre of springs held at one end, which 50 times its weight would double."""
    n, load = len(masses), 9.81 * float(masses.sum())
    positions = np.linspace((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), n)
    springs = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    lengths = 1.0 / (n - 1)
    return wc.Model.from_springs(
        positions, masses, springs, lengths, 50.0 * load, 0.01 * load, [0], precision=precision
    )


def after(model: wc.Model, integrator: str, frames: int) -> np.ndarray:
    """Positions [m]."""
    sim = wc.Simulation(model, integrator, substeps=1)
    sim.run(frames)
    return sim.state.particle_q.numpy()


def test_the_light_are_solved_for_among_the_heavy():
    """Below a weight in the middle of a chain hangs what is 1e5 times as light; it swings as in float64."""
    masses = np.full(21, 0.005)
    masses[10] *= 1e5
    exact = after(chain(masses, "float64"), "implicit_euler", 30)
    assert exact[-1, 2] < -0.5  # it has fallen
    np.testing.assert_allclose(after(chain(masses), "implicit_euler", 30), exact, atol=2e-3)


@pytest.mark.parametrize("integrator", NEWTON)
def test_masses_set_later_are_those_that_count(integrator):
    """Of what is solved within a tolerance, too, which is a mean over masses."""
    heavy, light = (chain(np.full(21, mass)) for mass in (0.5, 5e-6))
    late, sim = (wc.Simulation(model, integrator, substeps=1) for model in (heavy, light))
    for name in ("particle_mass", "particle_inv_mass", "spring_stiffness", "spring_damping"):
        getattr(heavy, name).assign(getattr(light, name))
    for each in (late, sim):
        each.run(10)
    np.testing.assert_array_equal(late.state.particle_q.numpy(), sim.state.particle_q.numpy())


def hemmed(weight: float) -> wc.Cloth:
    """Cloth pinned at two corners whose last row is ``weight`` times as heavy, in springs as strong as it asks."""
    cloth = wc.Cloth.grid((0.5, 0.5), (9, 9), pins=["top_left", "top_right"])
    masses = cloth.masses.copy()
    masses[:9] *= weight
    stronger = masses.sum() / cloth.masses.sum()
    springs = replace(
        cloth.springs, stiffness=stronger * cloth.springs.stiffness, damping=stronger * cloth.springs.damping
    )
    return replace(cloth, masses=masses, springs=springs)


def test_automatic_substeps_know_of_unequal_masses():
    """What sweeps leave of a load on light particles grows with it: 8 % of strain were left with 6 of them."""
    sim = wc.Simulation(wc.Model.build(hemmed(1000.0)), "xpbd")
    sim.run(30)
    assert sim.metrics()["mean_strain"] < 0.016


@pytest.mark.parametrize(
    "cloth",
    [hemmed(1.0), wc.Cloth.disc(0.3, 8, pins=[0]), wc.Cloth.grid((0.2, 0.4), (3, 5))],
    ids=("pinned", "disc", "free"),
)
def test_uniform_cloth_needs_no_more_for_its_masses(cloth):
    model = wc.Model.build(cloth)
    assert weight_contrast(model, model.cloths[0]) == 1.0
    model = chain(np.full(21, 0.5))
    assert weight_contrast(model, model.cloths[0]) == 1.0
