"""The cloth of the benchmark in Warp's wheel: its own code builds it, so that nobody's copy is measured.

``warp/examples/benchmarks/benchmark_cloth.py`` runs on import, so its class alone is taken out of its source; and
``benchmark_cloth_warp.py`` empties Warp's cache of kernels on import, which would throw away those of everybody else.
"""

import ast
import importlib.util
import sys
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import warp as wp

GRAVITY = (0.0, -9.81, 0.0)
DT, SUBSTEPS = 1.0 / 60.0, 16
SIZES = {"radius": 0.1, "mass": 0.1, "stretch_stiffness": 1000.0, "shear_stiffness": 1000.0, "bend_stiffness": 1000.0}
SHAKE = 0.1  # [m/s], so that springs act from the first step on


def benchmark_folder() -> Path:
    """Where Warp keeps its benchmarks."""
    return Path(wp.__file__).parent / "examples" / "benchmarks"


def warp_cloth(n: int) -> Any:
    """Their cloth of n² particles with k in N/m, moving at random, the same way each time."""
    source = (benchmark_folder() / "benchmark_cloth.py").read_text(encoding="utf-8")
    classes: list[ast.stmt] = [
        node for node in ast.parse(source).body if isinstance(node, ast.ClassDef) and node.name == "Cloth"
    ]
    names: dict[str, Any] = {"np": np}
    exec(compile(ast.Module(body=classes, type_ignores=[]), "benchmark_cloth.py", "exec"), names)
    cloth = names["Cloth"](lower=(0.0, 0.0, 0.0), dx=n, dy=n, **SIZES)
    free = (cloth.inv_masses > 0.0)[:, None]
    shake = np.random.default_rng(0).uniform(-SHAKE, SHAKE, cloth.velocities.shape)
    cloth.velocities = np.where(free, shake, 0.0).astype(np.float32)
    return cloth


def warp_integrator(cloth: Any) -> Any:
    """Their integrator of that cloth on the CPU, moving as the cloth does (it starts everything at rest)."""
    path = benchmark_folder() / "benchmark_cloth_warp.py"
    if path.stem not in sys.modules:
        spec = importlib.util.spec_from_file_location(path.stem, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        with patch.object(wp, "clear_kernel_cache"):
            spec.loader.exec_module(module)
        sys.modules[path.stem] = module
    integrator = sys.modules[path.stem].WpIntegrator(cloth, "cpu")
    integrator.velocities.assign(cloth.velocities)
    return integrator
