"""Particles against obstacles: at rest, sliding, bouncing, fast, on every shape, still and moving."""

import math

import numpy as np
import pytest
import trimesh

import warpcloth as wc
from warpcloth.contact.obstacle_response import ObstacleResponse
from warpcloth.diagnostics import penetration
from warpcloth.errors import BadStartError
from warpcloth.transforms import rotation_matrix

G = 9.81


def patch(fabric=None, resolution=8, size=0.2, transform=None, velocity=(0, 0, 0), friction=0.5) -> wc.Cloth:
    """Soft enough for 10 substeps a frame."""
    fabric = fabric or wc.Fabric(
        thickness=0.004, friction=friction, stretch_stiffness=20.0, shear_stiffness=4.0, bend_stiffness=0.2
    )
    return wc.Cloth.grid(
        size=(size, size), resolution=(resolution, resolution), fabric=fabric, transform=transform, velocity=velocity
    )


def box_mesh(size, center, **options) -> wc.MeshObstacle:
    mesh = trimesh.creation.box(size)
    return wc.MeshObstacle(mesh.vertices + np.asarray(center), mesh.faces, **options)


RESTS = {
    "plane": (wc.Plane(), 0.0),
    "box": (wc.Box((0, 0, -0.5), (2, 2, 1)), 0.0),
    "mesh": (box_mesh((2, 2, 1), (0, 0, -0.5)), 0.0),
    "thin box": (wc.Box((0, 0, -0.001), (2, 2, 0.002)), 0.0),
}


@pytest.mark.parametrize("shape", RESTS)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_resting_cloth_neither_sinks_nor_jitters_nor_creeps(shape, precision):
    obstacle, top = RESTS[shape]
    offset = 0.002 + obstacle.thickness
    model = wc.Model.build(patch(transform=(0, 0, top + offset)), [obstacle], precision=precision)
    sim = wc.Simulation(model)
    start = sim.state.particle_q.numpy().copy()
    sim.run(120)
    moved = sim.state.particle_q.numpy() - start
    assert np.abs(moved[:, :2]).max() < 1e-7
    assert np.abs(moved[:, 2]).max() < 1e-5
    assert np.abs(sim.state.particle_qd.numpy()).max() < 1e-4
    assert sim.settled


CURVED = {
    "sphere": wc.Sphere((0, 0, -0.5), 0.5),
    "capsule": wc.Capsule((-0.3, 0, -0.5), (0.3, 0, -0.5), 0.5),
    "ico mesh": wc.MeshObstacle(
        trimesh.creation.icosphere(3, 0.5).vertices - [0, 0, 0.5], trimesh.creation.icosphere(3, 0.5).faces
    ),
}


@pytest.mark.parametrize("shape", CURVED)
def test_cloth_left_on_a_curved_obstacle_does_not_creep(shape):
    model = wc.Model.build(patch(transform=(0, 0, 0.004)), [CURVED[shape]])
    sim = wc.Simulation(model)
    sim.run(180)
    early = sim.state.particle_q.numpy().copy()
    sim.run(120)
    assert np.abs(sim.state.particle_q.numpy() - early).max() < 1e-5
    assert sim.settled
    assert sim.metrics()["max_penetration_m"] == 0.0


def slope(angle: float, friction: float, kind: str):
    """An incline through the origin and cloth lying flat on it."""
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    if kind == "plane":
        obstacle = wc.Plane((0, 0, 0), normal, friction=friction, thickness=0.0)
    else:
        rotation = np.array([0.0, angle, 0.0])
        if kind == "box":
            obstacle = wc.Box(-0.5 * normal, (4, 4, 1), rotation, friction=friction, thickness=0.0)
        else:
            mesh = trimesh.creation.box((4, 4, 1))
            mesh.apply_transform(trimesh.transformations.rotation_matrix(angle, (0, 1, 0)))
            obstacle = wc.MeshObstacle(mesh.vertices - 0.5 * normal, mesh.faces, friction=friction, thickness=0.0)
    turn = trimesh.transformations.rotation_matrix(angle, (0, 1, 0))
    turn[:3, 3] = 0.002 * normal
    cloth = patch(friction=friction, transform=turn)
    return cloth, obstacle, np.array([math.cos(angle), 0.0, -math.sin(angle)])


