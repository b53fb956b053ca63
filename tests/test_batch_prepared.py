"""What decides which samples share a model, when each ends, and what is looked at before and after."""

import math
from types import SimpleNamespace

import pytest
from batch_sweeps import simulated, written
from pxr import Sdf
from warpcloth.scenes.load import parse_toml, scene_from_data

from warpcloth.batch import load_sweep, recorder
from warpcloth.batch.folder import BatchFolder
from warpcloth.batch.group import Group
from warpcloth.batch.job import fail
from warpcloth.batch.manifest import _of_one_type
from warpcloth.batch.plan import make_plan
from warpcloth.batch.prepared import Prepared, contact_intervals, prepare
from warpcloth.batch.run import run_batch
from warpcloth.batch.sweep import Sample
from warpcloth.errors import InputError

SCENE = """
frames = 12
fps = 30.0
[simulation]
integrator = "xpbd"
device = "cpu"
contact = "{contact}"
gravity = [0.0, 0.0, {gravity}]
substeps = {substeps}
[[cloth]]
shape = "grid"
size = [0.16, 0.16]
resolution = [{n}, {n}]
position = [0.0, 0.0, 0.5]
fabric = {{ {fabric} }}
{pins}
[[obstacle]]
name = "ball"
shape = "sphere"
center = [0.0, 0.0, 0.1]
radius = 0.1
{motion}
[air]
density = {air}
"""
MOVES = "motion.keys = [{ time = 0.0 }, { time = 0.3, position = [0.0, 0.0, 0.01] }]"
SWEEP = 'scene = "scene.toml"\ncount = 2\nseed = 1\n{more}\n[[parameter]]\npath = "{path}"\nvalues = {values}\n'


def text(**changes) -> str:
    values = {"contact": "all", "gravity": 0.0, "substeps": 4, "n": 5, "fabric": "thickness = 2e-3", "pins": ""}
    return SCENE.format(**values | {"motion": "", "air": 0.0} | changes)


def prepared(**changes) -> Prepared:
    return prepare(Sample(0, {}, scene_from_data(parse_toml(text(**changes)))))


@pytest.mark.parametrize(
    "changes",
    [
        {"fabric": "thickness = 2e-3, strain_limit = 0.1, limit_stiffness = 1e3"},
        {"fabric": "thickness = 2e-3, damping_time = 0.0"},
        {"air": 1.2},
        {"substeps": 5},
        {"contact": "obstacles"},
        {"motion": MOVES.replace("0.01", "9.0")},  # fast enough for more detections in a frame
    ],
    ids=str,
)
def test_samples_that_differ_in_what_a_model_shares_are_no_companions(changes):
    assert prepared().companions == prepared(gravity=-9.81, fabric="thickness = 3e-3").companions
    assert prepared(**changes).companions != prepared().companions


def test_automatic_substeps_are_enough_for_contact():
    fast = prepared(substeps='"auto"', n=9, motion=MOVES.replace("0.01", "30.0"))
    slow = prepared(substeps='"auto"', n=9)
    needed = contact_intervals(fast.built)
    assert slow.scene.simulation.substeps < needed <= fast.scene.simulation.substeps


@pytest.mark.parametrize("contact", ["none", "all"])
def test_automatic_substeps_are_enough_for_strong_gravity(contact):
    earth, strong = (prepared(substeps='"auto"', n=9, contact=contact, gravity=g) for g in (-9.81, -981.0))
    assert strong.scene.simulation.substeps > 8 * earth.scene.simulation.substeps


def test_the_last_motion_is_that_of_pins_and_obstacles():
    pins = "[[cloth.pins]]\nindices = [0]\nmotion.keys = [{ time = 0.0 }, { time = 0.7, position = [0.0, 0.0, 0.1] }]"
    assert prepared().last_motion == 0.0
    assert prepared(motion=MOVES).last_motion == 0.3
    assert prepared(motion=MOVES, pins=pins).last_motion == 0.7
    assert prepared(motion=f"{MOVES}\nmotion.loop = true").last_motion == math.inf


@pytest.mark.parametrize(
    ("air", "goes_on"),
    [
        ("1.2", False),
        ("1.2\nwind = [0, 0.3, 0]", False),
        ("1.2\nwind = [0, 0.3, 0]\ngust = 1.0", True),
        ("1.2\nturbulence = 0.1", True),
    ],
)
def test_a_wind_that_changes_is_never_over(air, goes_on):
    """Cloth that hangs still in a lull has not come to its end."""
    assert (prepared(air=air).last_motion == math.inf) == goes_on


