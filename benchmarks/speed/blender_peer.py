"""Blender's cloth on the two scenes, in a process of its own (``blender_scene.py``)."""

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import weakref
from pathlib import Path
from typing import IO, Any

import numpy as np

from warpcloth.errors import InputError, MissingExtraError, SimulationError

from .scenes import CENTRE, DRAPE, DT, HANG, RADIUS, Problem

BLENDER = "blender"
PYTHON = "BLENDER_PYTHON"  # environment variable: a Python that has ``bpy``, where ours has not
DISTANCE, SELF_DISTANCE = 5e-3, 6e-3  # [m], at 64²: with less, cloth meets itself; with 8 mm it is stretched by 2 %
PATIENCE = 10.0  # [s] for Blender to end
SPHERE_SUBDIVISIONS = 4  # of an icosahedron: with more, frames take many times as long


def installed() -> bool:
    """Whether there is a Blender to compare with."""
    return PYTHON in os.environ or importlib.util.find_spec("bpy") is not None


def substeps(n: int) -> int:
    """Blender's ``quality``; the finer the cloth, the more.

    Of those that swing as far as is right on the hang at 64² 5 is the fastest: 4 takes a tenth longer, as its solves
    take more iterations, and with 3 the swing misses by 1 mm.
    """
    return 5 * -(-n // 64)


def scene(problem: Problem, n: int) -> dict[str, Any]:
    """What :mod:`.blender_scene` is told.

    Mass and stiffness are Blender's own (0.3 kg for each vertex, 15, 5 and 0.5): only ratios of them matter, and with
    masses in kilograms the tolerance of Blender's solver leaves forces of cloth unsolved. Friction is Blender's own,
    too, which is no coefficient.
    """
    u, index = np.linspace(-0.5, 0.5, n), np.arange(n * n).reshape(n, n)
    corners = [index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]]
    return {
        "gravity": [0.0, 0.0, -9.81],
        "dt": DT,
        "frames": problem.frames,
        "points": [[x, y, problem.height] for y in u.tolist() for x in u.tolist()],
        "quads": np.stack(corners, axis=-1).reshape(-1, 4).tolist(),
        "pinned": index[:, 0].tolist() if problem is HANG else [],
        "sphere": [CENTRE, RADIUS] if problem is DRAPE else None,
        "sphere_subdivisions": SPHERE_SUBDIVISIONS,
        "substeps": substeps(n),
        "distance": DISTANCE * min(1.0, 64 / n),
        "self_distance": SELF_DISTANCE * min(1.0, 64 / n),
    }


class BlenderRun:
    """A scene in Blender; see :class:`warpcloth.benchmarks.speed.tools.Run`."""

    def __init__(self, problem: Problem, n: int):
        if not installed():
            raise MissingExtraError(
                'Blender is not installed: pip install "warpcloth[blender]" with Python 3.11, or set '
                f"{PYTHON} to a Python that has its package, bpy."
            )
        told = scene(problem, n)
        quads = np.array(told["quads"])
        self.triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        self._size = 8 * 3 * n * n
        self._cpu = 0.0
        self._words = tempfile.TemporaryFile()  # noqa: SIM115 (it is open as long as the process)
        self._process = _start(self._words)
        weakref.finalize(self, _end, self._process, self._words)
        self._ask(json.dumps(told))
        self.facts: dict[str, Any] = {"substeps": told["substeps"], "version": self._line()}

    def frame(self) -> None:
        """One frame."""
        self._ask("frame")
        self._cpu = float(self._line())

    def points(self) -> np.ndarray:
        """Positions."""
        self._ask("points")
        answers = self._process.stdout
        assert answers is not None
        data = answers.read(self._size)
        if len(data) < self._size:
            raise self._failure()
        return np.frombuffer(data).reshape(-1, 3)

    def processor_time(self) -> float:
        """Of Blender's process, in which the last frame ended."""
        return self._cpu

    def _ask(self, word: str) -> None:
        questions = self._process.stdin
        assert questions is not None
        try:
            questions.write(f"{word}\n".encode())
            questions.flush()
        except BrokenPipeError:
            raise self._failure() from None

    def _line(self) -> str:
        answers = self._process.stdout
        assert answers is not None
        line = answers.readline().decode()
        if not line.endswith("\n"):
            raise self._failure()
        return line.strip()

    def _failure(self) -> SimulationError:
        code = self._process.wait()
        self._words.seek(0)
        words = self._words.read().decode(errors="replace").strip().splitlines() or [f"exit code {code}"]
        return SimulationError(f"Blender's process ended: {words[-1]}")


def _start(words: IO[bytes]) -> subprocess.Popen[bytes]:
    python, program = os.environ.get(PYTHON, sys.executable), Path(__file__).with_name("blender_scene.py")
    command = [python, "-P", str(program)]  # -P: this folder has a profile.py, as Python has
    try:
        return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=words)
    except OSError as error:
        words.close()
        raise InputError(f"{PYTHON} is {python!r}, which cannot be run: {error.strerror}.") from None


def _end(process: subprocess.Popen[bytes], words: IO[bytes]) -> None:
    """Its input ends, and so does it."""
    try:
        process.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
    words.close()
