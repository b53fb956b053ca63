"""Tools that can run the two scenes, ours and others, behind one face."""

import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import warp as wp

from .blender_peer import BLENDER, BlenderRun, installed
from .effort import PEERS
from .scenes import DRAPE, DT, HANG, Problem, simulation

Maker = Callable[[Problem, int], "Run"]


class Run(Protocol):
    """A scene at some frame.

    Attributes:
        facts: what is to be said of the settings, such as ``substeps``.
        triangles: of the cloth, shape [m, 3].
    """

    facts: dict[str, Any]
    triangles: np.ndarray

    def frame(self) -> None:
        """One frame; it is over when this returns."""

    def points(self) -> np.ndarray:
        """Positions [m], row by row of the grid, float64, shape [n², 3]."""

    def processor_time(self) -> float:
        """That the process which simulates has used so far [s]."""


class OurRun:
    """The scene in our simulation."""

    def __init__(self, problem: Problem, n: int, integrator: str):
        self.simulation = simulation(problem, n, integrator)
        self.triangles = self.simulation.model.tri_indices.numpy().reshape(-1, 3)
        self.facts: dict[str, Any] = {}

    def frame(self) -> None:
        """One frame."""
        self.simulation.step(DT)
        wp.synchronize_device(self.simulation.model.device)
        self.facts["substeps"] = self.simulation.substeps

    def points(self) -> np.ndarray:
        """Positions."""
        return self.simulation.state.particle_q.numpy().astype(np.float64)

    def processor_time(self) -> float:
        """Of this process."""
        return time.process_time()


def maker(name: str) -> Maker:
    """What starts a run of the tool of this name; a peer is imported when it is started."""
    if name not in PEERS:
        return lambda problem, n: OurRun(problem, n, name)

    def start(problem: Problem, n: int) -> Run:
        if name == BLENDER:
            return BlenderRun(problem, n)
        from .newton_peers import NewtonRun

        return NewtonRun(problem, n, name)

    return start


def usual(problem: Problem) -> tuple[str, ...]:
    """Tools that are compared on a problem unless others are asked for."""
    newton = {HANG.name: "newton_semi_implicit", DRAPE.name: "newton_style3d"}[problem.name]
    return ("xpbd", newton, BLENDER) if installed() else ("xpbd", newton)
