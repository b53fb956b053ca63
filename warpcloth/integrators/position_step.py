"""What the position-based schemes share: the step begins with the inertial displacement and ends with velocities."""

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np
import warp as wp

from .. import validate
from ..cloth.springs import triangle_areas
from ..fabric import STANDARD_GRAVITY
from ..forces import Forces
from ..kinematics import drive_pins
from ..launching import fill, launch, only_if
from ..model import ClothRange, Model
from ..state import Memory, State
from .base import Integrator
from .bending_filter import BendingFilter
from .splitting import SymplecticEuler

MAX_ITERATIONS = 100_000
# Cotton of 41² vertices that hung by its edge went on swinging at 0.2 to 0.7 m/s in steps of 8 ms, with 32 sweeps and
# with 100; in steps of 6 ms it came to rest.
MOST_SWEEPS = 16


class PositionStep(Integrator):
    """A step h solved for the displacement δ of each particle: m (δ − δ̂)/h² = spring forces at the end of the step.

    δ̂ = h v + h² f/m holds gravity and all forces but ``solved_forces``, evaluated at the start of the step, that of
    pressure turned to its end (:meth:`ahead`). Woven triangles that a scheme does not solve for are among them, and
    limit its step. Bending does not: where it would, its force is smoothed (``kernels/bending_filter.py``), but in
    differentiable models. The solution begins at δ̂ plus the share ``warm_start`` of what springs did in the previous
    step; but if it is so much longer than that one that this would be further than they went in it, at δ̂ alone: what
    moves to and fro in short steps does not go on in long ones.
    """

    implicit = True
    symplectic = False
    capturable = True
    solves_springs_only = True
    solved_forces: ClassVar[tuple[str, ...]] = ("springs",)
    needs_inertial = False  # whether a scheme asks for δ̂ when it is no longer where the solution began
    sweep_value = 1.0  # sweeps of XPBD that an iteration is worth on hanging cloth
    # With XPBD a ball going through a curtain had 7,000 impacts in 144 frames with 1, 3,000 with 1.25 and 600 with 1.5,
    # and a wrung cloth ended with 5.2, 5.6 and 0.2 % of mean strain; linen falling on a ball took 0.75, 1 and 1.2 times
    # as long as with one sweep and its own steps. In piles of five coarse sheets single vertices moved at 0.28 m/s in
    # the schemes' own 2 steps a frame, at 0.19 with 1 and 0.085 with 1.5, where all came to rest.
    steps_per_travel = 1.5

    def __init__(self, model: Model, iterations: int, warm_start: float = 0.0):
        self.iterations = validate.integer(iterations, "iterations", minimum=1, maximum=MAX_ITERATIONS)
        self.warm_start = validate.number(warm_start, "warm_start", minimum=0.0, maximum=1.0)
        self._scales = list(cloth_scales(model))

        def vectors(wanted: bool) -> wp.array:
            count, gradient = model.particle_count if wanted else 0, model.differentiable
            return wp.zeros(count, dtype=model.vec3, device=model.device, requires_grad=gradient)

        expects = self.warm_start > 0.0 or model.differentiable  # adjoints do not ask whether there is an array
        self.displacement, self.spring_acceleration = vectors(True), vectors(expects)
        self._past_dt = wp.zeros(
            model.world_count if expects else 0,
            dtype=wp.float64,
            device=model.device,
            requires_grad=model.differentiable,
        )
        self._forgets = wp.zeros(1, dtype=wp.int32, device=model.device)
        self.inertial = vectors(expects or self.needs_inertial)
        smooths = model.bend_count > 0 and not model.differentiable
        self._bending_filter = BendingFilter(model) if smooths else None
        self.filtered_forces = ("bending",) if smooths else ()

    def step(self, model: Model, state_in: State, state_out: State, forces: Forces, dt: float) -> None:
        """One step; see :class:`~warpcloth.integrators.base.Integrator`."""
        forces.evaluate(state_in, without=(*self.solved_forces, *self.filtered_forces), ahead=self.ahead(dt))
        if self._bending_filter is not None:  # none of these arrays is in use yet
            scratch = (self.displacement, state_out.particle_q, state_out.particle_qd, state_out.particle_f)
            self._bending_filter.accumulate(state_in, forces, dt, scratch)
        self.forget_shorter(model, dt)
        self.predict(model, state_in, state_out, dt)
        self.finish(model, state_in, state_out, self._solve(model, state_in, forces, dt), dt)

    def ahead(self, dt: float) -> float:
        """How far ahead [s] forces that turn with the cloth are taken: to where springs are solved.

        But those expected from the step before have not turned either, and where sweeps leave much of them the two
        cancel: with half of them expected and pressure ahead, a ball that spun in eight steps of projective dynamics a
        frame was 1.5 times as fast after 0.25 s.
        """
        return dt if self.warm_start == 0.0 else 0.0

    def forget_shorter(self, model: Model, dt: float) -> None:
        """Before a step: forgets what springs did in one that was much shorter, if any of it is expected again."""
        if self.warm_start == 0.0:
            return
        fill(self._forgets)
        kernel, outputs = model.kernels.position_step.ask_to_forget, [self._past_dt, self._forgets]
        launch(kernel, model.world_count, [self.warm_start, dt], outputs, model.device)
        only_if(self._forgets, self._forget_springs)

    def predict(self, model: Model, state_in: State, state_out: State, dt: float) -> None:
        """δ̂ of all particles; pins where they will be."""
        model.launch_particles(
            "position_step",
            "predict",
            [
                model.particle_inv_mass, state_in.particle_q, state_in.particle_qd, state_in.particle_f,
                self.spring_acceleration, self.warm_start, dt,
            ],
            [self.inertial, self.displacement, state_out.particle_q, state_out.particle_qd],
        )  # fmt: skip
        drive_pins(model, state_in.world_time, dt, state_out.particle_q, state_out.particle_qd)
        for pins in (model.moving_pins.particle, model.led_pins.particle):
            if len(pins) > 0:
                launch(
                    model.kernels.position_step.displace_pins,
                    dim=len(pins),
                    inputs=[model.particle_inv_mass, pins, state_in.particle_q, state_out.particle_q],
                    outputs=[self.displacement],
                    device=model.device,
                )

    def finish(self, model: Model, state_in: State, state_out: State, displacement: wp.array, dt: float) -> None:
        """The end of the step from its solution δ [m]."""
        model.launch_particles(
            "position_step",
            "finish",
            [model.particle_inv_mass, state_in.particle_q, self.inertial, displacement, dt],
            [self.spring_acceleration, state_out.particle_q, state_out.particle_qd],
        )

    def reset(self) -> None:
        """Forgets the previous step."""
        if len(self.spring_acceleration):
            fill(self._past_dt)
            self._forget_springs()

    def memory(self) -> Sequence[Memory]:
        """What springs did in the previous step, and its length, if any of it is expected again."""
        count = len(self.spring_acceleration)
        return [Memory(self.spring_acceleration, np.arange(count)), Memory(self._past_dt, None)] if count else []

    def _forget_springs(self) -> None:
        """All that is kept of what springs did; launches only."""
        fill(self.spring_acceleration)

    @abstractmethod
    def _solve(self, model: Model, state_in: State, forces: Forces, dt: float) -> wp.array:
        """The solution δ, an array of this object, from ``self.displacement``, which it may overwrite.

        Adds the number of its sweeps over all springs to ``forces.evaluations``.
        """

    @classmethod
    def stable_step(cls, omega: float, gamma: float) -> float:
        """No limit for springs."""
        return math.inf

    @classmethod
    def explicit_step(cls, omega: float, gamma: float) -> float:
        """That of symplectic Euler: all forces but springs are those at the start of the step."""
        return SymplecticEuler.usable_step(omega, gamma)

    def filtered_step(self) -> float:
        """That of the filter for bending."""
        return math.inf if self._bending_filter is None else self._bending_filter.longest_step()

    def advised_step(self) -> float:
        """The step [s] at which cloth holds its own weight without visible numerical stretch.

        What sweeps leave unsolved acts like a softer fabric: its strain grows with the weight below, the step and the
        number of springs that the load passes through, whatever the stiffness. By dimensions the step must be
        √(L/g) f(a/L), a the length of springs, L the size of the cloth. A square metre pinned at an edge and let go
        keeps its worst mean strain near 2.5 % while it swings, and is below 0.3 % at the end, with 4 substeps of 1/60 s
        at 16 × 16 vertices, 10 at 32 × 32, 25 at 64 × 64 and 65 at 128 × 128, for fabrics of 400 and 12,000 N/m alike
        (XPBD, two sweeps without spans): f = 0.7 (a/L)^(4/3). Four times as many sweeps allow twice the step, up to
        :data:`MOST_SWEEPS`. What inflates a cloth pulls at it as weight does.
        """
        return min((self.cloth_step(*scales) for scales in self._scales), default=math.inf)

    def cloth_step(self, cloth: ClothRange, size: float, edge: float, load: float) -> float:
        """The same for one cloth of size L and edge a [m], on which ``load`` [m/s²] acts in place of gravity."""
        sweeps = math.sqrt(min(self.iterations * self.sweep_value, MOST_SWEEPS))
        return sweeps * 0.7 * (edge / size) ** (4.0 / 3.0) * math.sqrt(size / load)


