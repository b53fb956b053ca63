"""Cloth that has grown as no fabric can, with finite numbers: a simulation that says so, and what is no such cloth."""

import numpy as np
import pytest

import warpcloth as wc
from warpcloth.errors import DivergedError


def sheet() -> wc.Cloth:
    return wc.Cloth.grid(size=(0.4, 0.4), resolution=(4, 4))


@pytest.mark.parametrize("contact", ["none", "obstacles"])
def test_torn_cloth_is_refused_though_all_of_it_is_finite(contact):
    sim = wc.Simulation(wc.Model.build_worlds(3 * [([sheet()], [])]), gravity=(0, 0, 0), contact=contact)
    sim.step(1 / 60)
    far = sim.state.particle_q.numpy()
    far[20] += (0, 0, 50.0)
    sim.state.particle_q.assign(far)
    with pytest.raises(DivergedError, match="triangle edges grew to 100 times") as failure:
        sim.step(1e-6)
    assert failure.value.worlds == (1,)
    assert np.isfinite(sim.state.particle_q.numpy()).all()
    sim.reset([False, True, False])
    sim.step(1 / 60)


def test_what_stretches_without_being_cloth_or_by_less_is_not_torn():
    rope = wc.Model.from_springs([(0, 0, 0), (0, 0, -1)], 1.0, [(0, 1)], 1.0, 1e-3, 0.0, pinned=[0])
    sim = wc.Simulation(rope, substeps=10)
    sim.run(300)
    assert sim.metrics()["max_strain"] > 100
    sim = wc.Simulation(wc.Model.build(sheet()), gravity=(0, 0, 0))
    sim.state.particle_q.assign(50 * sim.state.particle_q.numpy())
    sim.step(1e-6)
    assert sim.metrics()["max_strain"] > 40


def test_an_obstacle_whose_loop_jumps_back_through_cloth_is_named():
    """It would pass the cloth in a single step; no substeps help."""
    way = [(0.0, 0.0, 0.0), (0.0, 0.6, 0.0), (0.0, 0.6, 0.6), (0.0, 0.0, 0.6)]
    jumps = wc.Motion(np.linspace(0.0, 0.3, 4), way, np.zeros((4, 3)), loop=True)
    fabric = wc.Fabric(stretch_stiffness=2000.0, thickness=0.001)
    held = wc.Cloth.grid((0.4, 0.4), (17, 17), fabric, pins=[wc.pin("left"), wc.pin("right")])
    model = wc.Model.build([held], [wc.Sphere((0.0, 0.0, -0.3), 0.08, motion=jumps)], device="cpu")
    with pytest.raises(DivergedError, match="obstacles are too fast, as where a loop jumps back"):
        wc.Simulation(model, "xpbd", contact="all").run(30)
