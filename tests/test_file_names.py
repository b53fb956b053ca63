"""Names that a file system takes and USD does not: bytes that are no UTF-8 text; what a URL is made of; links."""

import json
import os
import sys

import pytest
from shot_files import small_shot
from usd_files import write_usd
from warpcloth.scenes import load_scene, scene_from_toml, simulate
from warpcloth.scenes.usd import check_cache

from warpcloth.cli import run
from warpcloth.errors import MeshError
from warpcloth.meshes import read_mesh

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="other systems take UTF-8 names only")
ODD = os.fsdecode(b"a\xff")
NAPKIN = '[[cloth]]\nshape = "grid"\nresolution = [4, 4]\n'
COMMANDS = [
    (["simulate", "napkin.toml", "-o", f"{ODD}.usdc"], "USD needs a path that is UTF-8 text."),
    (["simulate", "shot.usda", "-o", f"{ODD}.usda"], "USD needs a path that is UTF-8 text."),
    (["scenes", "export", "napkin.toml", "-o", f"{ODD}/napkin.usda"], "USD needs a path that is UTF-8 text."),
    (["simulate", f"{ODD}.toml"], "is not UTF-8 text, so it cannot name a scene."),
    (["simulate", f"{ODD}.usda"], "is not UTF-8 text, so it cannot name a scene."),
    (["check", f"{ODD}.usda"], "USD needs a path that is UTF-8 text."),
]


@pytest.mark.parametrize(
    ("arguments", "words"), COMMANDS, ids=lambda value: value[0] if isinstance(value, list) else ""
)
def test_a_name_that_is_not_text_is_one_sentence(tmp_path, monkeypatch, capfd, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / ODD).mkdir()
    for name in ("napkin.toml", f"{ODD}.toml"):
        (tmp_path / name).write_text(NAPKIN)
    (tmp_path / f"{ODD}.usda").write_bytes(small_shot(tmp_path / "shot.usda").read_bytes())
    before = sorted(tmp_path.rglob("*"))
    assert run([*arguments, "--json"]) == 2
    out, err = capfd.readouterr()
    assert err.count("\n") == 1
    assert words in err
    assert json.loads(out) == {"error": err.removeprefix("warpcloth: ").strip(), "exit_code": 2}
    assert sorted(tmp_path.rglob("*")) == before


def test_a_mesh_in_a_folder_whose_name_is_not_text_is_one_sentence(tmp_path, monkeypatch):
    (tmp_path / ODD).mkdir()
    write_usd(tmp_path / "sheet.usda")[0].Save()
    (tmp_path / "sheet.usda").rename(tmp_path / ODD / "sheet.usda")
    monkeypatch.chdir(tmp_path / ODD)
    with pytest.raises(MeshError, match="cannot be read: USD needs a path that is UTF-8 text"):
        read_mesh("sheet.usda")


@pytest.mark.parametrize("name", ["shot#1.usdc", "shot?v=2.usda", "a;b%20.usdz"])
def test_names_that_mean_something_in_a_url_are_sound(tmp_path, name):
    path = simulate(scene_from_toml(NAPKIN), tmp_path / name, frames=1, device="cpu").output
    assert check_cache(path).usd_errors == ()


def test_a_shot_finds_its_stage_through_a_link_to_its_folder_and_without(tmp_path):
    stage = small_shot(tmp_path / "shot.usda", frames=1)
    (tmp_path / "far" / "away").mkdir(parents=True)
    (tmp_path / "near").symlink_to(tmp_path / "far" / "away", target_is_directory=True)
    simulate(load_scene(stage), tmp_path / "near" / "out.usda", device="cpu")
    for folder in ("near", "far/away"):
        assert check_cache(tmp_path / folder / "out.usda").ok
