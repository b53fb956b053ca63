"""What a scene is read from is not replaced by what comes out of it."""

import pytest
from pxr import Usd, UsdUtils
from shot_files import add_ball, add_cloth, new_stage
from usd_files import write_usd
from warpcloth.scenes import load_scene
from warpcloth.scenes.built import BuiltScene

from warpcloth.cli import run
from warpcloth.errors import UsdError

BODY = """
[[cloth]]
shape = "grid"
resolution = [4, 4]
position = [0.0, 0.0, 0.5]

[[obstacle]]
shape = "mesh"
path = "{}"
"""
SHIRT = """
[[cloth]]
shape = "mesh"
path = "{}"
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A mesh in a file, a stage that refers to it, and a package of both."""
    stage, _ = write_usd(tmp_path / "body.usda")
    stage.SetDefaultPrim(stage.GetPrimAtPath("/world"))
    stage.Save()
    shot = Usd.Stage.CreateNew(str(tmp_path / "set.usda"))
    shot.DefinePrim("/world").GetReferences().AddReference("./body.usda")
    shot.Save()
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "set.usda"), str(tmp_path / "pack.usdz"))
    shot = Usd.Stage.CreateNew(str(tmp_path / "packed.usda"))
    shot.DefinePrim("/world").GetReferences().AddReference("./pack.usdz", "/world")
    shot.Save()
    monkeypatch.chdir(tmp_path)
    return tmp_path


CASES = [
    ("body.usda", "body.usda"),
    ("set.usda", "body.usda"),
    ("packed.usda", "pack.usdz"),
    ("pack.usdz", "pack.usdz"),
]


@pytest.mark.parametrize("command", ["simulate", "scenes export"])
@pytest.mark.parametrize("scene", [BODY, SHIRT], ids=["obstacle", "cloth"])
@pytest.mark.parametrize(("path", "output"), CASES)
def test_a_mesh_file_is_no_output(folder, capfd, command, scene, path, output):
    (folder / "scene.toml").write_text(scene.format(path))
    before = {file: file.read_bytes() for file in folder.iterdir()}
    options = ["--device", "cpu", "--frames", "1"] if command == "simulate" else []
    assert run([*command.split(), "scene.toml", "-o", output, *options]) == 2
    sentence = f"warpcloth: Cannot write {output}: the scene scene consists of it; give another name with -o.\n"
    assert capfd.readouterr().err == sentence
    assert {file: file.read_bytes() for file in folder.iterdir()} == before


def test_a_recording_spares_the_stage(folder):
    """A viewer writes a cache by itself even of a stage."""
    stage = new_stage(folder / "shot.usda")
    add_cloth(stage)
    add_ball(stage)
    stage.Save()
    built = BuiltScene.of(load_scene("shot.usda"))
    with pytest.raises(UsdError, match=r"Cannot write shot\.usda: the scene shot consists of it"):
        built.writer(folder / "shot.usda")


def test_other_files_are_replaced(folder):
    (folder / "scene.toml").write_text(BODY.format("body.usda"))
    assert run(["scenes", "export", "scene.toml", "-o", "set.usda"]) == 0
