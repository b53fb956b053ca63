"""The command line: what goes to stdout, what to stderr, and the exit code."""

import io
import json
import os
import signal
import subprocess
import sys
import time

import pytest
import warp as wp
from pxr import Gf, Usd, UsdGeom
from rich.text import Text
from warpcloth.scenes import bundled_scenes

import warpcloth
from warpcloth.cli import app, run, simulate
from warpcloth.cli.report import Report, to_json
from warpcloth.cli.terminal import plain_console

PROMISED = {
    "scene", "integrator", "precision", "device", "frames", "substeps", "particles", "springs", "triangles",
    "ms_per_frame", "compile_s", "mean_strain", "max_strain", "intersections", "max_penetration_m", "settled", "output",
    "obstacle_intersections", "contact", "profile_ms",
}  # fmt: skip
NAPKIN = '[[cloth]]\nname = "napkin"\nshape = "grid"\nresolution = [4, 4]\n'


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a small scene in it."""
    (tmp_path / "napkin.toml").write_text(NAPKIN)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def simulate_small(*more):
    """Run ``simulate`` on the small scene."""
    return run(["simulate", "napkin.toml", "--frames", "2", "--device", "cpu", *more])


def test_simulate_writes_a_cache_and_a_summary(folder, capfd):
    assert simulate_small("--set", "cloth.napkin.size=[0.5, 0.5]", "--substeps", "200", "-o", "out.usdc") == 0
    out, err = capfd.readouterr()
    assert (folder / "out.usdc").is_file()
    assert "out.usdc: frames 0 to 2" in out
    assert "200 substeps" in out
    assert err == ""


def test_json_is_all_there_is_on_stdout_and_has_the_promised_keys(folder, capfd):
    assert simulate_small("--json", "--precision", "float64") == 0
    out, err = capfd.readouterr()
    result = json.loads(out)
    assert set(result) >= PROMISED
    assert (result["frames"], result["particles"], result["precision"]) == (2, 16, "float64")
    assert result["output"] == str(folder / "napkin.usdc")
    assert err == ""


def test_what_warp_prints_stays_off_stdout(folder):
    """With --debug Warp talks, from Python and from native code; run apart, so that it really starts up."""
    environment = {**os.environ, "WARP_CACHE_PATH": str(folder / "cache")}
    command = [sys.executable, "-m", "warpcloth", "simulate", "napkin.toml", "--frames", "1", "--json", "--debug"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder, check=True)
    assert json.loads(done.stdout)["frames"] == 1
    assert "Warp" in done.stderr


@pytest.mark.skipif(wp.is_cuda_available(), reason="there is such a device")
def test_the_current_gpu_of_a_machine_without_one_is_one_sentence(folder, capfd):
    """Warp, asked for it, says two lines of its own, from native code."""
    assert run(["simulate", "napkin.toml", "--device", "cuda"]) == 2
    assert capfd.readouterr().err == "warpcloth: Device 'cuda' is not available; this machine has: cpu.\n"


def test_check_finds_the_cache_of_simulate_sound(folder, capfd):
    assert simulate_small("-o", "out.usdc") == 0
    capfd.readouterr()
    assert run(["check", "out.usdc", "--json"]) == 0
    out, err = capfd.readouterr()
    found = json.loads(out)
    assert {"frames", "particles", "finite", "intersections", "max_penetration_m", "max_strain"} <= set(found)
    assert (found["frames"], found["particles"], found["finite"], found["usd_errors"]) == (3, 16, True, [])
    assert err == ""
    assert run(["check", "out.usdc"]) == 0
    assert capfd.readouterr().out.startswith("out.usdc: sound")


def test_a_cache_that_is_not_there_may_be_one_that_is(folder, capfd):
    """The name of the scene is not that of its cache."""
    assert simulate_small() == 0
    capfd.readouterr()
    assert run(["check", "napkin"]) == 2
    said = "warpcloth: Cannot read napkin: there is no such file"
    assert capfd.readouterr().err == f"{said}; did you mean 'napkin.usdc'?\n"
    assert run(["check", "elsewhere.usdc"]) == 2
    assert capfd.readouterr().err == "warpcloth: Cannot read elsewhere.usdc: there is no such file.\n"


def test_check_counts_intersections_at_the_last_frame_or_at_every_one(folder, capfd):
    """A corner goes through the cloth at frame 1, and is back at frame 2."""
    assert simulate_small("-o", "out.usdc") == 0
    stage = Usd.Stage.Open(str(folder / "out.usdc"))
    points = UsdGeom.Mesh.Get(stage, "/World/Cloth/napkin").GetPointsAttr()
    crossing = list(points.Get(1))
    crossing[0] = crossing[10] * 2.0 - crossing[0] + Gf.Vec3f(0.0, 0.0, 0.2)
    crossing[1] = crossing[10] - Gf.Vec3f(0.0, 0.0, 0.2)
    points.Set(crossing, 1)
    stage.Save()
    for arguments, looked, found in ([], "last", False), (["--every"], "every", True):
        capfd.readouterr()
        run(["check", "out.usdc", *arguments])
        assert f" with obstacles ({looked} frame)" in (text := capfd.readouterr().out)
        assert ("  0 intersecting pairs" not in text) == found


def test_check_of_a_spoilt_cache_has_exit_code_3(folder, capfd):
    assert simulate_small("-o", "out.usdc") == 0
    stage = Usd.Stage.Open(str(folder / "out.usdc"))
    UsdGeom.Mesh.Get(stage, "/World/Cloth/napkin").GetPointsAttr().Set([(float("nan"), 0.0, 0.0)] * 16, 2)
    stage.Save()
    assert run(["check", "out.usdc"]) == 3
    assert "has points that are not finite at frame 2" in capfd.readouterr().out


def test_scenes_lists_all_with_title_and_path(capsys):
    assert run(["scenes", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["scenes"]
    assert [row["name"] for row in rows] == bundled_scenes()
    assert all(row["title"] and row["description"] and os.path.isfile(row["path"]) for row in rows)
    assert run(["scenes"]) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in bundled_scenes())


def test_integrators_lists_all_with_their_attributes(capsys):
    assert run(["integrators", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)["integrators"]}
    assert set(rows) == set(warpcloth.integrators())
    assert rows["symplectic_euler"]["order"] == 1
    assert rows["symplectic_euler"]["symplectic"] is True
    assert run(["integrators"]) == 0
    assert all(name in capsys.readouterr().out for name in ["symplectic_euler"])


MISTAKES = [
    (["simulate", "hangin"], "there is no scene 'hangin'; did you mean 'hanging'?"),
    (["simulate"], "Missing argument 'SCENE'; see `warpcloth simulate --help`."),
    (["simulat", "x"], "No such command 'simulat'; did you mean 'simulate'; see `warpcloth --help`."),
    (["scenes", "--frames", "3"], "No such option: --frames; see `warpcloth scenes --help`."),
    (["simulate", "napkin.toml", "--frames", "two"], "frames must be a whole number from 1 to 1,000,000, not 'two'."),
    (["simulate", "napkin.toml", "--frames", "-1"], "frames must be a whole number from 1 to 1,000,000, not -1."),
    (["simulate", "napkin.toml", "--substeps", "0"], 'simulation.substeps must be "auto" or a whole number'),
    (["simulate", "napkin.toml", "--set", "frames"], "napkin.toml: 'frames' is not of the form path=value"),
    (["simulate", "napkin.toml", "--set", "cloth.0.sise=1"], "the key 'cloth.0.sise' is unknown; did you mean 'size'?"),
    (["simulate", "napkin.toml", "-o", "no/where.usdc"], "the folder"),
    (["check", "nothing.usdc"], "there is no such file"),
    (["check", "napkin.toml"], "Cannot read napkin.toml"),
    (["simulate", "napkin.toml", "-o", "where.abc"], "must end in .usd, .usdc, .usda or .usdz."),
]


@pytest.mark.parametrize(("arguments", "sentence"), MISTAKES, ids=[" ".join(words) for words, _ in MISTAKES])
def test_a_mistake_is_one_sentence_on_stderr_and_exit_code_2(arguments, sentence, folder, capfd):
    assert run(arguments) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("warpcloth: ")
    assert sentence in err
    assert err.count("\n") == 1
    assert [path.name for path in folder.iterdir()] == ["napkin.toml"]


def test_a_mistake_found_when_building_names_the_file_too(folder, capfd):
    (folder / "far.toml").write_text(NAPKIN + "pins = [{ box = { lower = [5, 5, 5], upper = [6, 6, 6] } }]\n")
    assert run(["simulate", "far.toml", "--frames", "1"]) == 2
    assert capfd.readouterr().err.startswith("warpcloth: far.toml: cloth.0: ")


def test_a_mistake_under_json_is_an_object_too(folder, capfd):
    assert run(["simulate", "hangin", "--json"]) == 2
    out, err = capfd.readouterr()
    assert json.loads(out) == {"error": err.removeprefix("warpcloth: ").strip(), "exit_code": 2}


def test_a_failed_simulation_has_exit_code_3(folder, capfd):
    inside = '[[obstacle]]\nshape = "sphere"\ncenter = [0, 0, 0]\nradius = 2.0\n'
    (folder / "napkin.toml").write_text(NAPKIN + inside)
    assert simulate_small() == 3
    assert "'napkin' starts inside an obstacle" in capfd.readouterr().err


def test_a_simulation_that_ends_before_torn_cloth_is_infinite_has_exit_code_3(tmp_path, capfd):
    """In its first frame, all numbers are still finite."""
    cloth = tmp_path / "torn.usdc"
    torn = ["two_cloths", "--integrator", "symplectic_euler", "--substeps", "2", "--frames", "1"]
    for contact in ("obstacles", "all"):
        assert run(["simulate", *torn, "--set", f"simulation.contact={contact}", "--output", str(cloth)]) == 3
        assert "use substeps=" in capfd.readouterr().err
    assert not cloth.exists()


def test_an_early_interruption_is_an_object_too(folder, capfd, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("warpcloth.scenes.simulate", interrupted)
    assert run(["simulate", "napkin.toml", "--json"]) == 130
    assert json.loads(capfd.readouterr().out) == {"error": "interrupted.", "exit_code": 130}


def test_ctrl_c_in_a_terminal_leaves_a_valid_file_and_a_report(folder):
    command = [sys.executable, "-m", "warpcloth", "simulate", "napkin.toml", "--frames", "1000000", "--json"]
    process = subprocess.Popen([*command, "--device", "cpu"], cwd=folder, stdout=subprocess.PIPE, text=True)
    saved = range(400_000, 2**24)  # bytes of many frames; while it is saved, a file of one has 16 MiB, too
    while process.poll() is None and not any(path.stat().st_size in saved for path in folder.glob("*.partial.usdc")):
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    result = json.loads(process.communicate()[0])
    assert process.returncode == 130
    assert result["interrupted"] is True
    assert 0 < result["frames"] < 1_000_000
    stage = Usd.Stage.Open(str(folder / "napkin.usdc"))
    assert stage.GetEndTimeCode() == result["frames"]
    assert not list(folder.glob("*.partial.usdc"))


def test_a_defect_is_not_hidden_and_debug_shows_where(monkeypatch, capsys):
    def broken() -> Report:
        """Break."""
        raise RuntimeError("the cause")

    monkeypatch.setattr(app.scenes, "command", broken)
    assert run(["scenes"]) == 1
    err = capsys.readouterr().err
    assert "RuntimeError: the cause" in err
    assert "--debug" in err
    assert "Traceback" not in err
    assert run(["scenes", "--debug"]) == 1
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [[], ["-h"], ["--help"], *([name, "--help"] for name in ("simulate", "check"))])
def test_help_goes_to_stdout(arguments, capsys):
    assert run(arguments) == 0
    assert "Usage: warpcloth" in capsys.readouterr().out


def test_the_module_runs_and_knows_its_version():
    done = subprocess.run([sys.executable, "-m", "warpcloth", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"warpcloth {warpcloth.__version__}\n"


def test_numbers_that_json_does_not_have_become_null():
    assert json.loads(to_json({"a": float("nan"), "b": [float("inf"), 1.5], "c": (1, True)})) == {
        "a": None,
        "b": [None, 1.5],
        "c": [1, True],
    }


def test_reports_of_people_are_plain_text_in_a_pipe(capsys):
    from warpcloth.cli.report import print_report

    print_report(Report({}, Text("done", style="green")), sys.stdout, as_json=False)
    assert capsys.readouterr().out == "done\n"


@pytest.mark.parametrize("name", ["d[v2]", "d[/b]", "d:zap:"])
def test_names_are_shown_as_they_are(name, folder, capfd, monkeypatch):
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / "napkin.toml").rename(folder / f"{name}.toml")
    terminal = io.StringIO()
    monkeypatch.setattr(simulate, "messages", lambda: plain_console(file=terminal, force_terminal=True))
    assert run(["simulate", f"{name}.toml", "--frames", "2", "--device", "cpu", "-o", f"{name}.usdc"]) == 0
    assert f"{name}.usdc: frames 0 to 2" in capfd.readouterr().out
    assert (folder / name).name in terminal.getvalue()
    assert run(["simulate", f"{name}.usdx"]) == 2
    assert f"'{name}.usdx'" in capfd.readouterr().err


def test_unstable_steps_are_one_line_on_stderr(tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = "--frames 1 --integrator symplectic_euler --substeps 2 --device cpu --json"
    assert run(["simulate", "hanging", *options.split()]) in (0, 3)
    lines = [line for line in capfd.readouterr().err.splitlines() if "is unstable with 2 substeps" in line]
    assert len(lines) == 1
    assert lines[0].startswith("warpcloth: ")
    assert "which takes" in lines[0]


def test_a_kernel_cache_that_cannot_be_made_is_one_sentence(folder):
    environment = {**os.environ, "WARP_CACHE_PATH": str(folder / "napkin.toml" / "cache")}
    command = [sys.executable, "-m", "warpcloth", "simulate", "napkin.toml", "--frames", "1"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder)
    assert done.returncode == 2
    assert done.stderr.startswith(f"warpcloth: Kernels cannot be kept in {environment['WARP_CACHE_PATH']}")
    assert done.stderr.endswith("; set WARP_CACHE_PATH to a folder that can be written to.\n")
