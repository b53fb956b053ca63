"""Cloth that starts intersecting is brought apart, or it is said that it was not."""

import numpy as np
import pytest
import trimesh

import warpcloth as wc
from warpcloth.cli import run
from warpcloth.diagnostics import check_start_for, penetration_depths
from warpcloth.errors import BadStartError
from warpcloth.intersections import Triangles, intersections
from warpcloth.meshes import TriangleMesh
from warpcloth.state import State
from warpcloth.untangle import contour_moves, untangle


def placed(z: float, turn: float, tilt: float) -> np.ndarray:
    c, s, u, v = np.cos(turn), np.sin(turn), np.cos(tilt), np.sin(tilt)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, u, -v], [0, v, u]])
    matrix[2, 3] = z
    return matrix


def sheets(tilt: float, **properties: float) -> list[wc.Cloth]:
    fabric = wc.Fabric(thickness=0.002, **properties)
    above = wc.Cloth.grid((0.4, 0.4), (11, 11), fabric, transform=placed(0.002, 0.3, tilt), name="above")
    return [wc.Cloth.grid((0.4, 0.4), (12, 12), fabric, name="below"), above]


@pytest.mark.parametrize("rigidity", [0.0, 1e-4])
def test_sheets_that_cross_come_apart_and_keep_their_shape(rigidity):
    """Sheets that bend stiffly, too, though untangling knows no bending."""
    model = wc.Model.build(sheets(0.08, bending_rigidity=rigidity))
    state = State.of(model)
    done = untangle(model, state)
    assert done.before > 20
    assert done.after == intersections(model, state).sum() == 0
    assert 0.001 < done.moved_m < 0.05
    sim = wc.Simulation(model, integrator="xpbd", contact="all", untangled=True, gravity=(0, 0, 0), substeps=10)
    assert sim.untangled == done
    assert sim.metrics()["mean_strain"] < 0.02
    sim.run(5)
    assert sim.metrics()["intersections"] == 0
    assert np.array_equal(sim.model.particle_q.numpy(), model.particle_q.numpy())


@pytest.mark.parametrize("angle", [0.0, 0.05, 0.7])
@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("pins", [None, "all"])
def test_layers_in_the_same_place_are_parted_by_their_thickness(angle, back, pins):
    """Whichever way their fronts face; where one is held, the other goes all the way. Springs are not strained."""
    place = placed(0.0, angle, np.pi if back else 0.0)
    held = None if pins is None else list(range(169))
    below = wc.Cloth.grid((0.3, 0.3), (13, 13), pins=held, name="below")
    model = wc.Model.build([below, wc.Cloth.grid((0.3, 0.3), (9, 9), transform=place, name="above")])
    state, thickness = State.of(model), 2.0 * float(model.particle_radius.numpy().min())
    done = untangle(model, state)
    assert done.before > 100
    assert done.after == intersections(model, state).sum() == 0
    assert 0.4 * thickness < done.moved_m < 1.1 * thickness
    moved = np.abs(state.particle_q.numpy() - model.particle_q.numpy())
    assert moved[:, :2].max() < 1e-6
    assert held is None or moved[held].max() == 0.0


def test_three_layers_in_the_same_place_get_an_order():
    layers = [wc.Cloth.grid((0.3, 0.3), (n, n), transform=placed(0.0, 0.1 * n, 0.0), name=f"n{n}") for n in (8, 9, 11)]
    model = wc.Model.build(layers)
    done = untangle(model, State.of(model))
    assert (done.before > 100, done.after) == (True, 0)
    assert done.moved_m < 0.005


def test_cloth_leaves_a_box_that_pokes_through_it():
    model = wc.Model.build(sheets(0.0)[0], wc.Box((0.02, 0.01, -0.05), (0.1, 0.1, 0.12)))
    done = untangle(model, State.of(model))
    assert done.before > 0
    assert done.after == 0


BALL = trimesh.creation.icosphere(3, 0.2)
SOLIDS = [
    wc.Sphere((0.0, 0.0, 0.0), 0.2),
    wc.Capsule((-0.1, 0.0, 0.0), (0.1, 0.0, 0.0), 0.2),
    wc.MeshObstacle(np.array(BALL.vertices), np.array(BALL.faces)),
    wc.Plane((0.0, 0.0, 0.2)),
]


