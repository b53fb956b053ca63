"""What obstacles have done within an implicit step counts once, at its end, and for the obstacle that did it."""

import numpy as np
import pytest
import trimesh

import warpcloth as wc
from warpcloth.contact.obstacle_support import FREE_LOOKS

MU = 0.3
FABRIC = wc.Fabric(stretch_stiffness=50.0, shear_stiffness=10.0, friction=MU)
RADIUS = 0.5 * FABRIC.thickness
ALONG = np.array([0.03, 0.0, 0.0])


def sheet(position, **options) -> wc.Cloth:
    return wc.Cloth.grid((0.1, 0.1), (4, 4), FABRIC, transform=position, **options)


def corner(kind: str, friction: float) -> list:
    """A floor at z = 0 and a wall at x = 0.05 m and a radius."""
    common = {"thickness": 0.0, "friction": friction}
    edge = 0.05 + RADIUS
    if kind == "one mesh":
        boxes = [trimesh.creation.box((1.0, 1.0, 0.1)), trimesh.creation.box((0.1, 1.0, 1.0))]
        boxes[0].apply_translation((0.0, 0.0, -0.05))
        boxes[1].apply_translation((edge + 0.05, 0.0, 0.0))
        return [wc.MeshObstacle.from_mesh(trimesh.util.concatenate(boxes), **common)]
    planes = [wc.Plane(**common), wc.Plane((edge, 0.0, 0.0), (-1.0, 0.0, 0.0), **common)]
    return planes if kind == "floor first" else planes[::-1]


@pytest.mark.parametrize("kind", ["floor first", "wall first", "one mesh"])
@pytest.mark.parametrize("friction", [0.0, MU])
def test_cloth_that_leans_on_a_wall_stays_on_the_floor(kind, friction):
    """Its edge touches both; what one of them holds up is no rubbing at the other."""
    model = wc.Model.build([sheet((0.0, 0.0, RADIUS))], corner(kind, friction), precision="float64")
    sim = wc.Simulation(model, "implicit_euler", gravity=(0.5, 0.0, -9.81), substeps=5, contact="obstacles")
    for _ in range(20):
        sim.step(1.0 / 60.0)
        assert np.abs(sim.state.particle_q.numpy()[:, 2] - RADIUS).max() < 1e-6
        assert np.abs(sim.state.particle_qd.numpy()[:, 2]).max() < 1e-5
    right = sim.state.particle_q.numpy()[:, 0].max()
    assert right == pytest.approx(0.05, abs=1e-6)


@pytest.mark.parametrize("name", ["implicit_euler", "linear_implicit_euler"])
@pytest.mark.parametrize("speed", [0.5, 3.0])
def test_friction_of_an_impact_is_that_of_one_impact(name, speed):
    """Cloth that is thrown flat at a floor loses μ times what it falls with."""
    cloth = sheet((0.0, 0.0, RADIUS + 1e-3 * speed), velocity=(2.0, 0.0, -speed))
    model = wc.Model.build([cloth], [wc.Plane(thickness=0.0, friction=MU)], precision="float64")
    sim = wc.Simulation(model, name, gravity=(0.0, 0.0, 0.0), substeps=1, contact="obstacles")
    sim.step(1.0 / 240.0)
    velocities = sim.state.particle_qd.numpy()
    assert velocities[:, 2] == pytest.approx(0.0, abs=1e-6)
    assert velocities[:, 0] == pytest.approx(2.0 - MU * speed, rel=1e-4)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize("speed", [0.002, 2.0])
def test_what_is_rubbed_moves_along_as_far_as_its_velocity_says(restitution, speed):
    """In one step, at the end of which friction within it is put right; whether it slides or comes to a halt."""
    cloth = sheet((0.0, 0.0, RADIUS + 1e-4), velocity=(speed, 0.0, -0.5))
    floor = wc.Plane(thickness=0.0, friction=MU, restitution=restitution)
    model = wc.Model.build([cloth], [floor], precision="float64")
    sim = wc.Simulation(model, "implicit_euler", gravity=(0.0, 0.0, 0.0), substeps=1, contact="obstacles")
    start, dt = sim.state.particle_q.numpy().copy(), 1.0 / 240.0
    sim.step(dt)
    velocity = sim.state.particle_qd.numpy()
    assert velocity[:, 2] == pytest.approx(0.5 * restitution, abs=1e-6)
    assert velocity[:, 0] == pytest.approx(max(speed - MU * (1.0 + restitution) * 0.5, 0.0), abs=2e-4)
    moved = sim.state.particle_q.numpy() - start
    assert moved[:, :2] == pytest.approx(dt * velocity[:, :2], abs=1e-9)


def test_a_plane_that_was_met_is_kept_after_many_looks():
    """So that forces become continuous; in the next step the surface is looked at anew."""
    cloth = wc.Cloth.grid((0.02, 0.02), (2, 2), FABRIC, transform=(0.0, 0.0, 0.502))
    model = wc.Model.build([cloth], [wc.Sphere(radius=0.5, thickness=0.0, friction=0.0)], precision="float64")
    sim = wc.Simulation(model, "implicit_euler", contact="obstacles")
    support, end, start = sim.contact.support, sim.state.twin(), sim.state.particle_q.numpy()

    def direction(aside: float) -> np.ndarray:
        """Of the force on a particle at the end of a way down into the sphere and along x by so much [m]."""
        end.particle_q.assign(start + np.array([aside, 0.0, -0.004]))
        end.particle_f.zero_()
        support.accumulate(end, 0.0)
        force = end.particle_f.numpy()[0]
        return force / np.linalg.norm(force)

    sim.contact.place(sim.state, 0.01)
    free = direction(0.02)
    for look in range(1, FREE_LOOKS):
        kept = direction(1e-4 * look)
    assert np.abs(kept - free).max() > 0.005
    assert direction(0.02) == pytest.approx(kept, abs=1e-9)
    sim.contact.place(sim.state, 0.01)
    assert direction(0.02) == pytest.approx(free, abs=1e-9)
    assert direction(1e-4 * look) == pytest.approx(kept, abs=1e-9)


