"""The benchmark of speed, small: what it measures is there, and is the same work for all."""

import io
import json

import numpy as np
import pytest
from rich.console import Console
from warpcloth.benchmarks.speed import (
    comparison,
    effort,
    explicit,
    measurements,
    network,
    race,
    run_parts,
    scaling,
    scenes,
    startup,
)
from warpcloth.benchmarks.speed.tables import tables
from warpcloth.benchmarks.speed.throughput import throughput

from warpcloth.cli import run
from warpcloth.errors import InputError, SimulationError


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("speed")
    small = ["--resolution", "8", "--frames", "2", "--integrators", "xpbd", "--quick"]
    arguments = ["bench", "speed", "--problems", "hang,drape,output,profile", *small, "-o", str(folder)]
    assert run(arguments) == 0
    return json.loads((folder / "results.json").read_text())


def test_every_part_is_there(results):
    assert results["benchmark"] == "speed"
    assert results["failures"] == []
    assert {"cores", "warp", "warpcloth", "load_per_core"} <= set(results["machine"])
    for part in ("hang", "drape"):
        (row,) = results["parts"][part]["rows"]
        assert (row["tool"], row["resolution"], row["frames"], row["repeats"]) == ("xpbd", 8, 2, 2)
        assert row["finite"]
        assert row["frame_ms"] > 0.0
        assert row["mean_ms"] > 0.0
        assert row["substeps"] > 0
        assert row["intersections"] == 0
        assert row["misses"] is None  # two frames do not tell
    assert results["parts"]["hang"]["rows"][0]["swing_m"] == pytest.approx(0.5, abs=0.01)
    (output,) = results["parts"]["output"]["rows"]
    assert output["bytes_per_frame"] > 64 * 2 * 12  # positions and velocities of 8² vertices
    assert 0.0 < output["share"] < 1.0


def test_stages_and_kernels_are_timed(results):
    profile = results["parts"]["profile"]
    stages = {row["what"]: row["frame_ms"] for row in profile["rows"]}
    assert {"frame", "detect", "integrate", "guard", "rest"} <= set(stages)
    assert all(value > 0.0 for value in stages.values())
    kernels = {row["kernel"]: row for row in profile["kernels"]}
    assert kernels["respond"]["calls"] >= 2.0
    assert [row["frame_ms"] for row in profile["kernels"]] == sorted(k["frame_ms"] for k in kernels.values())[::-1]


def test_an_earlier_run_is_compared_with(results, tmp_path, capfd):
    slower = json.loads(json.dumps(results))
    slower["parts"]["hang"]["rows"][0]["frame_ms"] *= 2.0
    ratios = {row["what"]: row["ratio"] for row in comparison(results, slower)}
    assert ratios.pop("hang xpbd 8 2 frame_ms") == pytest.approx(0.5)
    assert set(ratios.values()) == {1.0}
    other = json.loads(json.dumps(results).replace('"resolution": 8', '"resolution": 16'))
    assert comparison(results, other) == []  # what is not the same work is not compared
    (tmp_path / "other.json").write_text("[]")
    assert run(["bench", "speed", "--compare", str(tmp_path / "other.json"), "-o", str(tmp_path)]) == 2
    assert "is not the results.json of `bench speed`" in capfd.readouterr().err


@pytest.mark.parametrize(
    "text", ["[]", '{"benchmark": "speed"}', '{"benchmark": "speed", "parts": {"hang": {"rows": [{"frame_ms": "x"}]}}}']
)
def test_what_is_no_earlier_run_is_refused_before_anything_is_measured(text, tmp_path, capfd):
    path = tmp_path / "other.json"
    path.write_text(text)
    assert run(["bench", "speed", "--compare", str(path), "-o", str(tmp_path / "out")]) == 2
    assert "is not the results.json of `bench speed`" in capfd.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_explicit_steps_of_all_hands_agree():
    found = throughput(effort(resolution=8, quick=True), lambda text: None)
    assert found["failures"] == []
    rows = {row["hand"]: row for row in found["rows"]}
    assert {"warpcloth", "warp_benchmark", "numpy"} <= set(rows)
    for row in rows.values():
        assert row["springs"] == 2 * 7 * 8 + 2 * 7 * 7 + 2 * 6 * 8
        assert row["difference_m"] < row["tolerance_m"]
        assert row["springs_per_s"] == pytest.approx(row["springs"] * network.SUBSTEPS * 1e3 / row["frame_ms"])
    assert ("cpp" in rows) == ("no C++" not in found["compiler"])


def test_another_law_would_not_agree():
    """The tolerance is far below what a tenth of the damping, of the stiffness or of gravity does."""
    cloth = network.warp_cloth(8)
    tolerance = 2.0 * network.SUBSTEPS * np.spacing(np.float32(np.abs(cloth.positions).max()))
    truth = explicit.Numpy(cloth, np.float64).frame().copy()
    for name, factor in (("k_d", 0.9), ("k_s", 0.9), ("gravity", 0.9)):
        other = explicit.Numpy(cloth, np.float64)
        setattr(other, name, factor * getattr(other, name))
        assert np.abs(other.frame() - truth).max() > 5.0 * tolerance