@pytest.mark.parametrize("solid", SOLIDS, ids=lambda solid: solid.name)
@pytest.mark.parametrize("depth", [0.005, 0.05])
def test_cloth_leaves_solids_that_it_starts_in(solid, depth):
    """Whether or not its triangles pass through triangles of theirs; as clothes start that are cut close to a body."""
    fabric = wc.Fabric(thickness=0.002)
    cloths = [wc.Cloth.grid((0.4, 0.4), (21, 21), fabric, transform=placed(z, 0.3, 0.0)) for z in (0.2 - depth, 0.4)]
    model = wc.Model.build_worlds([([cloth], [solid]) for cloth in cloths], device="cpu")
    state = State.of(model)
    assert penetration_depths(model, state).max() == pytest.approx(depth, rel=0.02)
    done = untangle(model, state)
    assert done.after == 0
    assert done.moved_m < depth + 0.02
    assert penetration_depths(model, state).max() == 0.0
    apart = slice(441, None)  # in another world, where nothing is wrong
    np.testing.assert_allclose(state.particle_q.numpy()[apart], model.particle_q.numpy()[apart], atol=1e-6)
    check_start_for("all", model, state)


def test_what_is_apart_is_left_alone():
    model = wc.Model.build(sheets(0.0))
    state = State.of(model)
    assert untangle(model, state).as_dict() == {"before": 0, "after": 0, "rounds": 0, "moved_m": 0.0}
    assert np.array_equal(state.particle_q.numpy(), model.particle_q.numpy())


def test_pins_stay_and_failure_is_said():
    """Two sheets that are held at all their vertices."""
    held = [
        wc.Cloth.grid((0.4, 0.4), (4, 4), pins=list(range(16)), transform=placed(0.0, 0.3, tilt), name=name)
        for name, tilt in (("a", 0.0), ("b", 0.5))
    ]
    model = wc.Model.build(held)
    state = State.of(model)
    done = untangle(model, state, rounds=3)
    assert (done.after, done.moved_m) == (done.before, 0.0)
    with pytest.raises(BadStartError, match=r"as untangling left \d+ of \d+ pairs after 1000 rounds"):
        wc.Simulation(model, contact="all", untangled=True)


SCENE = """
frames = 2
[simulation]
integrator = "xpbd"
contact = "all"
[[cloth]]
name = "below"
shape = "grid"
size = [0.4, 0.4]
resolution = [9, 9]
[[cloth]]
name = "above"
shape = "grid"
size = [0.4, 0.4]
resolution = [8, 8]
position = [0, 0, 0.002]
rotation = [5, 0, 20]
"""


def test_the_command_line_refuses_and_untangles(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "crossed.toml").write_text(SCENE)
    assert run(["simulate", "crossed.toml"]) == 3
    assert "starts intersecting" in capfd.readouterr().err
    assert not (tmp_path / "crossed.usdc").exists()
    assert run(["simulate", "crossed.toml", "--untangle"]) == 0
    assert "start untangled" in capfd.readouterr().out


@pytest.mark.parametrize("angle", [0.05, 0.6])
def test_ways_out_do_not_depend_on_which_side_is_the_front(angle):
    """Nor on which way around edges go, also where they nearly graze what they pass through."""
    turn = np.array([[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])
    flat = wc.Cloth.grid((0.2, 0.2), (6, 6))
    tilted = (flat.points + np.array([0.011, 0.007, 0.0])) @ turn.T
    moves = []
    for flips in ((False, False), (True, False), (False, True)):
        cloths = []
        for name, placed, flipped in zip("ab", (flat.points, tilted), flips, strict=True):
            mesh = TriangleMesh(placed, flat.triangles, name=name)
            cloths.append(wc.Cloth.from_mesh(mesh.flipped() if flipped else mesh))
        model = wc.Model.build(cloths, precision="float64")
        moves.append(contour_moves(Triangles(model), State.of(model)))
    assert np.count_nonzero(np.linalg.norm(moves[0], axis=1) > 0.5) > 10
    for other in moves[1:]:
        np.testing.assert_allclose(other, moves[0], atol=1e-9)
