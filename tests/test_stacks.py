"""Layers at rest on each other keep their thickness, and what contact remembers for that belongs to its world."""

import numpy as np
import pytest
import trimesh

import warpcloth as wc
from warpcloth.cloth import Cloth

COTTON = wc.library_fabric("cotton")
FLOOR = wc.Plane(thickness=0.001)
FRAME = 1.0 / 60.0


def stack(count: int, size: float = 0.09, vertices: int = 7, fabric: wc.Fabric = COTTON) -> list[Cloth]:
    """Sheets on the floor, each a thickness above the one below."""
    lowest, step = FLOOR.thickness + 0.5 * fabric.thickness, fabric.thickness
    places = [(0.0, 0.0, lowest + k * step) for k in range(count)]
    grid = (size, size), (vertices, vertices), fabric
    return [wc.Cloth.grid(*grid, name=f"{k}", transform=x) for k, x in enumerate(places)]


def resting(worlds: list, integrator: str = "xpbd", **options) -> wc.Simulation:
    return wc.Simulation(wc.Model.build_worlds(worlds), integrator, contact="all", **options)


def gaps(sim: wc.Simulation, count: int) -> np.ndarray:
    """Between neighbours in a stack, in the mean over vertices and in thicknesses."""
    heights = sim.state.particle_q.numpy()[:, 2].reshape(count, -1).mean(axis=1)
    return np.diff(heights) / COTTON.thickness


def bits(sim: wc.Simulation, world: int = 0) -> bytes:
    own = sim.model.particle_world.numpy() == world
    return b"".join(array.numpy()[own].tobytes() for array in (sim.state.particle_q, sim.state.particle_qd))


@pytest.mark.parametrize("integrator", ["xpbd", "implicit_euler", "vbd"])
def test_sheets_at_rest_keep_their_thickness(integrator):
    """With automatic substeps; two passes in each step, and a floor that these know nothing of, left 0.1 to 0.2."""
    sim = resting([(stack(5), [FLOOR])], integrator)
    sim.run(60)
    assert gaps(sim, 5).min() > 0.85
    assert gaps(sim, 5).max() < 1.1
    assert sim.settled


@pytest.mark.parametrize("integrator", ["xpbd", "vbd", "pbd", "projective_dynamics"])
def test_coarse_sheets_at_rest_do_not_tremble(integrator):
    """By the schemes' own steps alone, 2 a frame with cells of 2.5 cm, single vertices moved at 0.2 m/s."""
    sim = resting([(stack(5, 0.1, 5, wc.library_fabric("denim")), [FLOOR])], integrator)
    sim.run(90)
    fastest = 0.0
    for _ in range(30):
        sim.step(FRAME)
        fastest = max(fastest, np.linalg.norm(sim.state.particle_qd.numpy(), axis=1).max())
    assert fastest < 0.12
    assert sim.settled


@pytest.mark.parametrize("substeps", [8, 16, 40])
def test_the_thickness_of_a_stack_does_not_depend_on_substeps(substeps):
    sim = resting([(stack(4), [FLOOR])], substeps=substeps)
    sim.run(60)
    np.testing.assert_allclose(gaps(sim, 4), 1.0, atol=0.1)


@pytest.mark.parametrize("speed", [1.0, -1.0])
def test_a_stack_keeps_its_thickness_on_a_floor_that_moves(speed):
    """What holds a pile up is the floor where it will be at the end of a step."""
    lift = wc.Motion.keyframes([(0.0, (0, 0, 0)), (1.0, (0, 0, speed))])
    sim = resting([(stack(4), [wc.Plane(thickness=0.001, motion=lift)])], substeps=10)
    sim.state.particle_qd.assign(np.full((4 * 49, 3), [0.0, 0.0, speed], np.float32))
    sim.run(40)
    np.testing.assert_allclose(gaps(sim, 4), 1.0, atol=0.1)


def test_what_is_no_longer_pressed_loses_its_load():
    sim = resting([(stack(4), [FLOOR])])
    sim.run(30)
    load = sim.contact.cloths.load.length.numpy().copy()
    assert load.max() > 0.1 * COTTON.thickness
    q = sim.state.particle_q.numpy()
    q[:, 2] += np.repeat(0.1 * np.arange(1, 5), 49)  # far apart
    sim.state.particle_q.assign(q)
    sim.step(FRAME)
    assert sim.contact.cloths.load.length.numpy().max() < 0.75 * load.max()
    assert not sim.contact.obstacles.holds.numpy().any()


