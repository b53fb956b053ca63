"""The check of caches: content with good ones, and finds each fault by itself."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom
from usd_shots import FPS, LAST, frame_of, two_cloths, write_shot
from warpcloth.scenes import load_scene
from warpcloth.scenes.usd import CacheWriter, check_cache

from warpcloth import Box, Capsule, Cloth, MeshObstacle, Motion, Plane, Sphere
from warpcloth.errors import UsdError


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    obstacles = [Plane((0.0, 0.0, -5.0)), Sphere((0.0, 0.0, -3.0), 1.0, motion=Motion.spin((1.0, 0.0, 0.0), 1.0))]
    return write_shot(tmp_path_factory.mktemp("check") / "shot.usdc", obstacles)


def test_a_good_cache_is_sound(good):
    report = check_cache(good, every=True)
    assert report.usd_errors == ()
    assert report.ok
    assert (report.frames, report.fps, report.particles, report.obstacles) == (LAST + 1, FPS, 35 + 37, 2)
    assert report.finite
    assert report.intersections == 0
    assert report.max_penetration_m == 0.0
    assert [cloth.name for cloth in report.cloths] == ["red flag", "red-flag"]
    assert [cloth.velocity_gain for cloth in report.cloths] == pytest.approx([1.0, 1.0], abs=0.02)  # (6 rad/s dt)²/6
    required = {"frames", "particles", "finite", "intersections", "max_penetration_m", "max_strain", "usd_errors"}
    assert required <= report.as_dict().keys()
    assert "sound" in str(report)
    assert "NOT" not in str(report)


def test_strain_is_that_of_the_edges(good):
    expected = 0.0
    for cloth in two_cloths():
        rest = cloth.points.astype(np.float32).astype(float)
        edges = np.concatenate([cloth.triangles[:, [0, 1]], cloth.triangles[:, [1, 2]], cloth.triangles[:, [2, 0]]])
        for frame in range(LAST + 1):
            points = frame_of(cloth, frame)[0].astype(np.float32).astype(float)
            lengths, rests = (np.linalg.norm(p[edges[:, 1]] - p[edges[:, 0]], axis=1) for p in (points, rest))
            expected = max(expected, np.abs(lengths / rests - 1.0).max())
    assert expected > 0.005
    assert check_cache(good).max_strain == pytest.approx(expected, rel=1e-12)


def test_single_frames_of_odd_velocities_are_no_fault(tmp_path):
    """Cloth that lands: it stops between two frames, where its velocity is not the central difference."""
    cloth = Cloth.grid(resolution=(4, 4))
    with CacheWriter(tmp_path / "drop.usdc", [cloth], fps=FPS) as writer:
        for frame in range(24):
            t = frame / FPS
            z, v = (2.0 - 4.905 * t * t, -9.81 * t) if t < 0.6 else (0.2342, 0.0)
            move = np.array([0.0, 0.0, 1.0])
            writer.write(frame, {"cloth": cloth.points + z * move}, {"cloth": np.tile(v * move, (16, 1))})
    report = check_cache(tmp_path / "drop.usdc")
    assert report.usd_errors == ()
    assert report.cloths[0].velocity_gain == pytest.approx(1.0, abs=0.1)


def still(path: Path, cloths: list[Cloth], obstacles: list, frames: int = 3) -> Path:
    with CacheWriter(path, cloths, obstacles, FPS) as writer:
        for frame in range(frames):
            writer.write(frame, {c.name: c.points for c in cloths}, {c.name: 0.0 * c.points for c in cloths})
    return path


SHEET = np.array([0.0, 0.0, 0.97])
UP = np.array([0.0, 0.0, 0.02])
RISE = Motion.keyframes([(0.0, (0.0, 0.0, 0.0)), (2 / FPS, UP)])
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)
SOLIDS = {
    "plane": Plane((9.0, 9.0, 1.0)),
    "sphere": Sphere(radius=1.0),
    "capsule": Capsule((0.0, 0.0, -3.0), (0.0, 0.0, 0.5), 0.5),
    "box": Box(size=(2.0, 2.0, 2.0)),
    "mesh": MeshObstacle(CORNERS, FACES),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_penetration_is_measured_from_the_true_surface(tmp_path, name):
    """The middle of the sheet is 30 mm below the top of each solid, which are all 1 m high."""
    sheet = Cloth.grid(size=(0.1, 0.1), resolution=(3, 3), transform=SHEET)
    report = check_cache(still(tmp_path / "shot.usdc", [sheet], [SOLIDS[name]]))
    assert report.max_penetration_m == pytest.approx(0.03, abs=2e-6)
    assert not report.ok
    assert report.usd_errors == ()


@pytest.mark.parametrize("deforming", [False, True])
def test_penetration_follows_moving_obstacles(tmp_path, deforming):
    sheet = Cloth.grid(size=(0.1, 0.1), resolution=(3, 3), transform=SHEET + 2.0 * UP)
    samples = np.stack([CORNERS, CORNERS + UP])
    moving = {"sample_times": (0.0, 2 / FPS), "sample_points": samples} if deforming else {"motion": RISE}
    report = check_cache(still(tmp_path / "shot.usdc", [sheet], [MeshObstacle(CORNERS, FACES, **moving)]))
    assert report.max_penetration_m == pytest.approx(0.01, abs=2e-6)
    assert report.deepest_frame == 2.0


def test_what_a_ball_is_to_cloth_depends_on_its_cells_at_rest_as_in_the_simulation(tmp_path):
    """Only particles keep out of a ball that is larger than cells: flat ones cut into it, strained or not."""
    sheet, ball = Cloth.grid(resolution=(5, 5)), Sphere((0.125, 0.125, -0.2), 0.26)
    with CacheWriter(tmp_path / "shot.usdc", [sheet], [ball], FPS) as writer:
        for frame in range(2):
            points = sheet.points * (1.0 + 0.1 * frame, 1.0 + 0.1 * frame, 1.0)
            writer.write(frame, {"cloth": points}, {"cloth": 0.0 * points})
    report = check_cache(tmp_path / "shot.usdc", every=True)
    assert report.max_penetration_m == 0.0
    assert report.obstacle_intersections == 0


def test_crossing_cloths_are_counted(tmp_path):
    flat = Cloth.grid(resolution=(2, 2), name="flat")
    upright = np.array([[0.0, 0.0, 1.0, 0.1], [1.0, 0.0, 0.0, 0.03], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    across = Cloth.grid(resolution=(2, 2), transform=upright, name="across")
    report = check_cache(still(tmp_path / "shot.usdc", [flat, across], []))
    assert report.intersections >= 2
    assert report.ok  # reported, not judged
    assert check_cache(still(tmp_path / "one.usdc", [flat], [])).intersections == 0


def test_a_bare_network_is_checked_against_its_rest_lengths(tmp_path):
    network = load_scene("pendulum").build_network()
    with CacheWriter(tmp_path / "net.usdc", [network], fps=FPS) as writer:
        for frame in range(5):
            points = network.points * (1.0 + 0.01 * frame)
            writer.write(frame, {network.name: points}, {network.name: 0.01 * FPS * network.points})
    report = check_cache(tmp_path / "net.usdc")
    assert report.usd_errors == ()
    assert report.particles == len(network.points)
    expected = np.linalg.norm(1.04 * np.diff(network.points, axis=0)[0]) / network.rest_lengths[0] - 1.0
    assert report.max_strain == report.cloths[0].max_strain == pytest.approx(expected, rel=1e-5)


def foreign_stage(path: Path) -> Usd.Stage:
    """As another program writes it: Y up, centimetres, quads, a transform, subdivision left out, colliders by API."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetTimeCodesPerSecond(25.0)
    mesh = UsdGeom.Mesh.Define(stage, "/Show/Sheet")
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    UsdGeom.Xformable(mesh).AddTranslateOp().Set(Gf.Vec3d(0.0, 99.0, 0.0))
    for frame in (1001.0, 1002.0, 1003.0):
        mesh.CreatePointsAttr().Set([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], frame)
    ball = UsdGeom.Sphere.Define(stage, "/Show/Ball")
    ball.CreateRadiusAttr(50.0)
    UsdGeom.Xformable(ball).AddScaleOp().Set(Gf.Vec3f(2.0, 2.0, 2.0))
    ball.GetPrim().ApplyAPI("PhysicsCollisionAPI")
    return stage


