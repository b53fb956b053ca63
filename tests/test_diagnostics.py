"""Measures of a state against what they are by definition."""

import numpy as np
import pytest
from test_bending import SLIPPING, bent

import warpcloth as wc
from warpcloth import diagnostics
from warpcloth.state import State


def worlds() -> wc.Model:
    """Two worlds, of light and of heavy cloth, pinned at one edge."""
    cloths = [wc.Cloth.grid((0.3, 0.2), (4, 3), wc.Fabric(areal_density=rho), pins="left") for rho in (0.1, 0.4)]
    return wc.Model.build_worlds([([cloth], []) for cloth in cloths], precision="float64")


def test_the_way_of_a_frame_is_that_of_free_mass_in_each_world():
    model, rng = worlds(), np.random.default_rng(0)
    before, after = State.of(model), State.of(model)
    way = rng.normal(size=(model.particle_count, 3))
    after.particle_q.assign(before.particle_q.numpy() + way)
    bad, found = diagnostics.frame_motion(model, before, after)
    mass = np.where(model.particle_inv_mass.numpy() > 0.0, model.particle_mass.numpy(), 0.0).reshape(2, -1)
    assert len(np.unique(mass[0])) > 2
    squares = np.sum(way**2, axis=1).reshape(2, -1)
    np.testing.assert_allclose(found, np.sqrt(np.sum(mass * squares, axis=1) / mass.sum(axis=1)), rtol=1e-12)
    assert bad.tolist() == [0, 0]
    for array, particle, value in ((after.particle_q, 13, np.nan), (after.particle_qd, 20, np.inf)):
        values = array.numpy()
        values[particle, 1] = value
        array.assign(values)
    assert diagnostics.frame_motion(model, before, after)[0].tolist() == [0, 2]


def test_energies_of_motion_and_of_height():
    model, rng = worlds(), np.random.default_rng(1)
    sim = wc.Simulation(model, gravity=(1.0, -2.0, -9.0), substeps=1)
    x, v = rng.normal(size=(2, model.particle_count, 3))
    sim.state.particle_q.assign(x)
    sim.state.particle_qd.assign(v)
    energy, mass = sim.energy(), model.particle_mass.numpy()
    assert energy["kinetic"] == pytest.approx(0.5 * np.sum(mass * np.sum(v * v, axis=1)), rel=1e-12)
    assert energy["gravity"] == pytest.approx(-np.sum(mass * (x @ (1.0, -2.0, -9.0))), rel=1e-12)
    assert energy["total"] == pytest.approx(sum(energy[name] for name in energy if name != "total"), rel=1e-15)
    assert diagnostics.greatest_speeds(model, sim.state) == pytest.approx(
        np.linalg.norm(v, axis=1).reshape(2, -1).max(axis=1), rel=1e-12
    )


def test_strain_is_that_of_threads_stretched_or_compressed():
    """Of a grid of square cells, as many threads along x as along y; diagonals and bending springs do not count."""
    model = wc.Model.build(wc.Cloth.grid((0.3, 0.3), (4, 4)), precision="float64")
    assert (model.spring_kind.numpy() != 0).any()
    state = State.of(model)
    state.particle_q.assign(state.particle_q.numpy() * np.array([0.98, 1.03, 1.0]))
    measures = diagnostics.measure(model, state, 2.5)
    assert (measures["mean_strain"], measures["max_strain"]) == pytest.approx((0.025, 0.03), rel=1e-9)
    assert measures["time"] == 2.5


def test_the_energy_of_friction_in_bending_is_the_work_that_it_took():
    """Of a sheet bent from rest so far that all friction slips: its energy has no jump there."""
    model, forces, state, term = bent("grid", SLIPPING)
    term.slip.zero_()
    state.particle_qd.zero_()
    flat = model.particle_q.numpy()
    way, work, before = state.particle_q.numpy() - flat, 0.0, np.zeros((model.particle_count, 3))
    for share in np.linspace(0.0, 1.0, 401):
        state.particle_q.assign(flat + share * way)
        forces.evaluate(state)
        f = state.particle_f.numpy()
        work -= 0.5 * np.sum((before + f) * way) / 400.0
        before = f.copy()
    assert term.energy(state)["bending"] == pytest.approx(work, rel=1e-4)