def cloth_scales(model: Model) -> Iterator[tuple[ClothRange, float, float, float]]:
    """Of each cloth L and a [m]: the diagonal of its bounding box, and a length than which a tenth of its in-plane
    springs are shorter, those of woven triangles being as long as the longest chord along the yarn; and gravity, with
    what pressure adds [m/s²], as it pulls at particles that hold heavier ones."""
    in_plane = model.spring_group.numpy() == 0
    chords = [_longest_chords(slopes.numpy()) for slopes in (model.woven.along, model.woven.across)]
    length = np.concatenate([model.spring_rest_length.numpy()[in_plane], *chords])
    corner = model.woven.corners.numpy().reshape(-1, 3)[:, 0]
    first = np.concatenate([model.spring_indices.numpy()[in_plane, 0], corner, corner])
    positions, number = model.particle_q.numpy(), cloth_numbers(model, first)
    order = np.argsort(number, kind="stable")
    bounds = np.searchsorted(number[order], np.arange(1, len(model.cloths)))
    for cloth, own in zip(model.cloths, np.split(length[order], bounds), strict=True):
        size = float(np.linalg.norm(np.ptp(positions[cloth.start : cloth.stop], axis=0)))
        if len(own) and size > 0.0:
            load = (STANDARD_GRAVITY + inflation_load(model, cloth)) * weight_contrast(model, cloth)
            yield cloth, size, float(np.quantile(own, 0.1)), load