def test_a_cache_of_another_program(tmp_path):
    stage = foreign_stage(tmp_path / "show.usda")
    stage.GetRootLayer().Save()
    report = check_cache(tmp_path / "show.usda")
    assert (report.frames, report.particles, report.fps, report.obstacles) == (3, 4, 25.0, 1)
    assert report.max_penetration_m == pytest.approx(1.0 - np.hypot(0.99, np.sqrt(2) * 0.01), abs=1e-6)
    text = " ".join(report.usd_errors)
    assert "has no rest pose" in text
    assert "has no velocities at its frames" in text
    assert "no kilogramsPerUnit" in text
    assert "provenance" not in text


def test_a_collider_that_cannot_be_an_obstacle_is_an_error_of_the_file(tmp_path):
    stage = foreign_stage(tmp_path / "show.usda")
    UsdGeom.NurbsPatch.Define(stage, "/Show/Patch").GetPrim().ApplyAPI("PhysicsCollisionAPI")
    stage.GetRootLayer().Save()
    errors = check_cache(tmp_path / "show.usda").usd_errors
    assert [error for error in errors if "/Show/Patch is a NurbsPatch" in error]


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


UNREADABLE = {
    "missing": (lambda folder, good: folder / "missing.usdc", "there is no such file"),
    "folder": (lambda folder, good: folder, "it is a folder"),
    "empty": (lambda folder, good: write(folder / "a.usdc", b""), "the file is empty"),
    "text": (lambda folder, good: write(folder / "a.txt", b"hello"), "ends in .usd"),
    "not usd": (lambda folder, good: write(folder / "a.usdc", b"hello" * 99), "Cannot read"),
    "not usda": (lambda folder, good: write(folder / "a.usda", b"hello" * 99), "Cannot read"),
    "broken zip": (lambda folder, good: write(folder / "a.usdz", b"PK" * 99), "Cannot read"),
    "half": (lambda folder, good: write(folder / "a.usdc", good[: len(good) // 2]), "Cannot read"),
    "no end": (lambda folder, good: write(folder / "a.usdc", good[:-30]), "Cannot read"),
    "nothing in it": (lambda folder, good: write(folder / "a.usda", b"#usda 1.0\n"), "has sampled points"),
}


@pytest.mark.parametrize("case", UNREADABLE)
def test_unreadable_files_are_one_sentence(good, tmp_path, case, capfd):
    make, words = UNREADABLE[case]
    path = make(tmp_path, good.read_bytes())
    with pytest.raises(UsdError, match=words) as caught:
        check_cache(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.endswith(".")
    assert "/opt/" not in message
    assert capfd.readouterr().err == ""


def test_random_damage_never_escapes_as_another_error(good, tmp_path):
    """Flips bytes of the tables at the end and of the header; values in between may be anything anyway."""
    random = np.random.default_rng(3)
    original = good.read_bytes()
    outcomes = set()
    for _ in range(60):
        damaged = bytearray(original)
        for _ in range(3):
            place = int(random.integers(88)) if random.random() < 0.3 else -int(random.integers(1, 2500))
            damaged[place] = int(random.integers(256))
        path = write(tmp_path / "shot.usdc", bytes(damaged))
        try:
            outcomes.add(check_cache(path).ok)
        except UsdError:
            outcomes.add("refused")
    assert "refused" in outcomes
    assert len(outcomes) > 1
