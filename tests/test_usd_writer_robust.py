"""Writing a cache when something goes wrong: bad input, interrupts, kills, a full disk; and for very long."""

import errno
import os
import stat
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Tf, Usd, UsdGeom
from usd_shots import FPS, frame_of, one_of_each, partial_of, two_cloths, write_frames, write_shot
from warpcloth.scenes.usd import CacheWriter, growing
from warpcloth.scenes.usd.crate import HEADER, read_tables, save_again
from warpcloth.scenes.usd.mesh_prims import ClothPrim
from warpcloth.scenes.usd.obstacle_prims import ObstaclePrim

from warpcloth import Cloth
from warpcloth.errors import DivergedError, InputError, UsdError


def meshes(stage: Usd.Stage) -> list[UsdGeom.Mesh]:
    return [UsdGeom.Mesh(prim) for prim in stage.GetPrimAtPath("/World/Cloth").GetChildren()]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("shot.abc", "must end in .usd, .usdc, .usda or .usdz"),
        ("shot", "must end in"),
        ("missing/shot.usdc", "does not exist"),
        ("folder.usdc", "is a folder"),
        ("folder", "must end in"),
        (f"{240 * 'x'}.usdc", "its name is too long"),
        (f"{300 * 'x'}.usdc", "its name is too long"),
    ],
)
def test_unusable_outputs_are_refused_before_anything_is_made(tmp_path, name, words):
    (tmp_path / "folder.usdc").mkdir()
    with pytest.raises(UsdError, match=words):
        CacheWriter(tmp_path / name, two_cloths())
    assert [p.name for p in tmp_path.iterdir()] == ["folder.usdc"]


def test_read_only_folder_is_refused(tmp_path, monkeypatch):
    def refuse(self, *_, **__):
        raise PermissionError("read-only")  # a test that runs as root cannot take its own rights away

    monkeypatch.setattr(Path, "touch", refuse)
    with pytest.raises(UsdError, match="is not writable"):
        CacheWriter(tmp_path / "shot.usdc", two_cloths())


def test_shapes_names_frames_and_values_are_checked(tmp_path):
    cloths = two_cloths()
    states = {cloth.name: frame_of(cloth, 0) for cloth in cloths}
    points, velocities = ({name: state[k] for name, state in states.items()} for k in (0, 1))
    with CacheWriter(tmp_path / "shot.usdc", cloths, fps=FPS) as writer:
        writer.write(0, points, velocities)
        for wrong in (np.zeros((35, 4)), np.zeros((34, 3)), np.zeros(105), np.zeros((1, 35, 3))):
            with pytest.raises(UsdError, match=r"points of shape \(35, 3\)"):
                writer.write(1, points | {"red flag": wrong}, velocities)
        with pytest.raises(UsdError, match="velocities of shape"):
            writer.write(1, points, velocities | {"red flag": np.zeros((3, 4))})
        with pytest.raises(UsdError, match="the next frame is 1"):
            writer.write(2, points, velocities)
        with pytest.raises(UsdError, match="frames are integers"):
            writer.write(1.0, points, velocities)
        with pytest.raises(UsdError, match="needs those of red flag, red-flag"):
            writer.write(1, {"red flag": points["red flag"]}, velocities)
        for bad in (np.nan, np.inf, 1e39):
            with pytest.raises(DivergedError, match="'red flag' has points that are not finite numbers at frame 1"):
                writer.write(1, points | {"red flag": np.full((35, 3), bad)}, velocities)
    stage = Usd.Stage.Open(str(tmp_path / "shot.usdc"))
    assert [mesh.GetPointsAttr().GetTimeSamples() for mesh in meshes(stage)] == [[0.0], [0.0]]
    with pytest.raises(UsdError, match="is closed"):
        writer.write(1, points, velocities)


@pytest.mark.parametrize("fps", [0.0, -1.0, np.nan, np.inf])
def test_impossible_inputs(tmp_path, fps):
    with pytest.raises(InputError, match="frames per second"):
        CacheWriter(tmp_path / "shot.usdc", two_cloths(), fps=fps)
    with pytest.raises(InputError, match="two cloths named 'a'"):
        CacheWriter(tmp_path / "shot.usdc", [Cloth.grid(name="a"), Cloth.grid(name="a")])
    with pytest.raises(InputError, match="without a cloth"):
        CacheWriter(tmp_path / "shot.usdc", [])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("kind", "name"), [(ClothPrim, "red_flag_1"), (ObstaclePrim, "breathing")])