def still_force(sim: wc.Simulation, ends: np.ndarray) -> np.ndarray:
    """Of the obstacles on particles that go to these places in a step of 10 ms [N]."""
    end, start = sim.state.twin(), sim.state.particle_q.numpy()
    end.particle_q.assign(ends)
    end.particle_qd.assign((ends - start) / 0.01)
    end.particle_f.zero_()
    sim.contact.support.accumulate(end, 0.0)
    return end.particle_f.numpy().copy()


def supported(obstacle: wc.Box | wc.MeshObstacle | wc.Plane | wc.Sphere, height: float) -> wc.Simulation:
    cloth = wc.Cloth.grid((0.02, 0.02), (2, 2), FABRIC, transform=(0.2, 0.0, height))
    model = wc.Model.build([cloth], [obstacle], precision="float64")
    sim = wc.Simulation(model, "implicit_euler", contact="obstacles")
    sim.contact.place(sim.state, 0.01)
    return sim


@pytest.mark.parametrize("kind", ["turning", "deforming"])
def test_what_goes_along_with_an_obstacle_is_not_rubbed_within_the_step(kind):
    slab, turn = trimesh.creation.box((1.0, 1.0, 0.1)).apply_translation((0.0, 0.0, -0.05)), 0.03
    if kind == "turning":
        motion = wc.Motion.keyframes([(0.0, (0, 0, 0)), (0.01, (0, 0, 0), (0, 0, turn))])
        obstacle = wc.Box((0, 0, -0.05), (1.0, 1.0, 0.1), motion=motion, thickness=0.0, friction=MU)
    else:
        samples = np.stack([slab.vertices, slab.vertices + ALONG])
        options = {"sample_times": [0.0, 0.01], "sample_points": samples}
        obstacle = wc.MeshObstacle(slab.vertices, slab.faces, thickness=0.0, friction=MU, **options)
    sim = supported(obstacle, RADIUS)
    start = sim.state.particle_q.numpy().copy()
    turned = start @ trimesh.transformations.rotation_matrix(turn, (0, 0, 1))[:3, :3].T
    ends = turned if kind == "turning" else start + ALONG
    force = still_force(sim, ends - [0.0, 0.0, 0.1 * RADIUS])
    assert force[:, 2].min() > 0.0
    assert np.abs(force[:, :2]).max() < 1e-3 * force[:, 2].min()
    stays = still_force(sim, start - [0.0, 0.0, 0.1 * RADIUS])
    assert np.linalg.norm(stays[:, :2], axis=1) == pytest.approx(MU * stays[:, 2], rel=1e-3)


def test_a_plane_that_was_met_in_an_earlier_step_is_none_in_this_one():
    sim = supported(wc.Sphere((0.2, 0.0, 0.0), 0.5, thickness=0.0, friction=0.0), 0.502)
    start = sim.state.particle_q.numpy().copy()
    assert still_force(sim, start - [0.0, 0.0, 0.01])[:, 2].min() > 0.0
    sim.contact.place(sim.state, 0.01)
    for look in range(FREE_LOOKS + 3):  # past the sphere, and lower than its top
        assert not still_force(sim, start + np.array([1.0 + 0.01 * look, 0.0, -0.005])).any()


GROUND = trimesh.creation.box((1.0, 1.0, 0.1)).apply_translation((0.0, 0.0, -0.05))


@pytest.mark.parametrize("name", ["implicit_euler", "linear_implicit_euler", "implicit_midpoint", "bdf2"])
@pytest.mark.parametrize("kind", ["plane", "mesh"])
@pytest.mark.parametrize("substeps", [2, 20])
def test_what_begins_within_the_contact_distance_is_put_out_of_it_and_not_thrown(name, kind, substeps):
    """It flew several times its thickness high."""
    common = {"thickness": RADIUS, "friction": MU}
    floor = wc.Plane(**common) if kind == "plane" else wc.MeshObstacle.from_mesh(GROUND, **common)
    model = wc.Model.build([sheet((0.0, 0.0, 0.5 * RADIUS))], [floor], precision="float64")
    sim = wc.Simulation(model, name, gravity=(0.0, 0.0, 0.0), substeps=substeps, contact="obstacles")
    sim.step(1.0 / 60.0)
    assert sim.state.particle_q.numpy()[:, 2] == pytest.approx(2.0 * RADIUS, rel=0.05)
    assert np.linalg.norm(sim.state.particle_qd.numpy(), axis=1).max() < 0.01


def test_a_mesh_pushes_what_is_all_but_on_it_to_the_side_where_its_step_began():
    """Where the way to the nearest point has no direction, that of the triangle is taken, be it its back."""
    points, triangles = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.array([[0, 1, 2], [0, 2, 3]])
    for faces in (triangles, triangles[:, ::-1]):
        sim = supported(wc.MeshObstacle(points, faces, thickness=0.0, friction=0.0), -2.0 * RADIUS)
        force = still_force(sim, sim.state.particle_q.numpy() * np.array([1.0, 1.0, 1e-3]))
        assert force[:, 2].max() < 0.0
