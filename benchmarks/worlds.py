"""Throughput of many worlds stepped together: world-steps per second against the number of worlds."""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

import warpcloth as wc

from .. import validate
from ..interop import VectorEnv
from ..interop.vector_env import MAX_WORLDS
from .machine import describe_machine

WORLDS = (1, 4, 16, 64, 256)
SCHEMES = ("xpbd", "symplectic_euler")
FEWEST_STEPS = 5
DT = 1.0 / 60.0


@dataclass(frozen=True)
class Case:
    """One measurement: so many worlds of one towel, with one integrator."""

    integrator: str
    worlds: int
    resolution: int


def cases(schemes: Sequence[str] | None, worlds: Sequence[Any] | None, resolution: Any) -> list[Case]:
    """All measurements.

    Args:
        schemes: integrators; None: two. worlds: numbers of worlds; None: 1 to 256. resolution: vertices along an edge;
            None: 16.

    Raises:
        InputError: an unknown integrator, or a number out of range.
    """
    names = [
        validate.choice(name, wc.integrators(), "integrator") for name in (SCHEMES if schemes is None else schemes)
    ]
    counts = WORLDS if worlds is None else worlds
    numbers = [validate.integer(n, "worlds", minimum=1, maximum=MAX_WORLDS) for n in counts]
    n = validate.integer(16 if resolution is None else resolution, "resolution", minimum=3, maximum=1000)
    return [Case(name, count, n) for name in names for count in numbers]


def run_cases(todo: Sequence[Case], seconds: float, on_case: Callable[[str], None] | None = None) -> dict[str, Any]:
    """Measures each case for ``seconds`` [s]; ``on_case`` hears of it before."""
    rows = []
    for case in todo:
        if on_case is not None:
            on_case(f"{case.integrator}, {case.worlds} worlds")
        rows.append(measure(case, seconds))
    return {
        "benchmark": "worlds",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": describe_machine(),
        "step_s": DT,
        "rows": rows,
    }


def towel_env(case: Case) -> VectorEnv:
    """A towel above a ball, held by two corners."""
    shape = (case.resolution, case.resolution)
    towel = wc.Cloth.grid((0.5, 0.5), shape, pins=["top_left", "top_right"], transform=(0.0, 0.0, 0.4))
    obstacles = [wc.Sphere((0.0, -0.1, 0.15), 0.15), wc.Plane()]
    return VectorEnv([towel], obstacles, worlds=case.worlds, dt=DT, integrator=case.integrator)


def measure(case: Case, seconds: float) -> dict[str, Any]:
    """Steps with new actions each, and a reset of a quarter of the worlds now and then, timed one by one.

    Returns:
        Facts of the case; ``compile_s``: the first two steps; ``step_ms``, ``cpu_ms``: median wall and processor time
        of a step; ``world_steps_per_s`` by wall time; ``particle_steps_per_s`` counts substeps.
    """
    env = towel_env(case)
    random = np.random.default_rng(0)
    begun = time.perf_counter()
    for _ in range(2):
        env.step(_actions(env, random))
    compiled = time.perf_counter() - begun
    wall, cpu = [], []
    while len(wall) < FEWEST_STEPS or time.perf_counter() - begun - compiled < seconds:
        if len(wall) % 20 == 19:
            env.reset(random.random(env.worlds) < 0.25)
        actions = _actions(env, random)
        start = time.perf_counter(), time.process_time()
        env.step(actions)
        env.times.numpy()  # waits for the device
        wall.append(time.perf_counter() - start[0])
        cpu.append(time.process_time() - start[1])
    particles, substeps = env.simulation.model.particle_count, env.simulation.substeps
    middle = statistics.median(wall)
    return {
        "integrator": case.integrator,
        "worlds": case.worlds,
        "particles": particles,
        "substeps": substeps,
        "steps": len(wall),
        "compile_s": compiled,
        "step_ms": 1e3 * middle,
        "cpu_ms": 1e3 * statistics.median(cpu),
        "world_steps_per_s": case.worlds / middle,
        "particle_steps_per_s": particles * substeps / middle,
        "finite": bool(np.isfinite(env.positions.numpy()).all()),
    }


def _actions(env: VectorEnv, random: np.random.Generator) -> np.ndarray:
    return random.uniform(-0.2, 0.2, env.action_shape).astype(np.float32)