def test_a_frame_that_was_interrupted_is_dropped(kind, name, tmp_path, monkeypatch):
    cloths, path = two_cloths(), tmp_path / "shot.usdc"
    original = kind.write

    def interrupted(self, code, *values):
        if code == 5 and self.prim.GetName() == name:
            raise KeyboardInterrupt
        return original(self, code, *values)

    monkeypatch.setattr(kind, "write", interrupted)
    with pytest.raises(KeyboardInterrupt), CacheWriter(path, cloths, one_of_each(), FPS) as writer:
        write_frames(writer, cloths, range(20))
    assert writer.frames == 5
    stage = Usd.Stage.Open(str(path))
    assert stage.GetEndTimeCode() == 4.0
    for prim in stage.Traverse():
        for attribute in prim.GetAttributes():
            assert attribute.GetTimeSamples() in ([], [0.0, 1.0, 2.0, 3.0, 4.0]), attribute.GetPath()


def test_other_exceptions_leave_what_was_there(tmp_path):
    path, cloths = write_shot(tmp_path / "shot.usdc", [], last=1), two_cloths()
    before = path.read_bytes()
    with pytest.raises(ZeroDivisionError), CacheWriter(path, cloths, fps=FPS) as writer:
        write_frames(writer, cloths, range(int(1 / 0)))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["shot.usdc"]


def test_without_a_frame_there_is_no_file(tmp_path):
    with CacheWriter(tmp_path / "shot.usdc", two_cloths()) as writer:
        assert partial_of(tmp_path / "shot.usdc")
    assert writer.close() is None
    assert list(tmp_path.iterdir()) == []


def test_a_stage_open_on_the_old_file_sees_the_new_one(tmp_path):
    path = write_shot(tmp_path / "shot.usdc", [], last=1)
    held = Usd.Stage.Open(str(path))
    write_shot(path, [], last=3)
    assert Usd.Stage.Open(str(path)).GetEndTimeCode() == 3.0
    assert held.GetEndTimeCode() == 3.0


def test_same_frames_give_the_same_bytes(tmp_path):
    first, second = (
        write_shot(tmp_path / name / "shot.usdc") for name in ("a", "b") if (tmp_path / name).mkdir() is None
    )
    assert first.read_bytes() == second.read_bytes()


