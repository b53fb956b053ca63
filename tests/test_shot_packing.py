"""Stages simulated into packages: what is to be packed must be there, which is known before the first frame."""

import zipfile

import pytest
from pxr import Sdf, Usd, UsdShade, UsdUtils
from shot_files import add_cloth, new_stage, pin_points
from warpcloth.scenes import load_scene, simulate

from warpcloth.cli import run


def textured(path, *textures):
    """A shot whose material has these pictures."""
    stage = new_stage(path, frames=1)
    pin_points(add_cloth(stage), [0, 4])
    for number, texture in enumerate(textures):
        shader = UsdShade.Shader.Define(stage, f"/World/Look/texture{number}")
        shader.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(texture)
    stage.Save()
    return path


def with_variants(folder, *textures):
    """A shot with a variant, not chosen, that is in a layer of its own."""
    path = textured(folder / "shot.usda", *textures)
    other = new_stage(folder / "other.usda")
    other.Save()
    stage = Usd.Stage.Open(str(path))
    variants = stage.DefinePrim("/World/Chair").GetVariantSets().AddVariantSet("size")
    for name in ("small", "large"):
        variants.AddVariant(name)
    variants.SetVariantSelection("large")
    with variants.GetVariantEditContext():
        stage.GetPrimAtPath("/World/Chair").GetReferences().AddReference("./other.usda")
    variants.SetVariantSelection("small")
    stage.Save()
    return path


MISSING = [
    (["./no.png"], "{}/no.png, and there is no such file; put it there, or write .usda or .usdc instead."),
    (["./no.png", "./at.png"], "{}/at.png and 1 more file, and there are no such files; put them there, or write .us"),
    (["./a.png", "./here.png", "./b.<UDIM>.png", "c.mdl"], "{}/a.png and 2 more files, and there are no such files;"),
    (["./folder"], "{}/folder, and there is no such file; put it there"),
    (["./gone.usdz[a.png]"], "{}/gone.usdz[a.png], and there is no such file; put it there"),
]


@pytest.mark.parametrize(("textures", "words"), MISSING, ids=lambda value: value[0] if isinstance(value, list) else "")
def test_missing_textures_are_known_before_the_first_frame(tmp_path, monkeypatch, capfd, textures, words):
    monkeypatch.setattr(UsdUtils, "CreateNewUsdzPackage", lambda *_: pytest.fail("the shot is simulated already"))
    (tmp_path / "here.png").write_bytes(b"picture")
    (tmp_path / "folder").mkdir()
    path = textured(tmp_path / "shot.usda", *textures)
    before = sorted(tmp_path.iterdir())
    capfd.readouterr()
    assert run(["simulate", str(path), "-o", str(tmp_path / "k.usdz"), "--device", "cpu"]) == 2
    out, err = capfd.readouterr()
    sentence = f"Cannot write k.usdz: shot.usda refers to {words.format(tmp_path)}"
    assert sentence.replace(" ", "") in "".join(err.split())  # lines are broken anywhere
    assert out == ""
    assert sorted(tmp_path.iterdir()) == before


def test_a_layer_that_is_damaged_is_known_before_the_first_frame(tmp_path, monkeypatch, capfd):
    """OpenUSD packs variants that are not chosen, too."""
    monkeypatch.setattr(UsdUtils, "CreateNewUsdzPackage", lambda *_: pytest.fail("the shot is simulated already"))
    path = with_variants(tmp_path)
    (tmp_path / "other.usda").write_text("no layer")
    assert run(["simulate", str(path), "-o", str(tmp_path / "k.usdz"), "--device", "cpu"]) == 2
    assert "Cannotwritek.usdz:<" in "".join(capfd.readouterr().err.split())


def test_only_packages_need_textures(tmp_path):
    path = textured(tmp_path / "shot.usda", "./no.png")
    for name in ("k.usda", "k.usdc"):
        assert simulate(load_scene(path), tmp_path / name, device="cpu").frames == 1


def test_textures_are_packed(tmp_path):
    """And what OpenUSD packs without: a layer of a variant that is not chosen."""
    (tmp_path / "u").mkdir()
    for name in ("here.png", "u/t.1001.png"):
        (tmp_path / name).write_bytes(b"picture")
    path = with_variants(tmp_path, "./here.png", "./u/t.<UDIM>.png", "")
    (tmp_path / "other.usda").unlink()
    simulate(load_scene(path), tmp_path / "k.usdz", device="cpu")
    names = {name.rsplit("/", 1)[-1] for name in zipfile.ZipFile(tmp_path / "k.usdz").namelist()}
    assert names == {"k.usda", "k.cache.usdc", "shot.usda", "here.png", "t.1001.png"}
