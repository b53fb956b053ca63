"""Batches of scenes whose cloth comes from USD stages."""

from pathlib import Path

import numpy as np
import pytest
from batch_sweeps import contents, simulated
from warpcloth.scenes import export_scene, load_scene, simulate
from warpcloth.scenes.usd.playback import Playback

from warpcloth.batch import Sweep, load_sweep
from warpcloth.batch.prepared import prepare
from warpcloth.errors import SceneError


def exported(file: Path, scene: str = "hanging", *changes: str) -> Path:
    """A bundled scene as a stage, small."""
    file.parent.mkdir(exist_ok=True)
    return export_scene(load_scene(scene, ["frames=6", *changes]), file)


def sweep_of(folder: Path, scene: str, parameter: str) -> Sweep:
    (folder / "scene.toml").write_text(scene)
    head = 'scene = "scene.toml"\ndesign = "grid"\noutputs = ["pose", "frames"]\n'
    (folder / "sweep.toml").write_text(f"{head}[[parameter]]\n{parameter}\n")
    return load_sweep(folder / "sweep.toml")


STAGE = """
frames = 6
[simulation]
integrator = "symplectic_euler"
device = "cpu"
[stage]
path = "stage.usda"
[stage.fabric]
name = "cotton"
"""


def test_substeps_are_those_of_the_stage_s_own_cloth(tmp_path):
    exported(tmp_path / "stage.usda", "hanging", "cloth.0.resolution=[9, 9]")
    sweep = sweep_of(tmp_path, STAGE, 'path = "stage.fabric.stretch_stiffness"\nvalues = [100.0, 3e4]')
    soft, stiff = (prepare(sweep.sample(index)).scene.simulation.substeps for index in (0, 1))
    assert stiff > 10 * soft
    batches = [simulated(tmp_path / "sweep.toml", tmp_path / f"worlds{worlds}", worlds)[0] for worlds in (1, 2)]
    assert [batches[0].metrics(index)["status"] for index in (0, 1)] == ["done", "done"]
    assert contents(batches[0]) == contents(batches[1])
    again = simulate(load_scene(batches[0].place(1) / "scene.toml"), tmp_path / "again.usda").output
    cloths = [Playback(file) for file in (again, batches[0].place(1) / "cache.usdc")]
    points = [playback.points(playback.cloths[0], 6) for playback in cloths]
    assert points[0].std() > 0.1
    np.testing.assert_allclose(points[0], points[1], atol=1e-6)


def test_networks_of_stages_are_simulated_each_by_itself(tmp_path):
    for name, k_s in (("a", 200.0), ("b", 400.0)):
        exported(tmp_path / "stages" / f"{name}.usda", "pendulum", f"network.k_s={k_s}")
    scene = 'frames = 6\n[simulation]\ndevice = "cpu"\nsubsteps = 50\n[stage]\npath = "stages/a.usda"\n'
    sweep = sweep_of(tmp_path, scene, 'path = "stage.path"\nglob = "stages/*.usda"')
    first, second = (prepare(sweep.sample(index)) for index in (0, 1))
    assert len(first.built.network.points) == 3
    assert first.companions != second.companions


GLOB = 'path = "stage.path"\nglob = "stages/*.usda"'
TABLES = 'path = "stage"\nvalues = [{ path = "stages/a.usda" }, { path = "stages/b.usda", cloth = ["/World"] }]'


@pytest.mark.parametrize("parameter", [GLOB, TABLES])
@pytest.mark.parametrize("scene", ["scene.toml", "stages/a.usda"])
@pytest.mark.parametrize("own", ["", "fps = 10.0\n"])
def test_each_stage_has_its_own_clock_and_gravity(tmp_path, monkeypatch, scene, parameter, own):
    exported(tmp_path / "stages" / "a.usda")
    exported(tmp_path / "stages" / "b.usda", "hanging", "frames=9", "fps=50", "simulation.gravity=[0, 0, -1.6]")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    gravity = '[[parameter]]\npath = "simulation.gravity.0"\nvalues = [0.5]\n'
    sweep_of(tmp_path, f'{own}[stage]\npath = "stages/a.usda"\n', f"{parameter}\n{gravity}")
    sweep = load_sweep(tmp_path / "sweep.toml", [f"scene={scene}"])
    assert Sweep.from_json(sweep.as_json()) == sweep
    scenes = [sweep.sample(index).scene for index in (0, 1)]
    assert [one.stage.path for one in scenes] == [str(tmp_path / "stages" / f"{name}.usda") for name in "ab"]
    slower = bool(own) and scene == "scene.toml"  # as many frames as fill the stages' time
    assert [one.frames for one in scenes] == ([2, 2] if slower else [6, 9])
    assert [one.fps for one in scenes] == ([10.0, 10.0] if slower else [24.0, 50.0])
    assert [one.simulation.gravity for one in scenes] == [(0.5, 0.0, -9.81), (0.5, 0.0, -1.6)]


def test_lists_that_are_none_are_said(tmp_path):
    exported(tmp_path / "stage.usda")
    sweep = sweep_of(tmp_path, '[stage]\npath = "stage.usda"\n', 'path = "cloth"\nvalues = [5]')
    with pytest.raises(SceneError, match="sample 0: cloth must be a list, not 5"):
        sweep.check()