def test_measures_of_the_scenes_are_those_of_known_cloth():
    sim = scenes.simulation(scenes.DRAPE, 8, "xpbd")
    points, pairs = sim.state.particle_q.numpy().astype(float), scenes.edges(8)
    assert len(pairs) == 2 * 7 * 8
    assert scenes.mean_strain(points, pairs) == pytest.approx(0.0, abs=1e-6)
    assert scenes.mean_strain(1.03 * points, pairs) == pytest.approx(0.03, abs=1e-6)
    assert scenes.penetration(points) == 0.0
    assert scenes.penetration(points - np.array([0.0, 0.0, 0.752])) == pytest.approx(0.002, abs=1e-6)
    lowest = np.array([[0.0, 0.0, 0.63]])
    assert scenes.penetration(lowest) == pytest.approx(0.02)
    good = {"mean_strain": 0.004, "worst_strain": 0.02, "intersections": 0, "penetration_m": 0.0, "swing_m": -0.47}
    assert scenes.misses(scenes.HANG, good) == scenes.misses(scenes.DRAPE, good) == []
    bad = {**good, "swing_m": -0.449, "mean_strain": float("nan"), "intersections": 1}
    assert scenes.misses(scenes.HANG, bad) == ["mean_strain", "swing_m"]
    assert scenes.misses(scenes.DRAPE, bad) == ["mean_strain", "intersections"]


def test_a_peer_that_fails_is_a_row_that_says_so(monkeypatch):
    class Broken:
        facts, triangles = {}, np.zeros((0, 3), np.int32)

        def __init__(self, problem, n, name):
            raise RuntimeError("no such device")

    from warpcloth.benchmarks.speed import newton_peers

    monkeypatch.setattr(newton_peers, "NewtonRun", Broken)
    found = race.race(scenes.HANG, effort(["hang"], ["newton_style3d"], 8, 2, quick=True), lambda text: None)
    (row,) = found["rows"]
    assert row["failed"] == "RuntimeError: no such device"
    assert found["failures"] == []


def test_cloth_of_ours_that_is_torn_fails_the_run(monkeypatch):
    monkeypatch.setattr(race, "TORN", -1.0)
    found = race.race(scenes.HANG, effort(["hang"], ["xpbd"], 4, 2, quick=True), lambda text: None)
    (failure,) = found["failures"]
    assert failure.startswith("hang, xpbd, 4²: The cloth is torn to a mean strain of ")


def test_exponents_are_those_of_a_power_law(monkeypatch):
    def child(module, arguments):
        n = arguments["n"]
        return {
            **arguments,
            "resolution": n,
            "particles": n * n,
            "substeps": n,
            "particle_step_ns": 2.0,
            "finite": True,
        }

    monkeypatch.setattr(scaling, "in_child", child)
    found = scaling.scaling(effort(quick=True), lambda text: None)
    assert [(row["problem"], row["resolution"]) for row in found["rows"]][:3] == [
        ("explicit", 16),
        ("explicit", 32),
        ("hang", 16),
    ]
    assert found["exponents"]["drape"] == {"frame": pytest.approx(1.5), "step": pytest.approx(1.0)}


@pytest.mark.parametrize("problem", ["explicit", "drape"])
def test_cost_of_a_particle_is_measured(problem):
    found = scaling.measure(problem, 9, 2)
    assert found["finite"]
    assert found["particle_step_ns"] == pytest.approx(1e6 * found["cpu_ms"] / (81 * found["substeps"]))


def test_a_part_that_fails_does_not_take_the_others_with_it(monkeypatch):
    def failing(module, arguments):
        raise SimulationError("no answer.")

    monkeypatch.setattr(scaling, "in_child", failing)
    chosen = effort(["scaling", "hang"], ["xpbd"], 4, 2, quick=True)
    heard = []
    found = run_parts(chosen, heard.append)
    assert found["failures"] == ["scaling: no answer."]
    assert found["parts"]["scaling"]["rows"] == []
    assert found["parts"]["hang"]["rows"][0]["finite"]
    Console(file=io.StringIO()).print(tables(found))


def test_progress_is_announced_in_advance():
    heard = []
    chosen = effort(["hang", "drape", "output", "profile"], ["xpbd"], 4, 2, quick=True)
    run_parts(chosen, heard.append)
    assert len(heard) == measurements(chosen)


def test_starts_are_whole_processes(monkeypatch):
    asked = []

    def seconds(command, environment):
        asked.append((command[2], environment))
        return float(len(asked)), '{"compile_s": 0.5}'

    monkeypatch.setattr(startup, "_seconds", seconds)
    rows = {row["what"]: row for row in startup.startup(effort(quick=True), lambda text: None)["rows"]}
    assert {name: row["repeats"] for name, row in rows.items()} == {
        "python": 2,
        "import": 2,
        "cold": 1,
        "warm": 2,
        "prepare": 2,
    }
    assert rows["cold"]["seconds"] == 5.0
    assert rows["warm"]["seconds"] == 6.5
    caches = {environment.get("WARP_CACHE_PATH") for _, environment in asked[4:]}
    assert len(caches) == 1
    assert None not in caches


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--problems", "hung"], "(did you mean 'hang'?)"),
        (["--integrators", "newton_style_3d"], "(did you mean 'newton_style3d'?)"),
        (["--resolution", "1"], "Resolution must be a whole number from 4 to 1,024, got 1."),
        (["--frames", "1"], "Frames must be a whole number from 2 to 10,000, got 1."),
        (["--budget", "3"], "--budget is an option of"),
        (["--compare", "nothing.json"], "The earlier results nothing.json cannot be read"),
    ],
)
def test_bad_options_are_said(arguments, sentence, tmp_path, capfd):
    assert run(["bench", "speed", *arguments, "-o", str(tmp_path)]) == 2
    assert sentence in capfd.readouterr().err


def test_slow_parts_are_measured_when_asked_for():
    assert set(effort().parts).isdisjoint({"scaling", "startup"})
    assert effort(["scaling"]).parts == ("scaling",)
    assert effort(resolution=8).sizes["drape"] == (4, 8)
    with pytest.raises(InputError, match="did you mean 'startup'"):
        effort(["startups"])
