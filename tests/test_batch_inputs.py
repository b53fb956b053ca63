"""Meshes and stages that change between two runs of a batch."""

import shutil
import warnings

import pytest
import trimesh
from batch_sweeps import written
from pxr import Sdf
from test_batch_stages import exported
from warpcloth.scenes import load_scene

from warpcloth.batch import load_sweep
from warpcloth.batch.folder import BatchFolder
from warpcloth.batch.inputs import hash_of, input_hashes
from warpcloth.batch.run import index_batch, run_batch, status_of
from warpcloth.cli import run as cli
from warpcloth.errors import MixedBatchWarning

SCENE = """
frames = 2
[simulation]
integrator = "xpbd"
device = "cpu"
[[cloth]]
shape = "grid"
size = [0.16, 0.16]
resolution = [6, 6]
position = [0.0, 0.0, 0.2]
[[obstacle]]
name = "ball"
shape = "mesh"
path = "ball.obj"
"""
SWEEP = 'scene = "scene.toml"\ncount = 3\n[[parameter]]\npath = "cloth.0.position.2"\nuniform = [0.205, 0.3]\n'


def ball(folder, radius):
    trimesh.creation.icosphere(1, radius).export(folder / "ball.obj")


def test_a_mesh_that_changed_between_two_runs_is_said(tmp_path, capfd):
    """At the next run, and whenever somebody asks, until the samples that are of its earlier state are gone."""
    ball(tmp_path, 0.1)
    sweep = load_sweep(written(tmp_path, SWEEP, SCENE))
    folder = BatchFolder(tmp_path / "batch")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert run_batch(sweep, folder.path, workers=1).changed == {}
        shutil.rmtree(folder.place(1))
        run_batch(sweep, folder.path, workers=1)
        shutil.rmtree(folder.place(1))
        ball(tmp_path, 0.08)
        assert status_of(folder).changed == {str(tmp_path / "ball.obj"): 2}
    with pytest.warns(MixedBatchWarning, match=r"ball\.obj has changed since samples in .* were made, and those"):
        status = run_batch(sweep, folder.path, workers=1)
    assert (status.done, status.changed) == (3, {str(tmp_path / "ball.obj"): 2})
    assert cli(["batch", "status", str(folder.path)]) == 0
    assert "ball.obj has changed since 2 of the samples were made of it" in capfd.readouterr().out
    for index in (0, 2):
        shutil.rmtree(folder.place(index))
    assert status_of(folder).changed == {}
    (tmp_path / "ball.obj").unlink()  # without it nothing can be made that differs
    assert status_of(folder).changed == {}


def test_all_layers_of_a_stage_count(tmp_path):
    file = exported(tmp_path / "stages" / "shot.usda")
    shutil.move(file, tmp_path / "stages" / "below.usda")
    layer = Sdf.Layer.CreateNew(str(file))
    layer.TransferContent(Sdf.Layer.FindOrOpen(str(tmp_path / "stages" / "below.usda")))
    for prim in list(layer.rootPrims):
        del layer.rootPrims[prim.name]
    layer.subLayerPaths.append("./below.usda")
    layer.Save()
    hashes = input_hashes(load_scene(str(file)))
    assert sorted(hashes) == [str(file.with_name("below.usda")), str(file)]
    for path, digest in hashes.items():
        assert hash_of(path) == digest
        with open(path, "a") as stream:
            stream.write("\n")
        assert hash_of(path) not in ("", digest)


def test_what_showed_samples_that_are_gone_goes_with_the_last(tmp_path):
    ball(tmp_path, 0.1)
    sweep = load_sweep(written(tmp_path, SWEEP, SCENE))
    folder = BatchFolder(tmp_path / "batch")
    run_batch(sweep, folder.path, workers=1)
    index_batch(folder)
    shown = [folder.path / "assembly.usda", folder.path / "contact_sheet.png"]
    assert all(file.exists() for file in shown)
    for index in range(3):
        shutil.rmtree(folder.place(index))
    assert [file.name for file in index_batch(folder)] == ["manifest.csv", "manifest.parquet"]
    assert not any(file.exists() for file in shown)
