"""Random scenes for contact, and the watcher that checks them."""

import json

import numpy as np
import pytest
from warpcloth.benchmarks.contact import given_cases, random_cases, random_scene, run_cases, watch
from warpcloth.benchmarks.contact.watch import Outcome, look
from warpcloth.scenes import load_scene, scene_from_toml
from warpcloth.scenes.built import BuiltScene

import warpcloth as wc
from warpcloth.cli import run

GRID = '[[cloth]]\nshape = "grid"\nresolution = [5, 5]\nposition = [0, 0, 1]\n'


def test_a_seed_is_a_scene():
    first, again, other = random_scene(11), random_scene(11), random_scene(12)
    assert first.model_dump() == again.model_dump()
    assert first.model_dump() != other.model_dump()


def test_all_arrangements_shapes_speeds_and_schemes_are_drawn():
    scenes = [random_scene(seed) for seed in range(150)]
    assert {scene.title.rpartition(" ")[2] for scene in scenes} == {"dropped", "thrown", "curtains", "hammock", "wrung"}
    assert {table.shape for scene in scenes for table in scene.obstacle} == {
        "plane",
        "sphere",
        "capsule",
        "box",
        "mesh",
    }
    assert {table.shape for scene in scenes for table in scene.cloth} == {"grid", "disc"}
    speeds = [np.linalg.norm(table.velocity) for scene in scenes for table in scene.cloth]
    assert max(speeds) > 8.0
    assert {scene.simulation.integrator for scene in scenes} == {
        name for name, info in wc.integrators().items() if not info.adaptive
    }
    assert any(table.motion is not None for scene in scenes for table in scene.obstacle)


def test_nothing_is_faster_than_ten_metres_a_second():
    """At its fastest, by finite differences of the motion itself."""
    fastest = []
    for seed in range(60):
        for obstacle in BuiltScene.of(random_scene(seed)).obstacles:
            if obstacle.motion is not None:
                times = np.linspace(obstacle.motion.times[0], obstacle.motion.times[-1], 401)
                places = np.array([obstacle.motion.pose(t)[0] for t in times])
                fastest.append(np.linalg.norm(np.diff(places, axis=0), axis=1).max() / (times[1] - times[0]))
    assert 9.0 < max(fastest) < 10.02  # times have four digits


@pytest.mark.parametrize("seed", range(20))
def test_random_scenes_are_clean(seed):
    """Each with its own integrator."""
    found = watch(random_cases(seed, 1, resolution=12)[0].scene)
    assert found.finished
    assert found.failures == []


@pytest.mark.parametrize(
    ("seed", "resolution", "frames"),
    [
        pytest.param(69, 12, 3, id="a spinning ball whose cells are almost as large as itself"),
        pytest.param(209, None, 8, id="a box that tore its curtain when it might move by half an edge in an interval"),
        pytest.param(104, None, 1, id="sheets thrown at 6 m/s, without damping, in steps of several cells"),
    ],
)
def test_fast_things_neither_get_through_nor_tear(seed, resolution, frames):
    found = watch(random_cases(seed, 1, frames=frames, resolution=resolution)[0].scene)
    assert found.finished
    assert found.failures == []
    assert found.pinched == 0


def watched(text: str, move: np.ndarray) -> Outcome:
    """What is seen of a scene whose first particles have been put elsewhere."""
    cloths, obstacles = scene_from_toml(text).build()
    simulation = wc.Simulation(wc.Model.build(cloths, obstacles), "xpbd", contact="all")
    points = simulation.state.particle_q.numpy()
    points[: len(move)] += move
    simulation.state.particle_q.assign(points)
    out = Outcome(wanted=1)
    look(simulation, 1, out)
    return out


def test_cloth_in_cloth_is_seen():
    found = watched(GRID + GRID.replace("1]", "1.1]"), np.array([[0.3, 0.3, 0.2]]))
    assert found.intersections > 0
    assert found.obstacle_intersections == 0
    assert "pairs of triangles meet" in found.failures[0]


def test_an_edge_of_a_box_through_cloth_is_seen():
    box = '[[obstacle]]\nshape = "box"\ncenter = [0, 0, 0.9]\nsize = [0.05, 0.05, 0.05]\n'
    lowered = np.tile([0.0, 0.0, -0.1], (25, 1)) + np.array([0.03, 0.03, 0.0])
    assert watched(GRID + box, lowered).obstacle_intersections > 0


