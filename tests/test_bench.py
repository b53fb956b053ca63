"""The benchmark of integrators, on a selection that takes seconds."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from warpcloth.benchmarks.integrators import PROBLEMS, QUICK, run_suite, select, select_scene
from warpcloth.benchmarks.integrators.energy_drift import drift
from warpcloth.benchmarks.integrators.families import FAMILIES, family
from warpcloth.benchmarks.integrators.reference import Reference, reference
from warpcloth.benchmarks.integrators.runs import measure, split
from warpcloth.benchmarks.integrators.scene import scene_problem
from warpcloth.benchmarks.integrators.stability_limit import limit
from warpcloth.benchmarks.integrators.tables import tables
from warpcloth.benchmarks.integrators.work_precision import observed_order, sweep
from warpcloth.scenes import load_scene
from warpcloth.scenes.built import BuiltScene, make_model, make_simulation

import warpcloth as wc
from warpcloth.cli import run

SCHEMES = ("symplectic_euler", "rk4", "xpbd")


@pytest.fixture(scope="module")
def results():
    effort = replace(QUICK, sweep=0.05, drift=0.2, drift_share=0.02, iterations=0.2, halvings=4)
    return run_suite(select(SCHEMES, ["oscillator", "hanging_chain"], effort))


def test_every_measurement_is_there(results):
    assert set(results["schemes"]) == set(SCHEMES)
    assert set(results["problems"]) == {"oscillator", "hanging_chain"}
    for found in results["problems"].values():
        for name in SCHEMES:
            runs = found["schemes"][name]["runs"]
            assert [b["steps"] / a["steps"] for a, b in pairwise(runs)] == [2.0] * (len(runs) - 1)
            assert all(row["wall_s"] > 0.0 and row["evaluations"] >= row["steps"] for row in runs)
            assert min(row["position_error"] for row in runs) < 0.5
    assert set(results["drift"]) == {"oscillator"}
    assert all(set(rows) == set(SCHEMES) for rows in results["stability"].values())


def test_progress_is_announced_in_advance():
    from warpcloth.benchmarks.integrators import measurements

    heard = []
    selection = select(["symplectic_euler"], ["oscillator"], replace(QUICK, sweep=0.01, drift_share=0.01))
    run_suite(selection, heard.append)
    assert len(heard) == measurements(selection)


@pytest.mark.parametrize(("scheme", "order"), [("symplectic_euler", 1), ("rk4", 4)])
def test_errors_fall_at_the_order_of_the_scheme(scheme, order):
    problem = PROBLEMS["oscillator"]()
    truth = Reference(problem.exact(), 0.0, "closed form")
    runs = sweep(problem, scheme, truth, 0.5, 7)
    assert observed_order(runs, truth) == pytest.approx(order, abs=0.1)
    assert runs[-1].work == runs[-1].steps * order  # both evaluate forces as often as their order says


def test_closed_form_of_the_oscillator_is_the_known_answer():
    x, v = PROBLEMS["oscillator"]().exact()
    assert -x[1, 2] == pytest.approx(0.260767102762, abs=1e-12)
    assert -v[1, 2] == pytest.approx(0.485737506, abs=1e-9)


def test_reference_of_the_pendulum_is_the_known_answer():
    truth = reference(PROBLEMS["elastic_pendulum"](), 100.0)  # more than it takes on a busy machine
    (x, _, z), (vx, _, vz) = truth.solution[0][1], truth.solution[1][1]
    assert truth.uncertainty < 1e-8
    assert [x, z, vx, vz] == pytest.approx([0.760241003, -0.664284176, 2.326803297, 2.726887498], abs=2e-8)


def test_runs_that_diverge_are_recorded_as_such():
    problem = PROBLEMS["hanging_chain"]()
    truth = (problem.build(True).particle_q.numpy() + 1.0, np.ones((21, 3)))
    found = measure(problem, "symplectic_euler", 120, truth)
    assert found.diverged
    assert math.isinf(found.position_error)
    assert found.evaluations == 120


@pytest.mark.parametrize("steps", [1, 15, 16, 60, 1920, 997])
def test_frames_make_up_all_steps(steps):
    frames, substeps = split(steps)
    assert frames * substeps == steps


@pytest.mark.parametrize("system", ["spring", "sheet"])
def test_bisection_finds_the_limit_of_theory(system):
    found = limit(system, "symplectic_euler")
    assert found.ratio == pytest.approx(1.0, abs=0.02)


def test_bisection_finds_no_limit_where_there_is_none():
    found = limit("spring", "xpbd")
    assert math.isinf(found.measured)
    assert found.ratio is None


def test_energy_of_a_symplectic_scheme_stays_and_of_a_dissipative_one_falls():
    problem = PROBLEMS["elastic_pendulum"]()
    kept = drift(problem, "symplectic_euler", 5.0, 12.0)
    lost = drift(problem, "xpbd", 5.0, 12.0)
    assert kept.complete
    assert lost.complete
    assert kept.largest < 0.02
    assert abs(kept.trend) < 0.2 * kept.largest
    assert lost.trend < -0.2


def test_every_scheme_has_a_family_and_a_look():
    from warpcloth.benchmarks.integrators.style import looks

    known = wc.integrators()
    styles = looks(known)
    assert set(styles) == set(known)
    assert all(family(info) in FAMILIES for info in known.values())
    assert len({(style["color"], style["marker"]) for style in styles.values()}) == len(known)


def test_command_writes_results_and_plots(tmp_path, capfd):
    arguments = ["--integrators", "symplectic_euler,xpbd", "--problems", "oscillator", "--quick", "--budget", "0.02"]
    assert run(["bench", "integrators", *arguments, "--output", str(tmp_path), "--json"]) == 0
    printed = json.loads(capfd.readouterr().out)
    written = json.loads((tmp_path / "results.json").read_text())
    assert printed["problems"] == written["problems"]
    assert {"processor", "cores", "warp", "numpy"} <= set(written["machine"])
    names = {path.name for path in tmp_path.iterdir()}
    assert {"work_precision_oscillator.png", "energy_oscillator.png", "stability.png"} <= names
    assert all((tmp_path / name).stat().st_size > 10_000 for name in names if name.endswith(".png"))


def test_a_scene_can_be_measured():
    results = run_suite(select_scene("pendulum", ["symplectic_euler"], replace(QUICK, sweep=0.02), frames=2))
    found = results["problems"]["pendulum"]
    assert found["end"] == pytest.approx(2 / 24)
    assert found["schemes"]["symplectic_euler"]["runs"][-1]["position_error"] < 0.1


CLOTH = """frames = 2
[air]
wind = [0.0, 8.0, 0.0]
[[cloth]]
shape = "disc"
radius = 0.1
resolution = 3
springs = "woven"
fabric = { name = "silk", stretch_stiffness = 50.0, shear_stiffness = 5.0 }
pins = [{ box = { lower = [-1.0, -1.0, -1.0], upper = [-0.05, 1.0, 1.0] } }]
"""


def test_a_scene_is_measured_as_it_is(tmp_path):
    """In its wind, each timed run from the start, friction in bending included; and what has no springs has strain."""
    path = tmp_path / "cloth.toml"
    path.write_text(CLOTH)
    problem = scene_problem(str(path))
    sim = problem.simulation("xpbd", 8)
    sim.run(2, fps=24)
    ends = sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()
    same = load_scene(
        str(path), ["simulation.precision=float64", "simulation.integrator=xpbd", "simulation.substeps=8"]
    )
    built = [BuiltScene.of(same)]
    original = make_simulation(built, make_model(built))
    original.run(2, fps=24)
    np.testing.assert_array_equal(ends[0], original.state.particle_q.numpy())
    found = measure(problem, "xpbd", 16, ends)
    assert found.repeats == 3
    assert found.position_error < 1e-12
    assert 0.0 < found.strain < 0.1


def test_a_stage_can_be_measured(tmp_path):
    stage = str(tmp_path / "twist.usda")
    assert run(["scenes", "export", "twist", "-o", stage]) == 0
    (stage_problem, problem) = (scene_problem(name, 1) for name in (stage, "twist"))
    assert stage_problem.build(True).particle_count == problem.build(True).particle_count


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["integrator"], ("integrator", "'integrators'")),
        (["integrators", "--integrators", "symplectic_eular"], ("symplectic_eular", "'symplectic_euler'")),
        (["integrators", "--problems", "osculator"], ("osculator", "'oscillator'")),
        (["integrators", "--scene", "pendulun"], ("pendulun", "pendulum")),
        (["integrators", "--frames", "3"], ("--frames", "--scene")),
        (["integrators", "--scene", "pendulum", "--problems", "oscillator"], ("--problems", "--scene")),
        (["integrators", "--scene", "pendulum", "--frames", "many"], ("Frames", "many")),
        (["integrators", "--budget", "-1"], ("Budget", "-1")),
    ],
)
def test_bad_input_is_one_sentence(arguments, words, capfd):
    assert run(["bench", *arguments, "--no-plots"]) == 2
    message = capfd.readouterr().err
    assert message.count("\n") == 1
    assert all(word in message for word in words)


def test_the_budget_holds_where_stable_steps_are_next_to_nothing(tmp_path, monkeypatch, capfd):
    """Stiff bending on a fine mesh asks explicit schemes for millions of steps: references change over to `bdf2`, and
    schemes that would take too long have no run; where even that takes too long, there is one sentence."""
    path = tmp_path / "stiff.toml"
    cloth = 'shape = "grid"\nsize = [0.1, 0.1]\nresolution = [17, 17]\npins = [{ edge = "left" }]\n'
    path.write_text(f"frames = 4\n[[cloth]]\n{cloth}fabric = {{ bending_rigidity = 1e-3 }}\n")
    for module, least in (("reference", 2.0), ("work_precision", 0.0)):
        monkeypatch.setattr(f"warpcloth.benchmarks.integrators.{module}.LEAST_TIME", least)
    selection = select_scene(str(path), ["symplectic_euler", "xpbd"], replace(QUICK, sweep=0.3))
    results = run_suite(selection)
    found = results["problems"][selection.problems[0].name]
    assert found["reference"]["method"].startswith("bdf2")
    assert found["reference"]["uncertainty"] < 0.2
    assert found["schemes"]["symplectic_euler"]["runs"] == []
    assert found["schemes"]["xpbd"]["runs"]
    assert tables(results)
    monkeypatch.setattr("warpcloth.benchmarks.integrators.reference.LEAST_TIME", 0.0)
    arguments = ["--scene", str(path), "--quick", "--budget", "1e-6", "--no-plots"]
    monkeypatch.setattr("warpcloth.benchmarks.integrators.QUICK", replace(QUICK, reference=1e-6))
    assert run(["bench", "integrators", *arguments, "--output", str(tmp_path)]) == 2
    assert "give a larger --budget" in capfd.readouterr().err