def test_a_sample_does_not_rest_before_the_last_motion_and_its_pose_says_how_it_was_made(tmp_path, monkeypatch):
    """The others go on without those that have ended."""
    sizes = []
    start = Group._start
    monkeypatch.setattr(Group, "_start", lambda self, members: sizes.append(len(members)) or start(self, members))
    late = "[{ time = 0.0 }, { time = 0.6, position = [0.0, 0.0, 0.01] }]"
    values = f"[{{ keys = {late} }}, {{ keys = [{{ time = 0.0 }}] }}]"
    sweep = SWEEP.format(more="", path="obstacle.0.motion", values=values).replace("count = 2", "count = 4")
    folder, _ = simulated(
        written(tmp_path, sweep, text().replace("frames = 12", "frames = 30")), tmp_path / "batch", worlds=4
    )
    facts = [folder.metrics(index) for index in range(4)]
    frames = {len(f["parameters"]["obstacle.0.motion"]["keys"]): f["metrics"]["frames"] for f in facts}
    assert frames[1] < frames[2] == 18
    assert sizes[0] == 4 > sizes[-1]
    layer = Sdf.Layer.FindOrOpen(str(folder.place(0) / "pose.usdc"))
    assert layer.customLayerData["warpcloth"]["substeps"] == 4


def test_what_is_not_sound_fails_if_the_sweep_wants_it_checked(tmp_path, monkeypatch):
    report = SimpleNamespace(ok=False, usd_errors=["Nothing is right."])
    monkeypatch.setattr(recorder, "check_cache", lambda path: report)
    for check, status in (("true", "failed"), ("false", "done")):
        sweep = SWEEP.format(more=f"check = {check}", path="cloth.0.position.2", values="[0.5]")
        folder, _ = simulated(written(tmp_path, sweep, text()), tmp_path / check, worlds=2)
        assert [folder.metrics(index)["status"] for index in (0, 1)] == [status] * 2
    reason = BatchFolder(tmp_path / "true").metrics(0)["reason"]
    assert reason == "What was written as pose.usdc is not sound: Nothing is right."


def test_room_and_failed_samples_are_in_the_plan(tmp_path, monkeypatch):
    sweep = load_sweep(written(tmp_path, SWEEP.format(more="", path="seed", values="[1, 2]"), text()))
    folder = BatchFolder(tmp_path / "batch")
    folder.claim(sweep)
    fail(folder, sweep.sample(0), "Bad luck.")
    assert make_plan(sweep, folder, None, None).left == 1
    assert make_plan(sweep, folder, None, None, retry_failed=True).left == 2
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=2**20))
    with pytest.raises(InputError, match="has 1 MiB free, and the samples need about"):
        run_batch(sweep, folder.path, workers=1)
    assert folder.finished() == [0]


def test_numbers_of_either_kind_stay_numbers_in_the_manifest():
    for column in ([1, 2.5, None], [1, 2], [True, None], ["a", None]):
        assert _of_one_type(column) == column
    assert _of_one_type([1, "a", None]) == ["1", "a", None]
    assert _of_one_type([True, 1.5]) == ["True", "1.5"]


def test_a_plan_knows_that_samples_differ_in_size(tmp_path):
    """What begins with coarse cloth is not planned as if all of it were coarse."""
    more = 'design = "grid"\noutputs = ["frames"]'
    values = "[[6, 6], [11, 11], [6, 6], [101, 101]]"
    table = SWEEP.format(more=more, path="cloth.0.resolution", values=values)
    sweep = load_sweep(written(tmp_path, table, text()), ["count=4"])
    plan = make_plan(sweep, BatchFolder(tmp_path / "batch"), None, None)
    assert (plan.particles, plan.worlds) == (10_201, 1)
    assert plan.bytes > 36 * plan.frames * (36 + 121 + 36 + 10_201)  # points, velocities and normals


def test_a_plan_knows_all_samples_frames(tmp_path):
    """Of four, of which the first are short: the most there are, and what is written for all of them."""
    plans = []
    for values in ("[2, 2, 2, 90]", "[24]"):
        more = 'design = "grid"\noutputs = ["frames"]'
        sweep = load_sweep(
            written(tmp_path, SWEEP.format(more=more, path="frames", values=values), text()), ["count=4"]
        )
        plans.append(make_plan(sweep, BatchFolder(tmp_path / "batch"), None, None))
    assert [plan.frames for plan in plans] == [90, 24]
    assert plans[0].bytes == plans[1].bytes