def test_a_particle_in_an_obstacle_is_seen():
    ball = '[[obstacle]]\nshape = "sphere"\ncenter = [0, 0, 0.6]\nradius = 0.3\n'
    found = watched(GRID + ball, np.tile([0.0, 0.0, -0.105], (25, 1)))
    assert found.penetration_m == pytest.approx(0.005, abs=1e-6)
    assert found.failures == ["frame 1: a particle is 5 mm deep in an obstacle"]


def test_a_start_that_is_refused_is_a_failure_and_not_an_end():
    box = '[[obstacle]]\nshape = "sphere"\ncenter = [0, 0, 1]\nradius = 0.1\n'
    found = watch(scene_from_toml("frames = 2\n" + GRID + box))
    assert found.stopped
    assert len(found.failures) == 1


def test_rows_that_are_kept_are_not_run_again():
    cases = random_cases(3, 2, ["xpbd"], frames=1, resolution=5)
    last = run_cases(cases[1:])["rows"]
    heard = []
    results = run_cases(cases, kept=last, progress=lambda *found: heard.append(found))
    assert results["rows"][1] is last[0]
    assert [row["scene"] for _, row in heard] == ["random_3", "random_4"]
    assert [len(found["rows"]) for found, _ in heard] == [2, 2]  # what was kept is never missing
    assert results["summary"]["scenes"] == results["summary"]["clean"] == 2


def test_rows_of_other_scenes_stay():
    first, second = random_cases(3, 2, ["xpbd"], frames=1, resolution=5)
    kept = run_cases([second])["rows"]
    heard = []
    results = run_cases([first], kept=kept, progress=lambda *found: heard.append(found))
    assert [row["arguments"] for row in results["rows"]] == [second.arguments, first.arguments]
    assert heard[0][0]["rows"] == results["rows"]


@pytest.mark.parametrize("name", ["drape_sphere", "funnel", "twist"])
def test_resolution_is_that_of_a_square_with_as_many_vertices(name):
    scene = load_scene(name)
    (case,) = given_cases([name], resolution=32)
    count = sum(len(cloth.points) for cloth in case.scene.build()[0])
    assert count == pytest.approx(32**2 * len(scene.cloth), rel=0.05)
    assert case.arguments == f"--scene {name} --resolution 32"


def test_command_reports_and_resumes(tmp_path, capfd):
    arguments = ["bench", "contact", "--seed", "3", "--count", "1", "--frames", "1", "--resolution", "5", "--json"]
    assert run([*arguments, "-o", str(tmp_path)]) == 0
    printed = json.loads(capfd.readouterr().out)
    assert printed["rows"][0]["arguments"] == "--seed 3 --count 1 --resolution 5 --frames 1"
    assert printed["summary"]["clean"] == 1
    assert run([*arguments, "-o", str(tmp_path), "--resume"]) == 0
    assert json.loads(capfd.readouterr().out)["rows"] == printed["rows"]


def test_failure_is_loud_and_says_how_to_see_it_again(tmp_path, capfd):
    path = tmp_path / "bad.toml"
    path.write_text("frames = 1\n" + GRID + '[[obstacle]]\nshape = "sphere"\ncenter = [0, 0, 1]\nradius = 0.1\n')
    assert run(["bench", "contact", "--scene", str(path), "-o", str(tmp_path)]) == 3
    assert "warpcloth bench contact --scene" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["contact", "--seed", "-1"], ("Seed", "-1")),
        (["contact", "--count", "0"], ("Count", "0")),
        (["contact", "--scene", "twits"], ("twits", "twist")),
        (["contact", "--scene", "twist", "--seed", "3"], ("--seed", "--scene")),
        (["contact", "--scene", "twist", "--resolution", "2"], ("Resolution", "2")),
        (["contact", "--scene", "pendulum", "--resolution", "20"], ("network", "pendulum")),
        (["contact", "--integrators", "xbpd"], ("xbpd", "'xpbd'")),
        (["contact", "--problems", "oscillator"], ("--problems", "integrators")),
        (["integrators", "--count", "3"], ("--count", "contact")),
    ],
)
def test_bad_input_is_one_sentence(arguments, words, capfd, tmp_path):
    assert run(["bench", *arguments, "-o", str(tmp_path)]) == 2
    message = capfd.readouterr().err
    assert message.count("\n") == 1
    assert all(word in message for word in words)
