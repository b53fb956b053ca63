"""The peer in a process of its own, with a stand-in for Blender: what it is told and answers, and what fails."""

import gc
import importlib.util
import sys

import numpy as np
import pytest
from warpcloth.benchmarks.speed import race, scenes
from warpcloth.benchmarks.speed.blender_peer import BlenderRun, installed, scene
from warpcloth.benchmarks.speed.effort import effort
from warpcloth.benchmarks.speed.tools import usual

from warpcloth.cloth.springs import triangle_areas
from warpcloth.errors import InputError, MissingExtraError

PAPER = """
from types import SimpleNamespace
from unittest.mock import MagicMock
import numpy as np

app, ops, data = SimpleNamespace(version_string="0.1 of paper"), MagicMock(), MagicMock()
sheet = []

class Vertices:
    def __len__(self):
        return len(sheet)

    def foreach_get(self, name, out):
        out[:] = np.ravel(sheet)

class Scene(MagicMock):
    frame_current = 0

    def frame_set(self, frame):
        print("a word that is no answer")
        if frame == 4:
            raise RuntimeError("paper tears")
        frames_of_a_60th = 60.0 * 0.001**0.5 * cloth.modifiers.new.return_value.settings.time_scale
        for point in sheet:
            point[2] -= 0.25 * frames_of_a_60th if self.frame_current else 0.0
        self.frame_current = frame

data.meshes.new.return_value.from_pydata = lambda points, edges, faces: sheet.extend(points)
cloth = data.objects.new.return_value
cloth.evaluated_get.return_value.data.vertices = Vertices()
context = SimpleNamespace(scene=Scene(), object=MagicMock(), evaluated_depsgraph_get=MagicMock())
"""


@pytest.fixture
def paper(tmp_path, monkeypatch):
    (tmp_path / "bpy.py").write_text(PAPER)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("BLENDER_PYTHON", sys.executable)


@pytest.mark.parametrize("problem", scenes.PROBLEMS.values(), ids=scenes.PROBLEMS)
def test_frames_and_positions_are_those_of_the_other_process(paper, problem):
    run = BlenderRun(problem, 5)
    assert run.facts == {"substeps": 5, "version": "0.1 of paper"}
    cloth = scenes.things(problem, 5)[0]
    expected = np.float32(cloth.points)
    assert np.allclose(run.points(), expected, atol=1e-6)
    _, uses = np.unique(np.sort(run.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)), axis=0, return_counts=True)
    assert (np.sum(uses == 1), np.sum(uses == 2)) == (4 * 4, len(uses) - 4 * 4)  # one sheet, with its border
    assert triangle_areas(expected, run.triangles) == pytest.approx(0.5 / 4**2)
    run.frame()
    assert run.processor_time() > 0.0
    assert np.allclose(run.points(), expected - np.float32([0.0, 0.0, 0.25]), atol=1e-6)
    process = run._process
    del run
    gc.collect()
    assert process.returncode == 0


def test_what_goes_wrong_there_is_a_row_that_says_so(paper):
    found = race.race(scenes.HANG, effort(["hang"], ["blender"], 4, 3, quick=True), lambda text: None)
    (row,) = found["rows"]
    assert row["failed"] == "Blender's process ended: RuntimeError: paper tears"
    assert found["failures"] == []


def test_it_runs_where_it_is_installed(paper, monkeypatch):
    assert all("blender" in usual(problem) for problem in scenes.PROBLEMS.values())
    monkeypatch.setenv("BLENDER_PYTHON", "no/such/python")
    with pytest.raises(InputError, match=r"^BLENDER_PYTHON is 'no/such/python', which cannot be run: No such file"):
        BlenderRun(scenes.HANG, 4)
    monkeypatch.delenv("BLENDER_PYTHON")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert not installed()
    assert not any("blender" in usual(problem) for problem in scenes.PROBLEMS.values())
    with pytest.raises(MissingExtraError, match=r"pip install \"warpcloth\[blender\]\""):
        BlenderRun(scenes.HANG, 4)


def test_finer_cloth_has_steps_and_distances_in_proportion():
    coarse, fine = (scene(scenes.DRAPE, n) for n in (64, 128))
    assert fine["substeps"] == 2 * coarse["substeps"]
    assert fine["self_distance"] == coarse["self_distance"] / 2
    assert fine["self_distance"] < 1.0 / 127  # less than an edge, or neighbours push each other apart
    assert scene(scenes.HANG, 4)["pinned"] == [0, 4, 8, 12]
    assert coarse["pinned"] == []
