"""What options of pictures and films do, as numbers: rates, cameras, scales; and stages that are played as they are."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import ImageDraw
from pxr import Gf, Sdf, Usd, UsdGeom
from warpcloth.scenes.usd.playback import Playback

from warpcloth.errors import InputError
from warpcloth.render.camera import make_camera
from warpcloth.render.coloring import Coloring, color_scale
from warpcloth.render.files import film_rate, write_still
from warpcloth.render.legend import with_color_bar
from warpcloth.render.pictures import _rate

LOCAL = np.array([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 1.0, 0.0), (0.0, 1.0, 0.0)])
SPEEDS = (0.0, 1.0, 2.0, 2.0)  # [m/s], along the mesh's own x


@pytest.fixture
def playback(tmp_path):
    """A left-handed square below a parent that is turned by 90°, from time code 101 on, with velocities."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "square.usda"))
    stage.SetTimeCodesPerSecond(24.0)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.Xform.Define(stage, "/turned").AddRotateZOp().Set(90.0)
    square = UsdGeom.Mesh.Define(stage, "/turned/square")
    square.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    square.CreateFaceVertexCountsAttr([3, 3])
    square.CreateFaceVertexIndicesAttr([0, 1, 2, 0, 2, 3])
    texture = UsdGeom.PrimvarsAPI(square).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
    )
    texture.Set([Gf.Vec2f(*LOCAL[corner, :2]) for corner in (0, 1, 2, 0, 2, 3)])
    for code in (101, 102, 103):
        square.CreatePointsAttr().Set([Gf.Vec3f(*point) for point in LOCAL], code)
        square.CreateVelocitiesAttr().Set([Gf.Vec3f(speed, 0.0, 0.0) for speed in SPEEDS], code)
    stage.Save()
    return Playback(tmp_path / "square.usda")


def test_a_stage_that_begins_late_is_turned_and_left_handed_is_played_as_it_is(playback):
    (cloth,) = playback.cloths
    assert [playback.time(frame) for frame in range(3)] == pytest.approx([0.0, 1 / 24, 2 / 24])
    turned = np.column_stack([-LOCAL[:, 1], LOCAL[:, 0], LOCAL[:, 2]])
    assert playback.points(cloth, 0) == pytest.approx(turned)
    assert playback.velocities(cloth, 2) == pytest.approx(np.outer(SPEEDS, (0.0, 1.0, 0.0)))
    assert cloth.uvs == pytest.approx(LOCAL[cloth.triangles][..., :2])  # each corner keeps its own
    a, b, c = turned[cloth.triangles[0]]
    assert np.cross(b - a, c - a)[2] < 0.0


def test_colours_and_the_bar_share_one_scale(playback, monkeypatch):
    coloring = Coloring("speed", playback)
    assert coloring.top == pytest.approx(2.0)
    assert coloring.albedo(playback, 0, 1) == pytest.approx(color_scale(np.array([0.0, 0.5, 1.0, 1.0])))
    written = []
    monkeypatch.setattr(ImageDraw.ImageDraw, "text", lambda self, place, text, *rest, **more: written.append(text))
    for name, top in (("speed", 2.0), ("strain", 0.1)):
        coloring = Coloring(name, playback)
        coloring.top = top
        with_color_bar(np.zeros((100, 160, 3), np.uint8), coloring)
    assert written == ["0", "1", "2", "speed [m/s]", "0", "5", "10", "largest strain [%]"]


def test_a_gif_shows_pictures_for_hundredths_of_a_second_and_two_at_least():
    gif = Path("film.GIF")
    assert [film_rate(gif, fps) for fps in (10.0, 24.0, 60.0, 240.0)] == pytest.approx([10.0, 25.0, 50.0, 50.0])
    assert film_rate(Path("film.mp4"), 240.0) == 240.0


@pytest.mark.parametrize(
    ("name", "asked", "own", "rate"),
    [
        ("film.mp4", None, 24.0, 24.0),
        ("film.mp4", None, 120.0, 60.0),
        ("film.mp4", 120.0, 24.0, 120.0),
        ("film.gif", None, 12.5, 12.5),
        ("film.gif", None, 60.0, 25.0),
        ("film.gif", 50.0, 60.0, 50.0),
    ],
)
def test_the_rate_of_a_film_is_its_caches_unless_that_is_fast(name, asked, own, rate):
    assert _rate(asked, Path(name), False, SimpleNamespace(fps=own)) == pytest.approx(rate)


def test_a_camera_comes_nearer_or_stands_where_it_is_told():
    points = np.random.default_rng(1).uniform((-1, -2, 0), (1, 2, 0.5), (50, 3))
    usual, near = (make_camera(text, points, (300, 200)) for text in ("30,-20", "30,-20,2"))
    assert near.distance == pytest.approx(0.5 * usual.distance)
    assert near.target == pytest.approx(usual.target)
    placed = make_camera("1,2,3,0,0.5,1", points, (300, 200))
    assert (placed.eye, placed.target) == (pytest.approx((1.0, 2.0, 3.0)), pytest.approx((0.0, 0.5, 1.0)))
    assert placed.turned(0.5 * np.pi).eye == pytest.approx((-1.5, 1.5, 3.0))


def test_a_picture_that_cannot_take_its_name_leaves_nothing_behind(tmp_path):
    (tmp_path / "still.png").mkdir()
    with pytest.raises(InputError, match=r"Cannot write still\.png"):
        write_still(tmp_path / "still.png", np.zeros((4, 4, 3), np.uint8))
    assert [item.name for item in tmp_path.iterdir()] == ["still.png"]
