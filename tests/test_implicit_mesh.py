"""Implicit steps on a mesh, whose faces cloth meets one after the other while a step is solved."""

import numpy as np
from integrator_problems import phase

import warpcloth as wc


def on_the_bunny(height, side=24):
    """Where paths onto the bunny's ears meet them jumps between faces while a step is solved."""
    cloth = wc.Cloth.grid((1.1, 1.1), (side, side), wc.library_fabric("cotton"), transform=(0.0, 0.0, height))
    scale = np.diag([0.33, 0.33, 0.33, 1.0]) + np.outer([0.05, 0.025, -0.007, 0.0], [0.0, 0.0, 0.0, 1.0])
    return [cloth], [wc.MeshObstacle.from_mesh("warp:bunny.usd", transform=scale)]


def test_steps_converge_on_a_mesh_whose_faces_cloth_passes_from_one_to_the_next():
    sim = wc.Simulation(wc.Model.build(*on_the_bunny(0.57)), "implicit_euler", air=wc.Air(), substeps=5)
    for _ in range(14):
        sim.step(1.0 / 24.0)
    assert np.count_nonzero(sim.contact.support.shape.numpy() >= 0) > 5
    assert sim.metrics()["unconverged_steps"] == 0


def test_when_a_particle_keeps_its_plane_does_not_depend_on_other_worlds():
    """Searches along a step in one world evaluate forces in all."""
    worlds = [on_the_bunny(0.57, 16), on_the_bunny(0.6, 16)]
    ends = []
    for model in (wc.Model.build_worlds(worlds), *(wc.Model.build(*world) for world in worlds)):
        sim = wc.Simulation(model, "implicit_euler", air=wc.Air(), substeps=5)
        for _ in range(8):
            sim.step(1.0 / 24.0)
        ends.append(phase(sim)[0].copy())
    assert np.array_equal(ends[0], np.concatenate(ends[1:]))
