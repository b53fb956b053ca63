"""Pictures and films: what they show, not only that they are there. Geometry and light are tested without a window."""

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image
from pxr import Usd, UsdGeom
from warpcloth.scenes import scene_from_toml, simulate
from warpcloth.scenes.usd.playback import Playback

from warpcloth import Box, Cloth
from warpcloth.cli import run
from warpcloth.errors import InputError
from warpcloth.render import render
from warpcloth.render.bake import LightGatherer, cosine_hemisphere, sun_disc
from warpcloth.render.camera import make_camera
from warpcloth.render.coloring import vertex_strain
from warpcloth.render.looks import PATTERN_NAMES, WHITE, pattern_image, pattern_uvs
from warpcloth.render.refine import SmoothMesh
from warpcloth.render.shade import display
from warpcloth.render.shot import moved_back
from warpcloth.render.solids import SolidShape, ball_surface, grid
from warpcloth.render.surface import ClothShell

SCENE = """
frames = 2
[[cloth]]
shape = "grid"
size = [0.6, 0.6]
resolution = [13, 13]
position = [0.0, 0.0, 0.52]
fabric = { name = "cotton", thickness = 0.002, color = [0.6, 0.05, 0.05] }
[[obstacle]]
shape = "sphere"
center = [0.0, 0.0, 0.25]
radius = 0.25
[[obstacle]]
shape = "box"
center = [0.5, 0.0, 0.1]
size = [0.1, 0.2, 0.2]
[[obstacle]]
shape = "capsule"
start = [-0.5, 0.0, 0.1]
end = [-0.5, 0.2, 0.1]
radius = 0.05
[[obstacle]]
shape = "plane"
"""
SMALL = (160, 100)


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A short shot of red cloth above a ball, among other shapes."""
    path = tmp_path_factory.mktemp("render") / "shot.usdc"
    simulate(scene_from_toml(SCENE), path, device="cpu")
    return path


def pixels(path):
    """A picture as integers, shape [height, width, 3]."""
    with Image.open(path) as picture:
        return np.asarray(picture).astype(int)


def bent(points):
    return np.column_stack([points[:, 0], points[:, 1], 0.2 * np.sin(4.0 * points[:, 0])])


def test_refinement_keeps_a_flat_cloth_flat_and_its_outline():
    cloth = Cloth.grid(resolution=(5, 4), size=(1.0, 0.7))
    mesh = SmoothMesh(cloth.points, cloth.triangles, 2)
    fine = mesh.points(cloth.points)[-1]
    assert len(mesh.triangles(2)) == 16 * len(cloth.triangles)
    assert np.abs(fine[:, 2]).max() < 1e-12
    assert np.allclose(np.ptp(fine[:, :2], axis=0), (1.0, 0.7))
    corners = np.cross(*(fine[mesh.triangles(2)][:, k] - fine[mesh.triangles(2)][:, 0] for k in (1, 2)))
    assert corners[:, 2].min() > 0.0
    assert 0.5 * corners[:, 2].sum() == pytest.approx(0.7)


def test_ripple_is_taken_off_and_wide_shapes_stay():
    cloth = Cloth.grid(resolution=(41, 41), size=(1.0, 1.0))
    mesh, x = SmoothMesh(cloth.points, cloth.triangles, 1), cloth.points[:, 0]
    inner = np.abs(cloth.points[:, :2]).max(axis=1) < 0.3
    ripple = 1.0 - (1.0 - 0.5**3) ** 2  # a round takes half off what goes up and down from vertex to vertex
    for waves, kept in ((2.0, (0.98, 1.02)), (20.0, (ripple - 1e-9, ripple + 1e-9))):
        wave = np.column_stack([cloth.points[:, :2], 0.01 * np.cos(2.0 * np.pi * waves * x)])
        share = np.abs(mesh.filtered(wave)[inner, 2]).max() / 0.01
        assert kept[0] <= share <= kept[1]
    assert np.abs(mesh.filtered(cloth.points)[inner] - cloth.points[inner]).max() < 1e-9


def test_what_is_moved_back_looks_the_same():
    eye = np.array([1.0, -2.0, 0.5])
    near = ball_surface(np.zeros(3), 0.3, (1.0, 1.0, 1.0))
    far = moved_back(near, eye, 0.05)
    before, after = near.points - eye, far.points - eye
    lengths = [np.linalg.norm(rays, axis=1) for rays in (before, after)]
    assert np.allclose(lengths[1] - lengths[0], 0.05)
    assert np.allclose(before / lengths[0][:, None], after / lengths[1][:, None])


def test_solids_are_drawn_smaller_without_coming_apart():
    box = SolidShape(Box((0.0, 0.0, 0.0), (0.4, 0.2, 0.2)))
    whole, inset = box.place(0.0), box.place(0.0, 0.01)
    assert (whole.points.max(axis=0) - inset.points.max(axis=0)).min() > 0.004
    assert np.abs(whole.points - inset.points).max() < 0.011
    places = len(np.unique(np.round(whole.points, 9), axis=0))
    assert len(np.unique(np.round(inset.points, 9), axis=0)) == places


def test_refinement_smooths_edges_away():
    """The largest angle between neighbouring triangles falls with each refinement."""
    cloth = Cloth.grid(resolution=(9, 9))
    mesh = SmoothMesh(cloth.points, cloth.triangles, 2)
    angles = []
    for depth, points in enumerate(mesh.points(bent(cloth.points))):
        corners = points[mesh.triangles(depth)]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        sides = np.sort(mesh.triangles(depth)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        order = np.lexsort(sides.T)
        first, second = order[:-1], order[1:]
        shared = (sides[first] == sides[second]).all(axis=1)
        angles.append(
            np.arccos(np.clip(np.sum(normals[first[shared] // 3] * normals[second[shared] // 3], 1), -1, 1)).max()
        )
    assert angles[0] > 0.2
    assert angles[1] < 0.7 * angles[0]
    assert angles[2] < 0.7 * angles[1]


def test_shell_is_closed_and_as_thick_as_the_cloth():
    cloth = Cloth.grid(resolution=(5, 5))
    shell = ClothShell(cloth.points, cloth.triangles, None, 0.02)
    for sides in shell.place(cloth.points):
        triangles = sides.triangles
        directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        assert len(np.unique(directed, axis=0)) == len(directed)
        assert set(map(tuple, directed)) == {(b, a) for a, b in directed}
        corners = sides.points[triangles]
        volume = np.sum(corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])) / 6.0
        assert volume == pytest.approx(0.02, rel=1e-6)
        assert np.allclose(sides.points[sides.twin], sides.points - 0.02 * sides.normals)


def test_light_above_and_below_a_table():
    flat, triangles = grid(np.linspace(-1.0, 1.0, 3), np.linspace(-1.0, 1.0, 3))
    table = (np.column_stack([flat, np.full(len(flat), 0.5)]), triangles)
    gatherer = LightGatherer(np.array([0.0, 0.0, 1.0]), 0.1, 8, 64)
    gatherer.load([table], 1.0)
    up = np.array([0.0, 0.0, 1.0])
    points = np.array([[0.0, 0.0, 0.6], [0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, 0.0, 0.4]])
    light = gatherer.gather(points, np.stack([up, up, up, -up]), lift=0.0)
    assert np.allclose(light[0], (1.0, 1.0, 0.0))  # on the table: everything
    assert light[1, 0] == 0.0
    # a square of side 2 a height h above fills (4/π) (a/√(a²+h²)) atan(a/√(a²+h²)) of the cosine-weighted sky
    filled = 4.0 / np.pi * (1.0 / np.hypot(1.0, 0.5)) * np.arctan(1.0 / np.hypot(1.0, 0.5))
    assert light[1, 1] == pytest.approx(1.0 - filled, abs=0.05)
    assert light[2, 0] == 1.0
    assert np.allclose(light[3], (0.0, 0.0, 1.0))  # under the table, facing down: the ground only


def test_directions_are_spread_as_they_say():
    assert cosine_hemisphere(500)[:, 2].mean() == pytest.approx(2.0 / 3.0, abs=1e-3)  # ∫ cos² / ∫ cos
    disc = sun_disc(np.array([1.0, 2.0, 2.0]), 0.1, 100)
    assert np.allclose(disc.mean(axis=0), np.array([1.0, 2.0, 2.0]) / 3.0, atol=0.01)
    assert np.arccos(disc @ (np.array([1.0, 2.0, 2.0]) / 3.0)).max() <= 0.1 + 1e-9


def test_strain_of_a_stretched_cloth():
    cloth = Cloth.grid(resolution=(4, 4), transform=(0.0, 0.0, 1.0))
    stretched = cloth.points * (1.03, 0.98, 1.0)
    turned = stretched[:, [2, 0, 1]]
    assert np.allclose(vertex_strain(cloth.points, turned, cloth.triangles), 0.03)


@pytest.mark.parametrize("text", ["auto", "top", "low", "-90,10", "30,-20,1"])
@pytest.mark.parametrize("size", [(300, 200), (200, 300)])
def test_the_camera_sees_everything_and_not_much_more(text, size):
    points = np.random.default_rng(1).uniform((-1, -2, 0), (1, 2, 0.5), (50, 3))
    camera = make_camera(text, points, size)
    back = camera.eye - camera.target
    back /= np.linalg.norm(back)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    local = (points - camera.eye) @ np.stack([right, np.cross(back, right), -back]).T
    reach = np.tan(np.radians(0.5 * camera.angle))
    seen = local[:, :2] / local[:, 2:] / (reach * size[0] / size[1], reach)
    assert np.abs(seen).max() < 1.0
    assert np.abs(seen).max() > 0.75


def test_patterns_have_their_size_on_the_cloth():
    cloth = Cloth.grid(size=(0.6, 0.3), resolution=(4, 4))
    uvs = cloth.uvs[cloth.uv_indices]
    scaled = pattern_uvs("stripes", cloth.points, cloth.triangles, uvs)
    assert np.allclose(np.ptp(scaled.reshape(-1, 2), axis=0), (10.0, 5.0))  # 6 cm
    for name in PATTERN_NAMES[1:]:
        image = pattern_image(name, (0.2, 0.4, 0.1)) / 255.0
        assert image.shape == (256, 256, 3)
        assert np.ptp(image) > 0.1
        assert (image**2.2 * WHITE).max() <= WHITE + 1e-9


def test_display_is_srgb_below_the_knee_and_never_clips_hard():
    assert display(np.array([0.0, 0.214, 0.5])) == pytest.approx([0.0, 0.5, 0.735], abs=2e-3)
    bright = display(np.linspace(0.5, 4.0, 50))
    assert np.all(np.diff(bright) > 0.0)
    assert bright[-1] <= 1.0


def test_a_still_shows_red_cloth_and_its_shadow(cache, tmp_path):
    path = tmp_path / "still.png"
    result = render(cache, path, size=(320, 200))
    picture = pixels(path)
    assert picture.shape == (200, 320, 3)
    assert (result.pictures, result.fps) == (1, 0.0)
    red = (picture[..., 0] > 1.5 * picture[..., 1]) & (picture[..., 0] > 1.5 * picture[..., 2])
    assert 0.04 < red.mean() < 0.5
    assert red[:100].sum() > 0.95 * red.sum()  # on top of the ball
    floor = picture.sum(axis=2)
    backdrop = np.median(floor[2:20])
    assert ((np.ptp(picture, axis=2) < 25) & (floor < 0.75 * backdrop)).mean() > 0.02  # grey and dark: shadow


def test_time_codes_are_not_frames(tmp_path):
    """A stage of 240 time codes and 24 frames a second, as some programs write them, plays at 24."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "dense.usda"))
    stage.SetTimeCodesPerSecond(240.0)
    stage.SetFramesPerSecond(24.0)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    cloth = UsdGeom.Mesh.Define(stage, "/cloth")
    cloth.CreateFaceVertexCountsAttr([3])
    cloth.CreateFaceVertexIndicesAttr([0, 1, 2])
    for code in (0, 10, 20):
        cloth.CreatePointsAttr().Set([(0, 0, 0.01 * code), (1, 0, 0), (0, 1, 0)], code)
    stage.Save()
    playback = Playback(tmp_path / "dense.usda")
    assert (playback.frames, playback.fps, playback.time(2)) == (3, 24.0, pytest.approx(2 / 24))
    film = render(tmp_path / "dense.usda", tmp_path / "dense.gif", size=SMALL)
    assert (film.pictures, film.fps) == (3, 25.0)


