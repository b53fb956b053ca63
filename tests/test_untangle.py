"""Cloth that starts intersecting is brought apart, or it is said that it was not."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpcloth as wc
from warpcloth.cli import run
from warpcloth.diagnostics import check_start_for, every_strain, penetration_depths
from warpcloth.errors import BadStartError
from warpcloth.intersections import Triangles, intersections
from warpcloth.meshes import TriangleMesh
from warpcloth.state import State
from warpcloth.untangle import contour_moves, untangle

SMALL = trimesh.creation.icosphere(3, 0.1)


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


@pytest.mark.parametrize("degrees", [15, 30, 60, 90])
@pytest.mark.parametrize("pins", [None, list(range(12))])
def test_sheets_that_cross_in_the_middle_come_apart(degrees, pins):
    """The line in which they meet is as long however they move a little; they are not strained for it, nor sent far."""
    below, above = sheets(np.radians(degrees))
    model = wc.Model.build([wc.Cloth.grid((0.4, 0.4), (12, 12), below.fabric, pins=pins, name="below"), above])
    state = State.of(model)
    done = untangle(model, state)
    assert (done.before > 40, done.after) == (True, 0)
    assert done.moved_m < 0.25
    assert np.abs(every_strain(model, state)[0]).max() < 0.04
    check_start_for("all", model, state)


THROUGH = [
    (wc.Box((0.0, 0.0, 0.0), (0.2, 0.2, 0.2)), 0.0, 0.105),
    (wc.Box((0.02, 0.01, 0.0), (0.2, 0.2, 0.2)), 0.4, 0.15),
    (wc.Sphere((0.0, 0.0, 0.0), 0.1), 0.0, 0.105),
    (wc.MeshObstacle(np.array(SMALL.vertices), np.array(SMALL.faces)), 0.0, 0.105),
]


@pytest.mark.parametrize(("solid", "tilt", "far"), THROUGH)
def test_a_sheet_through_the_middle_of_a_solid_leaves_it_undeformed(solid, tilt, far):
    """Particles that each leave by the way that is shortest for them would tear it to all sides."""
    sheet = wc.Cloth.grid((0.4, 0.4), (12, 12), wc.Fabric(thickness=0.002), transform=placed(0.0, 0.0, tilt))
    model = wc.Model.build([sheet], [solid])
    state = State.of(model)
    done = untangle(model, state)
    assert (done.inside_before > 10, done.inside_after, done.after) == (True, 0, 0)
    assert done.moved_m < far
    assert np.abs(every_strain(model, state)[0]).max() < 0.01
    check_start_for("all", model, state)


def test_a_world_ends_as_it_does_alone():
    """Bitwise, whatever is wrong in others; and as it was where nothing is."""
    small, sphere = wc.Box((0.02, 0.01, -0.05), (0.1, 0.1, 0.12)), wc.Sphere((0.0, 0.0, 0.0), 0.2)
    same = [placed(0.0, 0.0, 0.0), placed(0.0, 0.2, 0.0)]
    thick = wc.Fabric(thickness=0.004)
    kinds = [
        (sheets(0.08), []),
        (sheets(0.0), []),
        (sheets(1.0), []),
        (sheets(0.0)[:1], [small]),
        ([wc.Cloth.grid((0.3, 0.3), (9, 9), thick, transform=t, name=str(k)) for k, t in enumerate(same)], []),
        ([wc.Cloth.grid((0.4, 0.4), (12, 12), thick, transform=placed(0.19, 0.0, 0.0))], [sphere]),
    ]
    together = wc.Model.build_worlds(kinds)
    state = State.of(together)
    assert untangle(together, state).after == 0
    for world, kind in enumerate(kinds):
        alone = wc.Model.build_worlds([kind])
        own = State.of(alone)
        untangle(alone, own)
        moved = state.particle_q.numpy()[together.particle_world.numpy() == world]
        assert np.array_equal(moved, own.particle_q.numpy()), world
        assert np.array_equal(moved, alone.particle_q.numpy()) == (world == 1)


def test_what_cannot_be_untangled_ends_no_worse_than_it_was():
    """Sheets that are held along one border each, which contours draw further into each other."""
    fabric = wc.Fabric(thickness=0.002)
    below = wc.Cloth.grid((0.4, 0.4), (12, 12), fabric, pins=list(range(12)), name="below")
    place = placed(0.002, 0.0, np.pi / 6)
    above = wc.Cloth.grid((0.4, 0.4), (11, 11), fabric, transform=place, pins=list(range(11)), name="above")
    model = wc.Model.build([below, above])
    state = State.of(model)
    done = untangle(model, state)
    assert 0 < done.after == intersections(model, state).sum() <= done.before


@pytest.mark.filterwarnings("ignore::warpcloth.errors.FabricWarning")
@pytest.mark.parametrize("squeeze", [0.8, 0.3])
def test_a_dress_stays_around_who_wears_it(squeeze):
    turn = 2.0 * np.pi * np.arange(24) / 24
    rings = [np.stack([0.1 * np.cos(turn), 0.1 * squeeze * np.sin(turn), z + 0 * turn], 1) for z in np.arange(15) / 35]
    first, row = np.arange(24), 24 * np.arange(14)[:, None]
    a, b = row + first, row + (first + 1) % 24
    triangles = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, b + 24), (a, b + 24, a + 24))])
    dress = wc.Cloth.from_mesh(TriangleMesh(np.concatenate(rings), triangles))
    body = trimesh.creation.cylinder(0.09, 1.0, sections=32)
    model = wc.Model.build([dress], [wc.MeshObstacle(np.array(body.vertices), np.array(body.faces))])
    state = State.of(model)
    done = untangle(model, state)
    assert (done.before > 50, done.after) == (True, 0)
    middle = state.particle_q.numpy().reshape(15, 24, 3).mean(axis=1)
    assert np.linalg.norm(middle[:, :2], axis=1).max() < 0.02


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
    assert np.array_equal(state.particle_q.numpy()[apart], model.particle_q.numpy()[apart])
    assert (done.inside_before > 0, done.inside_after) == (True, 0)
    check_start_for("all", model, state)


def test_what_is_apart_is_left_alone():
    model = wc.Model.build(sheets(0.0))
    state = State.of(model)
    assert untangle(model, state).as_dict() == dict.fromkeys(
        ("before", "after", "inside_before", "inside_after", "rounds", "moved_m"), 0
    )
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
    with pytest.raises(BadStartError, match=r"as untangling left \d+ of \d+ pairs after 200 rounds"):
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


def test_a_network_has_nothing_to_untangle():
    model = wc.Model.from_springs([[0, 0, 1], [1, 0, 1]], 0.1, [[0, 1]], 1.0, 100.0, 0.0, pinned=[0])
    done = untangle(model, State.of(model))  # without a warning, too
    assert (done.before, done.inside_before, done.rounds) == (0, 0, 0)


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


def test_free_particles_leave_what_is_solid_to_their_thickness_above_it():
    """Pins stay, and so does what is in a box without a lid: nobody says how deep that is in it."""
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    lid = box.vertices[box.faces][:, :, 2].min(axis=1) > 0.0
    open_box = wc.MeshObstacle(np.array(box.vertices), np.array(box.faces)[~lid])
    cloth = wc.Cloth.grid((0.2, 0.2), (2, 2), wc.Fabric(thickness=0.01), pins=[0], transform=(0.0, 0.0, -0.1))
    ball = wc.MeshObstacle(np.array(BALL.vertices), np.array(BALL.faces))
    solids = [wc.Sphere((0.0, 0.0, 0.0), 0.2), ball, open_box]
    model = wc.Model.build_worlds([([cloth], [solid]) for solid in solids], device="cpu", precision="float64")
    model.shapes.place(model.tracks, State.of(model).world_time, 0.0)
    out = wp.zeros_like(model.particle_q)
    inputs = [model.particle_world, model.particle_inv_mass, model.particle_radius, model.shapes.shapes, 1e6]
    wp.launch(
        model.kernels.leaving.leave_solids, dim=12, inputs=[*inputs, model.particle_q, model.shapes.end],
        outputs=[out], device="cpu",
    )  # fmt: skip
    begun, moved = model.particle_q.numpy(), out.numpy()
    stay = [0, 4, *range(8, 12)]
    assert np.array_equal(moved[stay], begun[stay])
    assert np.linalg.norm(moved[[1, 2, 3]], axis=1) == pytest.approx(0.2 + 0.01)
    assert np.linalg.norm(moved[[5, 6, 7]], axis=1) == pytest.approx(0.2 + 0.01, abs=2e-3)  # facets are within the ball
    assert np.linalg.norm(np.cross(moved, begun), axis=1) == pytest.approx(0.0, abs=1e-3)  # by the shortest way


def test_ways_out_are_those_of_the_paper():
    """Along the edge as far as the contour's direction r, but back; and else r but for a part across the triangle."""
    model = wc.Model.build(sheets(0.6), precision="float64")
    triangles = Triangles(model)
    where, ways = triangles.crossings(State.of(model))
    x, corners = model.particle_q.numpy(), triangles.surface.tri_indices.numpy()
    assert len(where) > 10
    for (own, passed, *ends), way in zip(where, ways, strict=True):
        third = np.setdiff1d(corners[own], ends)[0]
        e = (x[ends[1]] - x[ends[0]]) / np.linalg.norm(x[ends[1]] - x[ends[0]])
        normal, own_normal = (np.cross(b - a, c - a) for a, b, c in (x[corners[passed]], x[corners[own]]))
        r = np.cross(own_normal, normal)
        inwards = np.cross(np.cross(e, x[third] - x[ends[0]]), e)
        r *= np.sign(r @ inwards) / np.linalg.norm(r)
        if abs(e @ normal) > 0.1 * np.linalg.norm(normal):
            assert e @ way == pytest.approx(-(e @ r), abs=1e-9)
        assert np.cross(way, normal) == pytest.approx(np.cross(r, normal), abs=1e-9)


@pytest.mark.parametrize("height", [0.002, -0.002])
def test_layers_are_parted_in_the_order_that_costs_less(height):
    """One rises over the other from 2 mm below it to 6 mm above it, or the other way round."""
    place = placed(height, 0.3, 0.02)
    above = wc.Cloth.grid((0.4, 0.4), (11, 11), wc.Fabric(thickness=0.002), transform=place, name="other")
    model = wc.Model.build([sheets(0.0)[0], above])
    state = State.of(model)
    done = untangle(model, state)
    assert (done.before > 20, done.after) == (True, 0)
    below, other = state.particle_q.numpy()[:144, 2].mean(), state.particle_q.numpy()[144:, 2].mean()
    assert (other - below) * np.sign(height) > 0.002
    assert done.moved_m < 0.003
