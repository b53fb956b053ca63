"""Ctrl-C while modules are being imported: at the start, and later on, where a command first needs them."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest
from batch_sweeps import written
from warpcloth.scenes.interrupt import stop_on_interrupt

from warpcloth.batch import load_sweep
from warpcloth.batch.folder import BatchFolder
from warpcloth.batch.pool import Worker
from warpcloth.command_start import interrupt

NAPKIN = '[[cloth]]\nname = "napkin"\nshape = "grid"\nresolution = [4, 4]\n'
LATHE = '[[obstacle]]\nshape = "lathe"\noutline = [[0, -1], [0.1, -1], [0, -1.1]]\n'
# A process that gets Ctrl-C as it begins to import a module.
BEGINS = """
    import os, signal, sys
    class Presser:
        def find_spec(self, name, *_):
            if name == os.environ.get("PRESSED_AT") and sys.orig_argv[1:3] == ["-m", "warpcloth"]:
                sys.meta_path.remove(self)
                os.kill(os.getpid(), signal.SIGINT)
    sys.meta_path.insert(0, Presser())
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "napkin.toml").write_text(NAPKIN + LATHE)
    return tmp_path


@pytest.mark.skipif(os.name != "posix", reason="signals are sent by number")
@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_an_interruption_while_modules_are_loaded_is_one_sentence(folder, share):
    """Nobody could catch an exception then, and OpenUSD's modules would swallow it."""
    command = [sys.executable, "-m", "warpcloth", "simulate", "napkin.toml", "--frames", "1000000", "--json"]
    begun = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import warpcloth, warpcloth.cli"], check=True)
    wait = share * (time.perf_counter() - begun)
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder)
    time.sleep(max(0.2, wait))
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, "warpcloth: interrupted.\n")
    assert json.loads(out) == {"error": "interrupted.", "exit_code": 130}
    assert [path.name for path in folder.iterdir()] == ["napkin.toml"]


def test_an_interruption_while_openusd_is_loaded_comes_once_it_is_there(tmp_path):
    program = """
        import importlib, signal, warpcloth.scenes
        load = importlib.import_module
        def interrupted(name, *more):
            if name == "pxr.Sdf":
                signal.raise_signal(signal.SIGINT)
            return load(name, *more)
        importlib.import_module = interrupted
        try:
            warpcloth.scenes.simulate
        except KeyboardInterrupt:
            import sys
            print("pxr.Vt" in sys.modules)
    """
    program = "\n".join(line[8:] for line in program.split("\n"))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path, check=True)
    assert done.stdout == "True\n"


@pytest.mark.parametrize("module", ["trimesh", "networkx", "warpcloth.scenes.run"])
def test_an_interruption_within_a_later_import_is_not_swallowed(folder, module):
    """trimesh goes on without the modules that it cannot import, whatever the reason."""
    (folder / "early").mkdir()
    (folder / "early" / "sitecustomize.py").write_text(textwrap.dedent(BEGINS))
    path = os.pathsep.join([str(folder / "early"), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "warpcloth", "simulate", "napkin.toml", "--frames", "2", "--device", "cpu"]
    environment = {**os.environ, "PYTHONPATH": path, "PRESSED_AT": module}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder, timeout=120)
    assert (done.returncode, done.stderr) == (130, "warpcloth: interrupted.\n")
    assert not list(folder.glob("*.usdc"))


def test_an_interruption_waits_for_the_end_of_an_import(tmp_path, monkeypatch):
    """With the handlers of the command line and of simulations."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "pressed.py").write_text("import signal\nsignal.raise_signal(signal.SIGINT)\nwhole = True\n")
    before = signal.signal(signal.SIGINT, interrupt)
    try:
        for there in (False, True):
            sys.modules.pop("pressed", None)
            with pytest.raises(KeyboardInterrupt):
                import_and_wait(there)
            assert sys.modules["pressed"].whole
    finally:
        signal.signal(signal.SIGINT, before)


def import_and_wait(requests: bool) -> None:
    with stop_on_interrupt() if requests else open(os.devnull):
        __import__("pressed")
        time.sleep(10.0)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="what signals a process blocks is in /proc")
def test_workers_do_not_hear_ctrl_c_from_the_first(tmp_path):
    folder = BatchFolder(tmp_path / "batch")
    folder.claim(load_sweep(written(tmp_path)))
    worker = Worker(folder, None, 1)
    try:
        assert signal.SIGINT in blocked(worker.process.pid)
        assert signal.SIGINT not in blocked(os.getpid())
    finally:
        worker.end()
        worker.process.join()


def blocked(process: int) -> set[int]:
    """Numbers of the signals that a process blocks."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    (mask,) = (int(line.split()[1], 16) for line in lines if line.startswith("SigBlk:"))
    return {number for number in range(1, 65) if mask >> (number - 1) & 1}
