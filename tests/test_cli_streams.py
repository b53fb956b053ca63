"""Streams as shells, pipes and other systems hand them over: closed, full, without most characters; and kept quiet."""

import json
import os
import subprocess
import sys

import pytest

from warpcloth.cli import run


def warpcloth(command, folder, **environment):
    """What a shell makes of ``warpcloth`` and the rest of a line."""
    line = f"'{sys.executable}' -m warpcloth {command}"
    done = subprocess.run(
        ["/bin/sh", "-c", line], capture_output=True, cwd=folder, env={**os.environ, **environment}, check=False
    )
    return done.returncode, done.stdout.decode("ascii", "replace"), done.stderr.decode("ascii", "replace")


pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the lines are for a shell")


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_what_is_closed_is_not_missed(closed, tmp_path):
    assert warpcloth(f"simulate pendulum --frames 1 {closed}", tmp_path)[0] == 0
    assert run(["check", str(tmp_path / "pendulum.usdc")]) == 0


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no full device")
@pytest.mark.parametrize("kind", ["", "--json"])
def test_a_full_disk_behind_stdout_is_one_sentence(kind, tmp_path):
    code, _, said = warpcloth(f"fabrics {kind} > /dev/full", tmp_path)
    assert (code, said.count("\n")) == (2, 1)
    assert "cannot be written to standard output: No space left" in said


def test_characters_that_a_stream_lacks_are_escaped(tmp_path):
    code, out, said = warpcloth("integrators", tmp_path, PYTHONIOENCODING="ascii")
    assert (code, said) == (0, "")
    assert "\\u03c9" in out
    code, out, _ = warpcloth("simulate nö --json", tmp_path, PYTHONIOENCODING="ascii")
    assert code == 2
    assert "'nö'" in json.loads(out)["error"]


def test_exporting_a_stage_says_nothing_of_drivers(tmp_path):
    assert warpcloth("scenes export pendulum -o p.usda", tmp_path)[::2] == (0, "")