@pytest.mark.parametrize("kind", ["plane", "box", "mesh"])
@pytest.mark.parametrize("substeps", [10, 100])
def test_sliding_distance_on_an_incline(kind, substeps):
    cloth, obstacle, down = slope(math.radians(30.0), 0.3, kind)
    sim = wc.Simulation(wc.Model.build(cloth, obstacle), substeps=substeps)
    start = sim.state.particle_q.numpy().mean(axis=0)
    sim.run(30, fps=60)
    distance = (sim.state.particle_q.numpy().mean(axis=0) - start) @ down
    assert distance == pytest.approx(0.294536, rel=0.01)


@pytest.mark.parametrize("kind", ["plane", "box", "mesh"])
@pytest.mark.parametrize("substeps", [15, 40, 100])
def test_sliding_distance_with_friction_in_the_solution_of_a_step(kind, substeps):
    """Of a box as large as this one rounding held the cloth fast, with 30 steps a frame and more."""
    cloth, obstacle, down = slope(math.radians(30.0), 0.3, kind)
    sim = wc.Simulation(wc.Model.build(cloth, obstacle), "implicit_euler", substeps=substeps)
    start = sim.state.particle_q.numpy().mean(axis=0)
    sim.run(30, fps=60)
    distance = (sim.state.particle_q.numpy().mean(axis=0) - start) @ down
    assert distance == pytest.approx(0.294536, rel=0.02)


@pytest.mark.parametrize("kind", ["plane", "box", "mesh"])
@pytest.mark.parametrize("substeps", [10, 100])
def test_sticking_threshold_on_an_incline(kind, substeps):
    threshold = math.degrees(math.atan(0.3))
    for angle, slides in [(threshold - 0.2, False), (threshold + 0.2, True)]:
        cloth, obstacle, down = slope(math.radians(angle), 0.3, kind)
        sim = wc.Simulation(wc.Model.build(cloth, obstacle), substeps=substeps)
        start = sim.state.particle_q.numpy().mean(axis=0)
        sim.run(120)
        distance = (sim.state.particle_q.numpy().mean(axis=0) - start) @ down
        assert (distance > 1e-3) if slides else (abs(distance) < 1e-6)


THIN = {
    "plane": wc.Plane(),
    "sphere": wc.Sphere((0, 0, -0.2), 0.2),
    "capsule": wc.Capsule((-1, 0, -0.02), (1, 0, -0.02), 0.02),
    "box": wc.Box((0, 0, -0.001), (2, 2, 0.002)),
    "closed mesh": box_mesh((2, 2, 0.002), (0, 0, -0.001)),
    "open mesh": wc.MeshObstacle([[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]], [[0, 1, 2], [0, 2, 3]]),
}


@pytest.mark.parametrize("shape", THIN)
@pytest.mark.parametrize("mover", ["cloth", "obstacle"])
def test_nothing_tunnels_at_20_metres_a_second(shape, mover):
    obstacle = THIN[shape]
    size = 0.05 if shape in ("sphere", "capsule") else 0.2  # meet the curved ones near their top
    if mover == "cloth":
        cloth = patch(size=size, transform=(0, 0, 0.5), velocity=(0, 0, -20))
    else:
        cloth = patch(size=size, transform=(0, 0, 0.5))
        rise = wc.Motion.keyframes([(0.0, (0, 0, 0)), (0.1, (0, 0, 2.0))])
        obstacle = type(obstacle)(**{**obstacle.__dict__, "motion": rise})
    sim = wc.Simulation(wc.Model.build(cloth, obstacle), gravity=(0, 0, 0))
    lift = 0.0
    for frame in range(1, 7):
        sim.step(1 / 60)
        lift = min(frame / 60, 0.1) * 20.0 if mover == "obstacle" else 0.0
        assert sim.state.particle_q.numpy()[:, 2].min() > lift - 0.21
    centre = np.abs(sim.state.particle_q.numpy()[:, :2]).max(axis=1) < 0.02
    assert centre.any()
    assert sim.state.particle_q.numpy()[centre, 2].min() > lift - 1e-4
    assert sim.metrics()["max_penetration_m"] == 0.0


