"""Open meshes have two sides: cloth is kept on the one on which it is, whichever way their triangles go around."""

import numpy as np
import pytest
import trimesh

import warpcloth as wc
from warpcloth.meshes import TriangleMesh

CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
OFFSET = 0.002 + 0.001  # half the thickness of the cloth and that of the mesh [m]
STEP = 0.01  # [s]
WAYS = {  # heights at both ends of one step [m]
    "far through it": (0.02, -0.08),
    "just through it": (0.004, -0.0005),
    "onto it": (0.02, 1e-6),
    "just through it, from within its distance": (0.001, -0.0001),
    "into its distance": (0.004, 0.001),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("scheme", ["xpbd", "implicit_euler"])
def test_what_moves_to_a_mesh_is_stopped_on_the_side_on_which_it_was(way, side, turned, scheme):
    begin, end = (side * z for z in WAYS[way])
    triangles = TRIANGLES[:, ::-1] if turned else TRIANGLES
    sheet = wc.MeshObstacle(CORNERS, triangles, thickness=0.001)
    velocity = (0.0, 0.0, (end - begin) / STEP)
    fabric = wc.Fabric(thickness=0.004, stretch_stiffness=20.0, shear_stiffness=4.0)
    cloth = wc.Cloth.grid((0.05, 0.05), (2, 2), fabric, transform=(0.3, 0.1, begin), velocity=velocity)
    model = wc.Model.build([cloth], [sheet], precision="float64")
    sim = wc.Simulation(model, scheme, gravity=(0, 0, 0), substeps=1, contact="obstacles")
    sim.step(STEP)
    assert side * sim.state.particle_q.numpy()[:, 2] == pytest.approx(OFFSET, abs=1e-6)
    assert sim.state.particle_qd.numpy()[:, 2] == pytest.approx(0.0, abs=1e-3)


def answered(obstacle: wc.Box | wc.MeshObstacle, begin: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Where particles end that go their way [m] in one step, each a world of its own."""
    fabric = wc.Fabric(thickness=0.004, friction=0.0)
    worlds = []
    for x, d in zip(begin, way, strict=True):
        strip = TriangleMesh(x + 1e-5 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), [[0, 1, 2]])
        worlds.append(([wc.Cloth.from_mesh(strip, fabric, velocity=d / STEP)], [obstacle]))
    model = wc.Model.build_worlds(worlds, precision="float64")
    sim = wc.Simulation(model, "xpbd", gravity=(0, 0, 0), substeps=1, contact="obstacles")
    sim.step(STEP)
    return sim.state.particle_q.numpy()


def test_edges_and_corners_of_a_mesh_keep_the_same_distance_as_those_of_a_box():
    """Whatever comes near them is pushed straight away from them, and not from the plane of a face."""
    half = np.array([0.1, 0.15, 0.2])
    outward = np.array([[1, 0, 1], [-1, 1, 0], [0, -1, 1], [1, 1, 1], [-1, 1, -1], [1, 0, 0], [0.3, -1, -0.6]], float)
    on = half * np.sign(outward) * (1.0 - 0.4 * (outward == 0.0))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    begin, way = on + 1.05 * OFFSET * outward, -0.4 * OFFSET * outward
    block = trimesh.creation.box(2.0 * half)
    mesh = answered(wc.MeshObstacle(block.vertices, block.faces, thickness=0.001, friction=0.0), begin, way)
    box = answered(wc.Box((0, 0, 0), 2.0 * half, thickness=0.001, friction=0.0), begin, way)
    np.testing.assert_allclose(mesh, box, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(mesh[::3] - on, axis=1), OFFSET, atol=1e-6)