@pytest.mark.parametrize("fps", [None, 60.0, 50.0, 40.0, 24.0, 7.0])
def test_animations_last_as_long_as_their_cache(fps, tmp_path):
    """To half a picture, though the format has only some rates; and they have the rate that is reported."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "second.usda"))
    stage.SetTimeCodesPerSecond(24.0)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    cloth = UsdGeom.Mesh.Define(stage, "/cloth")
    cloth.CreateFaceVertexCountsAttr([3])
    cloth.CreateFaceVertexIndicesAttr([0, 1, 2])
    for code in range(24):
        cloth.CreatePointsAttr().Set([(0, 0, 0.02 * code), (1, 0, 0), (0, 1, 0)], code)
    stage.Save()
    film = render(tmp_path / "second.usda", tmp_path / "second.gif", size=SMALL, fps=fps)
    shown = []
    with Image.open(film.output) as pictures:
        for number in range(pictures.n_frames):
            pictures.seek(number)
            shown.append(1e-3 * pictures.info["duration"])
    assert min(shown) >= 0.02
    assert film.pictures / film.fps == pytest.approx(sum(shown))
    assert sum(shown) == pytest.approx(1.0, abs=0.5 / film.fps + 1e-9)


def test_a_film_and_a_turntable_and_a_sheet(cache, tmp_path):
    film = render(cache, tmp_path / "film.mp4", size=SMALL, pattern="plain")
    frames, _ = imageio_ffmpeg.count_frames_and_secs(str(film.output))
    assert (frames, film.fps) == (3, 24.0)
    turntable = render(cache, tmp_path / "turn.gif", size=SMALL, turntable=True, fps=0.8, color="strain")
    with Image.open(turntable.output) as turn:
        assert turn.n_frames == turntable.pictures == 4
        first = np.asarray(turn.convert("RGB")).astype(int)
        turn.seek(2)
        assert np.abs(np.asarray(turn.convert("RGB")).astype(int) - first).mean() > 2.0
    assert not list(tmp_path.glob("*partial*"))


def test_a_network_is_rendered_too_but_shows_no_measure(tmp_path, capsys):
    simulate("pendulum", tmp_path / "pendulum.usdc", frames=3, device="cpu")
    still = ["render", str(tmp_path / "pendulum.usdc"), "--frame", "-1", "--size", "160x100"]
    assert run(still) == 0
    picture = pixels(tmp_path / "pendulum.png")
    assert (np.ptp(picture, axis=2) > 60).any()  # a red ball
    assert run([*still, "--color", "speed"]) == 2
    assert "pendulum.usdc has no cloth whose colours could show its speed" in capsys.readouterr().err


def test_simulate_renders_too(tmp_path, monkeypatch, capsys):
    (tmp_path / "napkin.toml").write_text('[[cloth]]\nshape = "grid"\nresolution = [3, 3]\n')
    monkeypatch.chdir(tmp_path)
    assert run(["simulate", "napkin.toml", "--frames", "1", "--device", "cpu", "--render"]) == 0
    assert "napkin.mp4" in capsys.readouterr().out
    assert imageio_ffmpeg.count_frames_and_secs("napkin.mp4")[0] == 2


def test_playback_knows_what_is_in_the_cache(cache):
    playback = Playback(cache)
    assert (playback.frames, playback.fps, playback.time(2)) == (3, 24.0, pytest.approx(2 / 24))
    (cloth,) = playback.cloths
    assert (cloth.name, cloth.fabric, cloth.thickness) == ("cloth", "cotton", 0.002)
    assert cloth.color == pytest.approx((0.6, 0.05, 0.05))
    assert cloth.uvs.shape == (288, 3, 2)
    fallen = playback.points(cloth, 0)[:, 2].mean() - playback.points(cloth, 1)[:, 2].mean()
    assert fallen == pytest.approx(0.5 * 9.81 / 24**2, rel=0.2)
    assert playback.velocities(cloth, 1)[:, 2].mean() == pytest.approx(-9.81 / 24, rel=0.2)
    assert [type(item).__name__ for item in playback.obstacles] == ["Sphere", "Box", "Capsule", "Plane"]


MISTAKES = [
    (["--camera", "upside"], "The camera 'upside' must be one of auto,"),
    (["--camera", "10,100"], "must be one of auto"),
    (["--size", "big"], "The size 'big' must be width and height"),
    (["--size", "101x100"], "must be of even numbers"),
    (["--frame", "9"], "Frame must be a whole number from -3 to 2"),
    (["--color", "heat"], "Color must be one of"),
    (["--pattern", "tartan"], "Pattern must be one of"),
    (["-o", "film.avi"], "its name must end in .png, .jpg, .jpeg, .mp4, .gif."),
    (["-o", "no/where.mp4"], "does not exist"),
    (["--turntable", "--sheet", "4"], "either a turntable or a sheet"),
    (["--frame", "1", "--sheet", "4"], "either of one frame or a sheet"),
    (["--sheet", "4"], "A sheet of 4 frames asks for more than the 3 frames in"),
    (["--frame", "1", "--fps", "5"], "does not move, so it has no fps"),
    (["--frame", "1", "-o", "film.mp4"], "its name must end in .png"),
]


@pytest.mark.parametrize(("options", "sentence"), MISTAKES)
def test_mistakes_are_answered_in_one_sentence(cache, options, sentence, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert run(["render", str(cache), *options]) == 2
    out, err = capfd.readouterr()
    assert sentence in err
    assert len(err.splitlines()) == 1
    assert out == ""
    assert not list(tmp_path.iterdir())


def test_nothing_to_play(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        render(tmp_path / "nothing.usdc")