@pytest.mark.parametrize("shape", ["capsule", "box"])
@pytest.mark.parametrize("substeps", [1, 4])
def test_nothing_tunnels_at_a_flat_angle(shape, substeps):
    """Along 33 cm while it falls by 3 cm: in each of many looks for the surface it is nearer by a tenth only."""
    cloth = patch(size=0.01, resolution=2, transform=(-0.5, 0.0, 0.012), velocity=(20.0, 0.0, -2.0))
    model = wc.Model.build(cloth, type(THIN[shape])(**{**THIN[shape].__dict__, "friction": 0.0}))
    sim = wc.Simulation(model, "xpbd", gravity=(0, 0, 0), substeps=substeps)
    sim.run(2)
    x = sim.state.particle_q.numpy()
    assert x[:, 0].min() > 0.1
    assert x[:, 2].min() > 0.003 - 1e-3


@pytest.mark.parametrize("shape", ["plane", "box", "mesh"])
@pytest.mark.parametrize("substeps", [20, 200])
def test_restitution_acts_on_the_approach_speed(shape, substeps):
    original, _ = RESTS[shape]
    obstacle = type(original)(**{**original.__dict__, "restitution": 0.5})
    cloth = patch(transform=(0, 0, 0.1), velocity=(0, 0, -2.0))
    sim = wc.Simulation(wc.Model.build(cloth, obstacle, precision="float64"), gravity=(0, 0, 0), substeps=substeps)
    sim.run(6)
    assert np.allclose(sim.state.particle_qd.numpy()[:, 2], 1.0, atol=1e-9)


@pytest.mark.parametrize("shape", ["plane", "mesh"])
@pytest.mark.parametrize(("cloth", "obstacle"), [(0.9, 0.1), (0.9, 0.0)])
def test_the_friction_of_cloth_and_obstacle_is_the_geometric_mean_of_theirs(shape, cloth, obstacle):
    floor = type(RESTS[shape][0])(**{**RESTS[shape][0].__dict__, "friction": obstacle})
    sliding = patch(resolution=3, transform=(0, 0, 0.003), velocity=(2.0, 0.0, 0.0), friction=cloth)
    sim = wc.Simulation(wc.Model.build(sliding, floor, precision="float64"), "xpbd", substeps=10)
    sim.run(6)
    expected = 2.0 - math.sqrt(cloth * obstacle) * G * 0.1
    assert sim.state.particle_qd.numpy()[:, 0] == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("shape", ["box", "open mesh"])
def test_what_moves_through_a_plate_in_one_short_step_is_stopped(shape):
    """By 10 mm, from 0.5 mm above its contact distance to far enough below it to touch it no more."""
    cloth = patch(resolution=2, transform=(0, 0, 0.0035), velocity=(0, 0, -1.0))
    sim = wc.Simulation(wc.Model.build(cloth, THIN[shape]), "xpbd", gravity=(0, 0, 0), substeps=1)
    sim.step(0.01)
    assert sim.state.particle_q.numpy()[:, 2] == pytest.approx(0.003, abs=1e-5)


def test_what_rests_does_not_bounce():
    """Gravity brings it towards the obstacle in each step, but that is no speed at which it arrives."""
    sim = wc.Simulation(wc.Model.build(patch(transform=(0, 0, 0.002)), wc.Plane(restitution=0.8)), substeps=10)
    sim.run(10)
    assert np.abs(sim.state.particle_qd.numpy()).max() < 1e-6


