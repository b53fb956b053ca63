"""The files in which caches grow: each writer has its own, and none is left behind."""

import os

import pytest
from pxr import Sdf, Usd
from shot_files import add_cloth, new_stage
from usd_shots import FPS, LAST, partial_of, two_cloths, write_frames, write_shot
from warpcloth.scenes import export_scene, load_scene
from warpcloth.scenes.shots.layers import ShotWriter
from warpcloth.scenes.shots.shot import read_shot
from warpcloth.scenes.usd import CacheWriter, growing, paths

from warpcloth.errors import UsdError


def names(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def last_frame(path) -> float:
    """The last frame of a cache, after a check that its samples can be read."""
    stage = Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(path)))
    points = stage.GetPrimAtPath("/World/Cloth/red_flag").GetAttribute("points")
    assert len(points.GetTimeSamples()) == stage.GetEndTimeCode() + 1
    assert all(len(points.Get(code)) == 35 for code in points.GetTimeSamples())
    return stage.GetEndTimeCode()


@pytest.mark.parametrize("endings", [("usdc", "usdc"), ("usdc", "usda"), ("usda", "usdz")])
def test_writers_of_one_name_do_not_meet(tmp_path, endings):
    """The second begins and ends while the first is at work, and both are whole."""
    first, second = (tmp_path / f"shot.{ending}" for ending in endings)
    cloths = two_cloths()
    with CacheWriter(first, cloths, fps=FPS) as writer:
        write_frames(writer, cloths, range(2))
        write_shot(second, [], last=LAST)
        assert last_frame(second) == LAST
        write_frames(writer, cloths, range(2, 5))
    assert last_frame(first) == 4
    assert second == first or last_frame(second) == LAST
    assert names(tmp_path) == sorted({first.name, second.name})


def test_files_of_the_user_are_left_alone(tmp_path):
    (tmp_path / "shot.partial.usdc").write_bytes(b"my own")
    write_shot(tmp_path / "shot.usdc", [], last=1)
    assert (tmp_path / "shot.partial.usdc").read_bytes() == b"my own"


@pytest.mark.parametrize("ending", ["usdc", "usda", "usdz"])
def test_an_interrupt_in_the_last_step_leaves_nothing(tmp_path, monkeypatch, ending):
    cloths = two_cloths()

    def interrupted(target):
        assert target.converted.exists()
        raise KeyboardInterrupt

    monkeypatch.setattr(growing, "publish", interrupted)
    with pytest.raises(KeyboardInterrupt), CacheWriter(tmp_path / f"shot.{ending}", cloths, fps=FPS) as writer:
        write_frames(writer, cloths, range(3))
    assert names(tmp_path) == []


@pytest.mark.parametrize("ending", ["usdc", "usda"])
def test_frames_that_cannot_get_their_name_are_kept_and_the_sentence_says_where(tmp_path, monkeypatch, ending):
    cloths, path = two_cloths(), tmp_path / f"shot.{ending}"

    def full(source, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(UsdError) as caught, CacheWriter(path, cloths, fps=FPS) as writer:
        write_frames(writer, cloths, range(3))
    kept = partial_of(path)
    assert str(caught.value) == (f"Cannot write shot.{ending}: No space left on device; its frames are kept in {kept}.")
    assert names(tmp_path) == [kept.name]
    assert last_frame(kept) == 2


def test_a_writer_that_cannot_begin_leaves_nothing(tmp_path):
    class Unprintable:
        def __str__(self):
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        CacheWriter(tmp_path / "shot.usdc", two_cloths(), provenance={"fact": Unprintable()})
    assert names(tmp_path) == []


@pytest.mark.parametrize("ending", ["usda", "usdz"])
def test_an_export_that_is_interrupted_leaves_nothing(tmp_path, monkeypatch, ending):
    def interrupted(path):
        raise KeyboardInterrupt

    monkeypatch.setattr(paths, "_flush_to_disk", interrupted)
    with pytest.raises(KeyboardInterrupt):
        export_scene(load_scene("hanging"), tmp_path / f"hanging.{ending}")
    assert names(tmp_path) == []


@pytest.mark.parametrize("ending", ["usda", "usdz"])
def test_a_shot_that_is_interrupted_leaves_no_half_of_itself(tmp_path, monkeypatch, ending):
    add_cloth(stage := new_stage(tmp_path / "asset.usda"))
    stage.Save()
    shot = read_shot(tmp_path / "asset.usda")
    writer = ShotWriter(tmp_path / f"shot.{ending}", shot, 24.0, {})
    (cloth,) = shot.cloths
    writer.write(0, {cloth.name: cloth.points}, {cloth.name: 0.0 * cloth.points})
    monkeypatch.setattr("warpcloth.scenes.shots.layers.publish", lambda target: signal_of_the_user())
    with pytest.raises(KeyboardInterrupt):
        writer.close()
    assert not [name for name in names(tmp_path) if "partial" in name]


@pytest.mark.parametrize("ending", ["usda", "usdz"])
def test_a_name_that_only_the_layer_of_a_shot_makes_too_long_is_one_sentence(tmp_path, ending):
    add_cloth(stage := new_stage(tmp_path / "asset.usda"))
    stage.Save()
    longest = 255 - len(f".{os.getpid()}-01234567.partial.usdc")
    with pytest.raises(UsdError, match=r"^Cannot write x+\.cache\.usdc: "):
        ShotWriter(tmp_path / f"{longest * 'x'}.{ending}", read_shot(tmp_path / "asset.usda"), 24.0, {})
    assert names(tmp_path) == ["asset.usda"]


def signal_of_the_user():
    raise KeyboardInterrupt
