"""The explicit step by several hands: ours, that of Warp's own benchmark, C++, numpy."""

import ctypes
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

import warpcloth as wc

from .network import DT, GRAVITY, SUBSTEPS, warp_integrator

SOURCE = Path(__file__).with_name("reference.cpp")
FLAGS = ("-O3", "-march=native", "-ffast-math", "-shared", "-fPIC")
SPRING = np.dtype(
    [("a", "i4"), ("b", "i4"), ("rest", "f4"), ("stiffness", "f4"), ("damping", "f4")]
)  # as in reference.cpp


class Ours:
    """Symplectic Euler in a captured frame, without contact; stiffness is per strain, so theirs times the length."""

    def __init__(self, cloth: Any):
        lengths, pinned = cloth.spring_lengths, np.flatnonzero(cloth.inv_masses == 0.0)
        model = wc.Model.from_springs(
            cloth.positions,
            1.0 / cloth.inv_masses[cloth.inv_masses > 0.0][0],
            cloth.spring_indices.reshape(-1, 2),
            lengths,
            cloth.spring_stiffness * lengths,
            cloth.spring_damping * lengths,
            pinned.tolist(),
            velocities=cloth.velocities,
            device="cpu",
        )
        self.simulation = wc.Simulation(
            model, "symplectic_euler", GRAVITY, SUBSTEPS, contact="none", check=False, check_start=False
        )  # theirs checks nothing either

    def frame(self) -> np.ndarray:
        """One frame; positions."""
        self.simulation.step(DT)
        return self.simulation.state.particle_q.numpy()


class Theirs:
    """The integrator of Warp's benchmark."""

    def __init__(self, cloth: Any):
        self.integrator = warp_integrator(cloth)

    def frame(self) -> np.ndarray:
        """One frame; positions."""
        return self.integrator.simulate(DT, SUBSTEPS)


class Numpy:
    """Gathers, and scatters by ``bincount``; in double precision what the others are checked against."""

    def __init__(self, cloth: Any, dtype: type = np.float32):
        self.a, self.b = cloth.spring_indices.reshape(-1, 2).T
        self.rest, self.k_s, self.k_d = (
            values.astype(dtype) for values in (cloth.spring_lengths, cloth.spring_stiffness, cloth.spring_damping)
        )
        self.inverse_mass = cloth.inv_masses.astype(dtype)[:, None]
        self.gravity = np.where(self.inverse_mass > 0.0, np.array(GRAVITY, dtype), dtype(0.0))
        self.x, self.v = cloth.positions.astype(dtype), cloth.velocities.astype(dtype)
        self.dt = dtype(DT / SUBSTEPS)

    def frame(self) -> np.ndarray:
        """One frame; positions."""
        for _ in range(SUBSTEPS):
            self.v += self.dt * (self.gravity + self.inverse_mass * self._forces())
            self.x += self.dt * self.v
        return self.x

    def _forces(self) -> np.ndarray:
        a, b, count = self.a, self.b, len(self.x)
        d = self.x[b] - self.x[a]
        length = np.sqrt(np.einsum("ij,ij->i", d, d))
        n = d / length[:, None]
        rate = np.einsum("ij,ij->i", n, self.v[b] - self.v[a])
        pull = n * (self.k_s * (length - self.rest) + self.k_d * rate)[:, None]
        parts = [np.bincount(a, p, count) - np.bincount(b, p, count) for p in pull.T]
        return np.stack(parts, axis=1).astype(self.x.dtype)


class Cpp:
    """``reference.cpp``, on one thread."""

    def __init__(self, cloth: Any, library: Path):
        self.run = ctypes.CDLL(str(library)).steps
        count = len(cloth.spring_lengths)
        self.springs = np.zeros(count, SPRING)
        self.springs["a"], self.springs["b"] = cloth.spring_indices.reshape(-1, 2).T
        self.springs["rest"], self.springs["stiffness"] = cloth.spring_lengths, cloth.spring_stiffness
        self.springs["damping"] = cloth.spring_damping
        self.gravity = np.array(GRAVITY, np.float32)
        self.inverse_mass = cloth.inv_masses.copy()
        self.x, self.v = cloth.positions.copy(), cloth.velocities.copy()
        self.f = np.zeros_like(self.x)

    def frame(self) -> np.ndarray:
        """One frame; positions."""
        arrays = [
            array.ctypes.data_as(ctypes.c_void_p)
            for array in (self.gravity, self.springs, self.inverse_mass, self.x, self.v, self.f)
        ]
        sizes = [ctypes.c_int(size) for size in (len(self.x), len(self.springs), SUBSTEPS)]
        self.run(*sizes, ctypes.c_float(DT / SUBSTEPS), *arrays)
        return self.x


def compiled(folder: Path) -> tuple[Path | None, str]:
    """The C++ reference as a library in ``folder``, and how it was made; None, and why there is none."""
    compiler = os.environ.get("CXX") or next(filter(shutil.which, ("c++", "g++", "clang++")), None)
    if compiler is None:
        return None, "no C++ compiler found"
    library = folder / "reference.so"
    command = [*compiler.split(), *FLAGS, str(SOURCE), "-o", str(library)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    except OSError as error:
        return None, f"{compiler} cannot be run: {error.strerror}"
    if done.returncode != 0:
        return None, f"{compiler} failed: {(done.stderr.strip().splitlines() or [''])[-1]}"
    version = subprocess.run([*compiler.split(), "--version"], capture_output=True, text=True).stdout
    return library, f"{(version.splitlines() or [compiler])[0]}, {' '.join(FLAGS[:3])}"