@pytest.mark.parametrize("shape", ["plane", "box", "mesh"])
def test_friction_takes_from_the_way_only_what_follows_the_contact(shape):
    """Cloth thrown flat at a floor, μ = 0.5, meets it after 40 % of a step."""
    obstacle, _ = RESTS[shape]
    height, dt = 0.002 + obstacle.thickness, 1.0 / 60.0
    cloth = patch(transform=(0, 0, height + 0.4 * dt), velocity=(2.0, 0.0, -1.0))
    sim = wc.Simulation(wc.Model.build(cloth, obstacle, precision="float64"), "xpbd", (0, 0, 0), substeps=1)
    start = sim.state.particle_q.numpy().copy()
    sim.step(dt)
    moved = sim.state.particle_q.numpy() - start
    assert np.abs(moved - dt * np.array([2.0 - 0.6 * 0.5, 0.0, -0.4])).max() < 1e-6
    assert np.abs(sim.state.particle_qd.numpy() - [1.5, 0.0, 0.0]).max() < 2e-4  # meshes are in float32


def test_cloth_rides_on_a_moving_obstacle_without_slipping():
    motion = wc.Motion.keyframes([(0, (0, 0, 0)), (2, (0.5, 0, 0.2), (0, 0, 1.0))], interpolation="smooth")
    box = wc.Box((0, 0, -0.5), (2, 2, 1), motion=motion)
    cloth = patch(transform=(0, 0, 0.003))
    sim = wc.Simulation(wc.Model.build(cloth, box))
    sim.run(120)
    expected = motion.evaluate(cloth.points, 2.0, box.center)
    assert np.abs(sim.state.particle_q.numpy() - expected).max() < 1e-3


def test_deforming_mesh_carries_cloth_up():
    points = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    raised = points + np.array([0, 0, 0.5])
    samples = np.stack([points, raised, raised])
    sheet = wc.MeshObstacle(points, [[0, 1, 2], [0, 2, 3]], sample_times=[0, 0.5, 1.5], sample_points=samples)
    sim = wc.Simulation(wc.Model.build(patch(transform=(0, 0, 0.003)), sheet))
    sim.run(90)
    assert np.allclose(sim.state.particle_q.numpy()[:, 2], 0.503, atol=1e-4)


def test_a_mesh_that_deforms_fast_is_met_within_a_frame():
    """By cloth that hardly moves itself, and was far from it."""
    points = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    samples = np.stack([points, points + np.array([0, 0, 2.0])])
    sheet = wc.MeshObstacle(points, [[0, 1, 2], [0, 2, 3]], sample_times=[0, 1], sample_points=samples)
    sim = wc.Simulation(wc.Model.build(patch(transform=(0, 0, 0.02)), sheet), gravity=(0, 0, 0), substeps=20)
    sim.step(1 / 60)
    assert sim.state.particle_q.numpy()[:, 2].min() > 2.0 / 60.0


def test_depths_are_ways_to_the_nearest_point_of_the_surface():
    points = np.random.default_rng(0).uniform(-0.15, 0.15, (60, 3))
    half = np.array([0.15, 0.1, 0.05])
    turn = rotation_matrix((0.3, -0.2, 0.9))
    inside = {
        wc.Plane(): -points[:, 2],
        wc.Sphere((0, 0, 0), 0.15): 0.15 - np.linalg.norm(points, axis=1),
        wc.Capsule((0, 0, -0.1), (0, 0, 0.1), 0.1): 0.1
        - np.linalg.norm(points - np.outer(np.clip(points[:, 2], -0.1, 0.1), (0, 0, 1)), axis=1),
        wc.Box((0, 0, 0), 2 * half, rotation=(0.3, -0.2, 0.9)): np.min(half - np.abs(points @ turn), axis=1),
    }
    for obstacle, depths in inside.items():
        found = [penetration(point[None], [obstacle]) for point in points]
        np.testing.assert_allclose(found, np.maximum(depths, 0.0), atol=1e-6)
        assert 0 < np.count_nonzero(found) < 60


def test_cloth_starting_inside_an_obstacle_is_refused():
    with pytest.raises(BadStartError, match="Cloth 'cloth' starts inside an obstacle: 64 particles"):
        wc.Simulation(wc.Model.build(patch(transform=(0, 0, -0.1)), wc.Plane()))


