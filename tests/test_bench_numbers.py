"""What benchmarks make of their measurements: with clocks that are set by hand, and rows that are written by hand."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from warpcloth.benchmarks import worlds
from warpcloth.benchmarks.contact import suite, watch
from warpcloth.benchmarks.contact.watch import DEEPEST, Outcome
from warpcloth.benchmarks.speed import race, scenes
from warpcloth.scenes import scene_from_toml

GRID = '[[cloth]]\nshape = "grid"\nresolution = [5, 5]\nposition = [0, 0, 1]\n'


class Clock:
    """A clock that only steps move on; processor time goes by twice as fast."""

    def __init__(self, steps):
        self.now, self.steps = 0.0, iter(steps)

    def step(self, _actions=None):
        self.now += next(self.steps)

    def perf_counter(self):
        return self.now

    def process_time(self):
        return 2.0 * self.now


def on_device(shape):
    """What has a ``numpy()``, as arrays on devices have."""
    return SimpleNamespace(numpy=lambda: np.zeros(shape))


def test_throughput_is_by_the_median_step_without_those_that_compile(monkeypatch):
    clock = Clock([9.0, 9.0, 1.0, 2.0, 1.0, 1.0, 10.0])
    env = SimpleNamespace(
        worlds=4, action_shape=(4, 1, 3), step=clock.step, times=on_device(4), positions=on_device((4, 3)),
        simulation=SimpleNamespace(model=SimpleNamespace(particle_count=100), substeps=5),
    )  # fmt: skip
    monkeypatch.setattr(worlds, "time", clock)
    monkeypatch.setattr(worlds, "towel_env", lambda case: env)
    row = worlds.measure(worlds.Case("xpbd", 4, 5), seconds=0.0)
    assert (row["steps"], row["compile_s"]) == (worlds.FEWEST_STEPS, 18.0)
    assert (row["step_ms"], row["cpu_ms"]) == (1000.0, 2000.0)
    assert (row["world_steps_per_s"], row["particle_steps_per_s"]) == (4.0, 500.0)


def test_frames_that_warm_up_are_no_part_of_a_median():
    assert race._middle([(9.0, 9.0), (9.0, 9.0), (1.0, 2.0), (3.0, 2.0), (2.0, 8.0), (6.0, 1.0)]) == (2.5, 2.0, 3.0)
    assert race._middle([(4.0, 2.0), (2.0, 2.0)]) == (3.0, 2.0, 3.0)  # there are no others


@pytest.mark.parametrize(("name", "runs"), [("newton_style3d", 1), ("xpbd", 3)])
def test_a_peer_is_not_run_for_ever(name, runs, monkeypatch):
    """One that has had its time is not timed again; ours always are. Medians are over runs."""
    clock, made = Clock([100.0, 1.0] * 9), []

    def make(problem, n):
        made.append(n)
        return SimpleNamespace(frame=clock.step, processor_time=clock.process_time)

    monkeypatch.setattr(race, "time", clock)
    monkeypatch.setattr(race, "maker", lambda name: make)
    lane = race.Lane(scenes.HANG, name, 4, 2)
    lane._spent = 0.9 * race.PEER_PATIENCE
    for _ in range(3):
        lane.time()
    assert len(made) == lane.row["repeats"] == runs
    assert lane.row["frame_ms"] == pytest.approx(50_500.0)


def contact_row(**values):
    row = {
        "arguments": "--seed 0", "finished": True, "failures": [], "intersections": 0, "obstacle_intersections": 0,
        "penetration_m": 0.0, "stopped": False, "torn": False, "locked": False, "pinched": 0, "frames": 7,
    }  # fmt: skip
    return {**row, **values}


def test_scenes_are_counted_by_what_happened_in_them():
    rows = [
        contact_row(),
        contact_row(locked=True, pinched=3),
        contact_row(finished=False),
        contact_row(finished=False, stopped=True, failures=["frame 3: diverged"]),
        contact_row(obstacle_intersections=2, failures=["frame 1: 2 pairs of triangles meet"]),
        contact_row(penetration_m=2.0 * DEEPEST, torn=True, failures=["frame 7: mean strain of 120%"]),
    ]
    assert suite.summarise(rows) == {
        "scenes": 6, "clean": 2, "crossing": 1, "penetrating": 1, "stopped": 1, "torn": 1, "unfinished": 1,
        "locked": 1, "pinched": 1, "frames": 42,
    }  # fmt: skip


def test_what_ran_out_of_time_is_no_finished_row(tmp_path):
    rows = [contact_row(), contact_row(arguments="--seed 1", finished=False)]
    path = tmp_path / "results.json"
    path.write_text(json.dumps({"rows": rows}))
    assert [row["arguments"] for row in suite.kept_rows(path)] == ["--seed 0"]


def test_scenes_are_watched_with_all_contact_and_options_of_their_own_scheme_only(tmp_path):
    path = tmp_path / "scene.toml"
    head = '[simulation]\nintegrator = "xpbd"\nintegrator_options = { iterations = 3 }\ncontact = "none"\n'
    path.write_text(head + GRID)
    own, other = (suite.given_cases([str(path)], schemes)[0] for schemes in (None, ["symplectic_euler"]))
    assert (own.scene.simulation.contact, other.scene.simulation.contact) == ("all", "all")
    assert own.scene.simulation.integrator_options == {"iterations": 3}
    assert (other.scene.simulation.integrator, other.scene.simulation.integrator_options) == ("symplectic_euler", {})


def test_cloth_that_ends_torn_is_a_failure(monkeypatch):
    monkeypatch.setattr(sys.modules[Outcome.__module__], "STRETCHED", -1.0)
    found = watch(scene_from_toml("frames = 1\n" + GRID))
    assert found.torn
    assert found.failures == ["frame 1: mean strain of 0%"]
