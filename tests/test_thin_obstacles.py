"""Rods and balls that fit between the particles of cloth: it meets them by its edges and triangles."""

import functools

import numpy as np
import pytest
import trimesh

import warpcloth as wc
from warpcloth.facets import Facets, faceted
from warpcloth.intersections import intersections
from warpcloth.surface import Surface

touching = functools.partial(wc.Simulation, contact="all")
INTEGRATORS = ("symplectic_euler", "xpbd", "implicit_euler", "vbd")


def assert_never_intersects(sim: wc.Simulation, frames: int) -> None:
    for frame in range(frames):
        sim.step(1 / 60)
        crossing = intersections(sim.model, sim.state).sum()
        assert crossing == 0, f"{crossing} pairs in frame {frame}"


THIN = {
    "rod": wc.Capsule((-0.5, 0.03, 0), (0.5, 0.02, 0), 0.008),
    "ball": wc.Sphere((0.04, 0.03, 0), 0.012),
    "post": wc.Capsule((0.04, 0.03, -0.2), (0.04, 0.03, 0), 0.006),
}


@pytest.mark.parametrize("shape", THIN)
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_what_fits_between_particles_does_not_pass_between_them(shape, integrator):
    """A sheet with cells of 10 cm fell past such things, and nothing told."""
    sheet = wc.Cloth.grid((0.4, 0.4), (5, 5), transform=(0, 0, 0.05))
    sim = touching(wc.Model.build(sheet, THIN[shape]), integrator=integrator)
    assert_never_intersects(sim, 18)
    assert sim.state.particle_q.numpy()[:, 2].max() > -0.2  # 0.44 m lower it would be after a free fall
    assert sim.metrics()["contact_pinched"] == 0


@pytest.mark.parametrize("integrator", ["xpbd", "implicit_euler"])
def test_a_thin_rod_that_moves_takes_cloth_along(integrator):
    upright = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    curtain = wc.Cloth.grid((0.4, 0.4), (5, 5), transform=upright)
    way = wc.Motion.keyframes([(0, (0, 0, 0)), (0.25, (0, 0.5, 0))])
    rod = wc.Capsule((-0.3, -0.03, 0.04), (0.3, -0.03, 0.06), 0.005, motion=way)
    sim = touching(wc.Model.build(curtain, rod), integrator=integrator)
    assert_never_intersects(sim, 15)
    near = np.abs(sim.state.particle_q.numpy()[:, 2] + 0.5 * 9.81 * 0.25**2).argmin()
    assert sim.state.particle_q.numpy()[near, 1] > 0.2


@pytest.mark.parametrize("substeps", [4, 24])
def test_a_thin_rod_that_moves_along_itself_takes_cloth_along_by_friction(substeps):
    """Of the sheet on it only triangles and edges touch the rod; μ g = 4.9 m/s², so after 0.1 s it moves as the rod."""
    sheet = wc.Cloth.grid((0.4, 0.4), (5, 5), transform=(0.03, 0.03, 0.009))
    way = wc.Motion.keyframes([(0, (0, 0, 0)), (1.0, (0.4, 0, 0))])
    rod = wc.Capsule((-0.6, 0.0, 0), (0.6, 0.0, 0), 0.008, motion=way)
    sim = touching(wc.Model.build(sheet, rod), integrator="xpbd", substeps=substeps)
    sim.run(15)
    assert sim.state.particle_qd.numpy()[:, 0].mean() == pytest.approx(0.4, rel=0.1)


def test_rods_and_balls_larger_than_cells_have_no_facets():
    """Particles keep those out, and pairs of many small triangles would cost much."""
    obstacles = [(0, wc.Sphere(radius=r), -1) for r in (0.09, 0.11)] + [(1, wc.Sphere(radius=0.09), -1)]
    assert [solid.shape for solid in faceted(obstacles, {0: 0.1 * 2**0.5, 1: 0.1})] == [0]


def test_the_longest_edge_of_the_worlds_cloths_counts():
    fine = wc.Cloth.grid((0.1, 0.1), (11, 11), transform=(0, 0, 0.1))
    points = fine.points + np.where(fine.points == fine.points.max(axis=0), (0.08, 0.08, 0.0), 0.0)
    uneven = wc.Cloth.from_mesh(trimesh.Trimesh(points, fine.triangles, process=False), springs="woven")
    ball = wc.Sphere((0, 0, 0), 0.05)
    assert Surface(wc.Model.build(fine, ball)).tri_count == len(fine.triangles)
    assert Surface(wc.Model.build(uneven, ball)).tri_count > len(fine.triangles)


@pytest.mark.parametrize("obstacle", [wc.Sphere((1, 2, 3), 0.2), wc.Capsule((0, 0, 1), (0.3, 0.2, 0), 0.05), wc.Box()])
def test_facets_are_closed_face_outwards_and_lie_within_the_shape(obstacle):
    solid = Facets(0, 0, obstacle)
    mesh = trimesh.Trimesh(solid.rest, solid.triangles, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    if isinstance(obstacle, wc.Box):
        assert mesh.volume == pytest.approx(1.0)
        return
    r = obstacle.radius
    length = np.linalg.norm(obstacle.end - obstacle.start) if isinstance(obstacle, wc.Capsule) else 0.0
    assert 0.85 < mesh.volume / (np.pi * r**2 * (4.0 / 3.0 * r + length)) < 1.0
    middle = solid.rest.mean(axis=0)
    np.testing.assert_allclose(middle, obstacle.centre, atol=1e-9)