def test_a_stretched_free_cloth_stays_symmetric():
    cloth = wc.Cloth.grid(size=(0.4, 0.4), resolution=(9, 9))
    model = wc.Model.build(cloth, precision="float64")
    sim = wc.Simulation(model, gravity=(0, 0, 0))
    sim.state.particle_q.assign(1.1 * cloth.points)
    sim.run(30)
    x = sim.state.particle_q.numpy().reshape(9, 9, 3)
    assert np.abs(x - 1.1 * cloth.points.reshape(9, 9, 3)).max() > 1e-3
    assert np.abs(x[:, :, 2]).max() == 0.0
    flip = np.array([-1.0, 1.0, 1.0])
    across_x = np.abs(x[::-1] * flip - x).max(), np.abs(x[:, ::-1] * flip - x).max()
    assert min(across_x) < 1e-9
    flip = np.array([1.0, -1.0, 1.0])
    across_y = np.abs(x[::-1] * flip - x).max(), np.abs(x[:, ::-1] * flip - x).max()
    assert min(across_y) < 1e-9


@pytest.mark.parametrize("velocity", [(0, 0, -1.0), (6.0, 2.0, -12.0)])
def test_particles_that_are_left_out_as_they_are_clear_would_have_met_nothing(velocity, monkeypatch):
    ball = trimesh.creation.icosphere(2, 0.05)
    ball.apply_translation((0.02, 0.05, 0.2))
    obstacles = [
        wc.Plane(), wc.Sphere((-0.1, 0, 0.1), 0.06), wc.Capsule((0.1, -0.1, 0.05), (0.1, 0.1, 0.1), 0.03),
        wc.Box((0.2, 0.1, 0.1), (0.1, 0.1, 0.1)), wc.MeshObstacle(ball.vertices, ball.faces),
    ]  # fmt: skip
    cloth = patch(resolution=12, size=0.4, transform=(0, 0, 0.3), velocity=velocity)
    ends, clear = [], []
    for looks in (True, False):
        with monkeypatch.context() as change:
            if not looks:
                change.setattr(ObstacleResponse, "begin", lambda *_: None)
            sim = wc.Simulation(wc.Model.build(cloth, obstacles), "xpbd", substeps=20)
            for _ in range(20):
                sim.step(1 / 60)
                clear.append(int((sim.contact.obstacles._clearance.numpy() > 0.0).sum()))
        ends.append(sim.state.particle_q.numpy().tobytes())
    assert ends[0] == ends[1]
    assert min(clear[:20]) < 120  # of 144: some are left out, and some are not
    assert max(clear[:20]) > 72
    assert max(clear[20:]) == 0


@pytest.mark.parametrize("substeps", [4, 8])
def test_cloth_that_sticks_to_a_turning_mesh_stays_where_it_is_on_it(substeps):
    """The mesh is given by its points, so it might deform; with one look at what carries, cloth crept by a fifth."""
    slab = trimesh.creation.box((2.0, 2.0, 0.1)).subdivide().apply_translation((0.0, 0.0, -0.05))
    rate, times = 6.0, np.linspace(0.0, 1.0, 401)
    turns = [trimesh.transformations.rotation_matrix(rate * t, (0, 0, 1))[:3, :3] for t in times]
    samples = np.array([slab.vertices @ turn.T for turn in turns])
    mesh = wc.MeshObstacle(slab.vertices, slab.faces, sample_times=times, sample_points=samples, friction=0.8)
    patch = wc.Cloth.grid((0.04, 0.04), (3, 3), transform=(0.1, 0.0, 0.00125))
    sim = wc.Simulation(wc.Model.build(patch, mesh, precision="float64"), "xpbd", substeps=substeps)
    sim.state.particle_qd.assign(np.cross([0.0, 0.0, rate], patch.points))
    sim.run(60)
    assert np.hypot(*sim.state.particle_q.numpy()[:, :2].mean(axis=0)) == pytest.approx(0.1, abs=2e-4)