def weight_contrast(model: Model, cloth: ClothRange) -> float:
    """How many times as much as in a uniform cloth light particles have to hold, at least 1.

    A sweep hardly moves what is heavy, so what it leaves of a light particle's load grows with that load: with the mean
    areal density (mass, where there are no triangles) over the one that a tenth of the particles do not reach. As a
    pose that is stretched unevenly may look like one or two of it, 1 is taken off. A cloth of 17² vertices pinned at
    two corners, with a hem a thousand times as heavy, then had 1.4 % of mean strain in 38 steps a frame instead of
    10 % in 7, and with implicit Euler 0.4 %.
    """
    own = np.arange(cloth.start, cloth.stop)[model.particle_inv_mass.numpy()[cloth.start : cloth.stop] > 0.0]
    mass, spread = model.particle_mass.numpy()[own].astype(np.float64), np.ones(len(own))
    triangles = slice(cloth.tri_start, cloth.tri_stop)
    if cloth.tri_stop > cloth.tri_start:
        corners = model.tri_indices.numpy()[triangles]
        area = triangle_areas(model.particle_q.numpy().astype(np.float64), corners)
        shares = model.tri_corner_share.numpy()[triangles] * area[:, None]
        spread = np.bincount(corners.ravel(), shares.ravel(), cloth.stop)[own]
    if not len(own) or not (spread > 0.0).all():
        return 1.0
    return max(1.0, float(mass.sum() / spread.sum() / np.quantile(mass / spread, 0.1)) - 1.0)


def inflation_load(model: Model, cloth: ClothRange) -> float:
    """p/ρ [m/s²] of an inflated cloth, p the pressure at rest over the ambient one, ρ the areal density; else 0."""
    own = slice(cloth.tri_start, cloth.tri_stop)
    bag = int(model.tri_bag.numpy()[own].max(initial=-1))
    if bag < 0:
        return 0.0
    area = float(triangle_areas(model.particle_q.numpy().astype(np.float64), model.tri_indices.numpy()[own]).sum())
    mass = float(model.particle_mass.numpy()[cloth.start : cloth.stop].sum())
    return abs(float(model.bags["pressure"][bag])) * area / mass


def cloth_numbers(model: Model, particle: np.ndarray) -> np.ndarray:
    """Which of the model's cloths each of some particles belongs to, int."""
    return np.searchsorted([cloth.start for cloth in model.cloths], particle, side="right") - 1


def _longest_chords(slopes: np.ndarray) -> np.ndarray:
    """Of triangles along a direction [m], from the slopes [1/m] of two corners, shape [m, 2]."""
    every = np.column_stack([slopes.reshape(-1, 2), -slopes.reshape(-1, 2).sum(axis=1)])
    return np.asarray(1.0 / np.abs(every).max(axis=1))