def run_program(program: str, *arguments: object, **options) -> subprocess.Popen:
    first = "import sys, warp\nwarp.config.log_level = warp.LOG_ERROR\nsys.path.insert(0, sys.argv[1])\n"
    code = first + textwrap.dedent(program)
    command = [sys.executable, "-c", code, str(Path(__file__).parent), *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def test_memory_stays_flat_over_ten_thousand_frames(tmp_path):
    """117 MB of samples; a writer that kept them until the end would grow by more than that."""
    program = """
        import resource
        from usd_shots import frame_of
        from warpcloth import Cloth
        from warpcloth.scenes.usd import CacheWriter, growing
        growing.SAVE_BYTES = 4 * 2**20
        cloth = Cloth.grid(resolution=(18, 18))
        points, velocities = frame_of(cloth, 3)
        with CacheWriter(sys.argv[2], [cloth]) as writer:
            for frame in range(10_000):
                points[0, 0] = velocities[0, 0] = frame  # equal arrays would be stored once
                writer.write(frame, {"cloth": points}, {"cloth": velocities})
                if frame == 999:
                    early = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - early)
    """
    out, err = (process := run_program(program, tmp_path / "shot.usdc")).communicate(timeout=300)
    assert process.returncode == 0, err
    size = (tmp_path / "shot.usdc").stat().st_size
    raw = 10_000 * 324 * 36
    assert raw < size < 1.1 * raw
    assert int(out) * 1024 < 0.1 * raw


def test_a_kill_at_any_moment_leaves_only_whole_files(tmp_path):
    """Saves after every frame, so that many kills hit one; what is there must open and hold whole frames."""
    program = """
        from usd_shots import FPS, one_of_each, write_frames
        from warpcloth import Cloth
        from warpcloth.scenes.usd import CacheWriter, growing
        growing.SAVE_BYTES = 1
        cloth = Cloth.grid(resolution=(120, 120))
        print("ready", flush=True)
        while True:
            with CacheWriter(sys.argv[2], [cloth], one_of_each(), FPS) as writer:
                write_frames(writer, [cloth], range(int(sys.argv[3])))
    """
    path, frames = tmp_path / "shot.usdc", 10
    moments = np.random.default_rng(7).uniform(0.0, 0.6, 8)
    partials = 0
    for moment in moments:
        process = run_program(program, path, frames)
        assert process.stdout.readline() == "ready\n", process.communicate()
        while not path.exists() and process.poll() is None:  # the first kill comes after the first whole file
            time.sleep(0.02)
        time.sleep(moment)
        process.kill()
        process.communicate()
        if path.exists():
            assert whole_frames(path) == frames
        partial = partial_of(path)
        if partial:
            partials += 1
            assert whole_frames(partial) <= frames
            partial.unlink()
    assert path.exists()
    assert partials > 2


def whole_frames(path: Path) -> int:
    """Number of frames of a cache, after a check that every sample of every prim can be read."""
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    stage = Usd.Stage.Open(layer)
    world = stage.GetDefaultPrim()
    if not world or not world.GetChild("Cloth"):
        return 0  # killed before anything was saved
    counts = {len(mesh.GetPointsAttr().GetTimeSamples()) for mesh in meshes(stage)}
    for mesh in meshes(stage):
        for attribute in (mesh.GetPointsAttr(), mesh.GetVelocitiesAttr(), mesh.GetNormalsAttr()):
            samples = [attribute.Get(code) for code in attribute.GetTimeSamples()]
            assert len(samples) in counts
            assert all(len(sample) == len(mesh.GetPointsAttr().Get()) for sample in samples)
    (frames,) = counts
    assert frames == 0 or stage.GetEndTimeCode() == frames - 1
    return frames


def test_death_in_the_middle_of_a_save_loses_nothing_saved_before(tmp_path, monkeypatch):
    """OpenUSD writes new values over the old tables, and only then points the header at new ones; stop it there."""
    cloths, path = two_cloths(), tmp_path / "shot.usdc"
    monkeypatch.setattr(growing, "SAVE_BYTES", 1)
    writer = CacheWriter(path, cloths, one_of_each(), FPS)
    partial = partial_of(path)
    write_frames(writer, cloths, range(5))
    with partial.open("rb") as file:
        start, end, _ = read_tables(file)

    class Dying:
        def Save(self):
            with partial.open("r+b") as file:
                file.seek(start)
                file.write(b"\xff" * (300_000 + 2 * (end - start)))
            raise SystemExit

    with pytest.raises(SystemExit):
        save_again(Dying(), partial, 300_000)
    assert whole_frames(partial) == 5
    writer.abort()


def test_a_save_that_a_full_disk_cuts_short_leaves_what_was_saved(tmp_path, monkeypatch):
    """OpenUSD points the header at tables that did not get to the disk, and then says that it is full."""
    cloths, path = two_cloths(), tmp_path / "shot.usdc"
    monkeypatch.setattr(growing, "SAVE_BYTES", 1)
    writer = CacheWriter(path, cloths, one_of_each(), FPS)
    partial = partial_of(path)
    write_frames(writer, cloths, range(5))

    class Full:
        def Save(self):
            with partial.open("r+b") as file:
                file.write(b"\xff" * HEADER)
            raise Tf.ErrorException("No space left on device")

    with pytest.raises(Tf.ErrorException):
        save_again(Full(), partial, 300_000)
    assert whole_frames(partial) == 5
    writer.abort()


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="this system cannot be asked for room")
def test_frames_that_were_saved_before_the_disk_was_full_are_kept(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    cloths, path = two_cloths(), write_shot(tmp_path / "shot.usdc", [], last=1)
    before = path.read_bytes()

    def until_it_is_full():
        with CacheWriter(path, cloths, one_of_each(), FPS) as writer:
            write_frames(writer, cloths, range(5))
            monkeypatch.setattr(os, "posix_fallocate", refuse)
            write_frames(writer, cloths, range(5, 9))

    with pytest.raises(UsdError, match="its first 4 frames are kept in") as said:
        until_it_is_full()
    partial = partial_of(path)
    assert str(said.value).endswith(f"{partial}.")
    monkeypatch.undo()
    assert whole_frames(partial) == 4
    assert path.read_bytes() == before


def test_a_full_disk_is_one_sentence_and_keeps_the_old_file(tmp_path):
    program = """
        import resource, signal
        from pathlib import Path
        from usd_shots import write_shot
        from warpcloth.errors import UsdError
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
        try:
            write_shot(Path(sys.argv[2]), last=200)
        except UsdError as error:
            print(error)
    """
    path = write_shot(tmp_path / "shot.usdc", [], last=1)
    before = path.read_bytes()
    out, err = (process := run_program(program, path)).communicate(timeout=120)
    assert process.returncode == 0, err
    assert out.startswith("Cannot write shot.usdc: ")
    assert out.count("\n") == 1
    assert path.read_bytes() == before


def test_importing_the_package_does_not_load_openusd():
    program = "import warpcloth.scenes.usd\nassert 'pxr' not in sys.modules"
    process = run_program(program)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err


def test_file_permissions_follow_the_umask(tmp_path):
    mask = os.umask(0o022)
    try:
        path = write_shot(tmp_path / "shot.usdc", [], last=1)
    finally:
        os.umask(mask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