def test_load_is_at_most_four_radii():
    sim = resting([(stack(1), [FLOOR])])
    sim.contact.cloths.load.length.fill_(1.0)
    sim.step(FRAME)
    assert 0.0 < sim.contact.cloths.load.length.numpy().max() <= 4.0 * 0.5 * COTTON.thickness


def sheet_on_a_cone() -> wc.Simulation:
    cone = wc.MeshObstacle.from_mesh(trimesh.creation.cone(0.05, 0.08, sections=8))
    sheet = wc.Cloth.grid((0.15, 0.15), (8, 8), COTTON, transform=(0.003, 0.004, 0.081))
    sim = resting([([sheet], [cone])])
    sim.run(20)
    return sim


def test_what_touches_an_obstacle_only_loses_its_load():
    sim = sheet_on_a_cone()
    load = sim.contact.cloths.load.length
    load.fill_(COTTON.thickness)
    sim.run(20)
    assert load.numpy().max() < 0.01 * COTTON.thickness


def test_load_keeps_no_distance_from_obstacles():
    plain, loaded = sheet_on_a_cone(), sheet_on_a_cone()
    assert bits(loaded) == bits(plain)
    loaded.contact.cloths.load.length.fill_(2.0 * COTTON.thickness)
    for sim in (plain, loaded):
        sim.step(FRAME)
    assert plain.contact.cloths.pairs.contacts.depth.numpy().max() > 0.0
    assert bits(loaded) == bits(plain)


def test_a_stack_that_is_reset_repeats_itself():
    sim = resting([(stack(4), [FLOOR])])
    sim.run(10)
    first = bits(sim)
    sim.reset()
    assert sim.contact.cloths.load.length.numpy().max() == 0.0
    sim.run(10)
    assert bits(sim) == first


def test_stacks_need_passes_of_their_own_world_only():
    """A pile beside it changes no bit of a lower one, in a model of both and when it goes on alone."""
    low, high = (stack(3), [FLOOR]), (stack(6), [FLOOR])
    alone, both = resting([low], substeps=10), resting([high, low], substeps=10)
    for sim in (alone, both):
        sim.run(12)
    assert bits(both, 1) == bits(alone)
    left = resting([high], substeps=10)
    left.continue_from(both, [0])
    for sim in (left, both):
        sim.run(6)
    assert bits(left) == bits(both)


def test_frames_done_again_begin_with_the_same_load():
    roomy, short = resting([(stack(4), [FLOOR])]), resting([(stack(4), [FLOOR])])
    for sim in (roomy, short):
        sim.run(10)
    short.contact.cloths.pairs._allocate(16)
    short._frames.forget()
    for sim in (roomy, short):
        sim.run(2)
    assert short.contact.cloths.pairs.capacity > 16
    assert bits(short) == bits(roomy)


def test_load_does_not_drive_a_sheet_apart():
    """Vertices of fine cloth are nearer each other than it is thick; what they carry must not part them."""
    thick = wc.Fabric(thickness=0.01)
    model = wc.Model.build(wc.Cloth.grid((0.05, 0.05), (11, 11), thick))
    sim = wc.Simulation(model, "xpbd", gravity=(0, 0, 0), substeps=10, contact="all")
    start = sim.state.particle_q.numpy().copy()
    sim.contact.cloths.load.length.fill_(0.02)
    sim.step(FRAME)
    np.testing.assert_allclose(sim.state.particle_q.numpy(), start, atol=1e-6)


def test_load_earns_no_more_passes_where_neighbours_are_near():
    """Contact distances within fine cloth are a part of its cells, however thick it is, and say nothing of its load."""
    model = wc.Model.build(wc.Cloth.grid((0.05, 0.05), (11, 11), wc.Fabric(thickness=0.02)))
    sim = wc.Simulation(model, gravity=(0, 0, 0), substeps=1, contact="all")
    squeezed = sim.state.particle_q.numpy() * np.array([0.3, 0.3, 1.0], np.float32)
    sim.state.particle_q.assign(squeezed)
    sim.contact.cloths.load.length.fill_(1.0)
    sim.step(1e-6)
    assert 0 < sim.contact.cloths.further.number.numpy()[0] <= 32
