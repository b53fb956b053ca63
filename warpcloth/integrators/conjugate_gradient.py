"""Conjugate gradients on the device; the method is described in ``kernels/conjugate_gradient.py``."""

import itertools
from typing import Any

import numpy as np
import warp as wp

from ..forces import Hessian, Linearization
from ..launching import fill, launch, repeat_while
from ..model import Model

GPU_LANE = 32  # particles per lane: short enough that a GPU has enough lanes, long enough that few are left to sum
CPU_LANE = 512  # short enough to be shared evenly by threads


class ConjugateGradient:
    """Solves (M + a K + b C) x = −residual for the free particles of all worlds, each on its own.

    Preconditioned by the inverse 3×3 diagonal blocks (of the projected matrix, so that they are definite).

    Args:
        model: the model.
        max_iterations: where solves end, accurate or not.

    Attributes:
        x: the solution, vec3, shape [particle_count]; 0 for pinned particles.
        solves: per world: iterations, decrease of the quadratic model, whether the matrix was found indefinite.
        partial: scratch for sums, float64, one per lane.
        lanes, lane_count: how particles are divided for sums.
    """

    def __init__(self, model: Model, max_iterations: int):
        self.model, self.max_iterations = model, max_iterations
        self.kernels = model.kernels.conjugate_gradient
        self.lanes, self.lane_count = _make_lanes(model)
        self.partial = wp.zeros(self.lane_count, dtype=wp.float64, device=model.device)
        self.x, self._r, self._p, self._ap = (wp.zeros_like(model.particle_q) for _ in range(4))
        self._blocks = wp.zeros(model.particle_count, dtype=model.kernels.precision.mat33, device=model.device)
        self._projected = model.array(np.ones(model.world_count), model.real)
        self.solves = self.kernels.Solves()
        for name in ("active", "iterations", "indefinite"):
            setattr(self.solves, name, wp.zeros(model.world_count, dtype=wp.int32, device=model.device))
        for name in ("rz", "first_rz", "alpha", "beta", "decrease", "mark"):
            setattr(self.solves, name, wp.zeros(model.world_count, dtype=wp.float64, device=model.device))
        self.solves.remaining = wp.zeros(1, dtype=wp.int32, device=model.device)

    def solve(
        self,
        forces: Hessian,
        at: Linearization,
        residual: wp.array,
        world_active: wp.array,
        world_tolerance: wp.array,
    ) -> None:
        """Leaves the solution in ``x``, and 0 in worlds where ``world_active`` (int32, shape [world_count]) is 0.

        ``world_tolerance`` (float64) is the error of x, relative to x, in the energy norm (estimated).
        """
        model = self.model
        self._factor(forces, at)
        state = [world_active, residual, self._blocks]
        vectors = [self.x, self._r, self._p, self._ap, self.partial]
        self._launch("begin", self.lane_count, [self.lanes, model.particle_mass, *state], vectors)
        fill(self.solves.remaining)
        self._launch("begin_worlds", model.world_count, [self.lanes, self.partial], [self.solves])
        repeat_while(self.solves.remaining, lambda: self._iterate(forces, at, world_tolerance))

    def _factor(self, forces: Hessian, at: Linearization) -> None:
        model = self.model
        fill(self._blocks)
        forces.hessian_diagonal(at.projected(self._projected), self._blocks)
        masses = [model.particle_mass, model.particle_inv_mass]
        self._launch("invert_blocks", model.particle_count, masses, [self._blocks])

    def _iterate(self, forces: Hessian, at: Linearization, world_tolerance: wp.array) -> None:
        model, lanes, solves = self.model, self.lanes, self.solves
        forces.hessian_product(at, self._p, self._ap)
        self._launch("curvature", self.lane_count, [lanes, self._p, self._ap], [self.partial])
        self._launch("step_length", model.world_count, [lanes, self.partial], [solves])
        self._launch(
            "advance",
            self.lane_count,
            [lanes, model.particle_inv_mass, solves, self._blocks, self._p, self._ap],
            [self.x, self._r, self.partial],
        )
        limits = [world_tolerance, self.max_iterations]
        self._launch("judge", model.world_count, [lanes, self.partial, *limits], [solves])
        inputs = [model.particle_mass, model.particle_world, solves, self._blocks, self._r]
        self._launch("turn", model.particle_count, inputs, [self._p, self._ap])

    def _launch(self, kernel: str, dim: int, inputs: list, outputs: list) -> None:
        launch(getattr(self.kernels, kernel), dim=dim, inputs=inputs, outputs=outputs, device=self.model.device)


def _make_lanes(model: Model) -> tuple[Any, int]:
    """Ranges of particles that never cross from one world to the next; those of a world need not be in one row."""
    worlds = model.particle_world.numpy()
    bounds = np.flatnonzero(np.diff(worlds, prepend=-1, append=-1)).tolist()
    length = CPU_LANE if model.device.is_cpu else GPU_LANE
    rows = [(worlds[a], k, min(k + length, b)) for a, b in itertools.pairwise(bounds) for k in range(a, b, length)]
    world, start, end = np.array(sorted(rows)).T
    lanes = model.kernels.conjugate_gradient.Lanes()
    lanes.particle_start, lanes.particle_end = model.array(start, wp.int32), model.array(end, wp.int32)
    lanes.world = model.array(world, wp.int32)
    lanes.lane_start = model.array(np.searchsorted(world, np.arange(model.world_count + 1)), wp.int32)
    return lanes, len(rows)
