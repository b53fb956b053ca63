"""A stretch of a simulation as a function with derivatives."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from .. import validate
from ..errors import DivergedError, InputError
from ..launching import launch, launches, launches_alone
from ..simulation import Simulation
from ..state import State
from .contact import record_response
from .parameters import check_differentiable, find_parameters, record_derived
from .recording import Recording
from .snapshots import Snapshots
from .steps import fresh_state, recorded_step

FARTHEST = 1e6  # [m] that anything may be off the origin


class Rollout:
    """``frames`` frames of a simulation from where it is now, again and again, and derivatives of what they lead to.

    Derivatives are exact, those of the steps taken: each step is done once more under a tape on the way back. All that
    is kept of the way there are the states at the starts of segments of about √steps steps, so that memory grows with
    the square root of their number. The way back costs about five times the way there.

    Friction, bouncing and contact have kinks; at those, derivatives are the ones of the side that was taken.

    Args:
        simulation: of a model built with ``differentiable=True``; it is worked with from here on. Its time, what it
            remembers and ``substeps`` are taken as they are; with "auto", those for the present parameters.
        frames: how many, at least 1. fps: frames per second [1/s].
        observe: numbers of the frames, from 1, after which the loss may look at the state; None: all.
        segment: steps between kept states; None: about √steps. Of 1, every state is kept.

    Raises:
        NotDifferentiableError: a part of the simulation has no gradients; the sentence says which.
        InputError: a number out of range, or two parameters of one name, as those of two ``AppliedForce`` are.

    Attributes:
        start: the :class:`~warpcloth.State` to start from. Positions and velocities may be written to.
        states: the states after the observed frames, in order; ``end`` is the last of them.
        parameters: arrays of the simulation that its motion depends on, by name; may be written to, but for signs
            and zeros of masses and damping. ``particle_mass`` [kg], ``gravity`` [m/s²] of each world, and what
            the forces and obstacles of the simulation have: ``spring_stiffness`` [N], ``spring_damping`` [N s],
            ``spring_rest_length`` [m]; ``woven_stiffness`` [J] of each woven triangle along warp, weft and ±45°;
            ``bend_law`` (stiffness [N m³], stiffness times damping time [N m³ s], rest
            curvature [1/m]) of each element; ``wind`` [m/s], ``air_density`` [kg/m³], ``tri_air_drag``,
            ``tri_air_friction``; ``particle_friction``, ``obstacle_friction``, ``obstacle_restitution``; ….
        steps: substeps in all.
    """

    @launches
    def __init__(
        self,
        simulation: Simulation,
        frames: int,
        fps: float = 60.0,
        *,
        observe: Sequence[int] | None = None,
        segment: int | None = None,
    ):
        check_differentiable(simulation)
        self.simulation, self.model = simulation, simulation.model
        self.frames = validate.integer(frames, "frames", minimum=1, maximum=10**9)
        self._frame_dt = 1.0 / validate.number(fps, "fps", minimum=1e-3)
        self.substeps = simulation.substeps_for(self._frame_dt)
        self.steps, self._dt = self.frames * self.substeps, self._frame_dt / self.substeps
        self.segment = math.isqrt(self.steps - 1) + 1
        if segment is not None:
            self.segment = validate.integer(segment, "segment", minimum=1, maximum=self.steps)
        self.parameters = find_parameters(simulation)
        numbers = (
            range(1, self.frames + 1) if observe is None else validate.array(observe, "observe", (None,), int).tolist()
        )
        wanted = [validate.integer(k, "observe", minimum=1, maximum=self.frames) for k in numbers]
        if not wanted or wanted != sorted(set(wanted)):
            raise InputError(f"observe must be frame numbers in rising order, at least one, got {wanted}.")
        self.start = fresh_state(simulation.state)
        self.states = [fresh_state(simulation.state) for _ in wanted]
        self._observed = dict(zip(wanted, self.states, strict=True))
        self._derived: wp.Tape | None = None
        self._forwards = 0
        self._make_snapshots()

    @property
    def end(self) -> State:
        """The last observed state."""
        return self.states[-1]

    @property
    def kept_states(self) -> int:
        """How many states there is memory for, besides ``start`` and ``states``."""
        return self._checkpoints.count + self._within.count

    @property
    def gradients(self) -> dict[str, wp.array]:
        """Gradients with respect to ``particle_q`` and ``particle_qd`` of the start, and to all parameters, by name.

        They are the ``grad`` of these arrays, and so have their shapes and types.
        """
        of_start = {"particle_q": self.start.particle_q, "particle_qd": self.start.particle_qd}
        return {name: array.grad for name, array in (of_start | self.parameters).items()}

    @launches_alone
    def forward(self, tape: wp.Tape | None = None) -> list[State]:
        """Simulates from ``start``, with the parameters as they are, and returns ``states``.

        Args:
            tape: where to note this, so that ``tape.backward(loss)`` goes back through it: call it where the launches
                that it follows have been recorded, and those that use ``states`` have not, outside ``with tape:``.
                Gradients then add up, as they do on tapes, until ``tape.zero()``. There is memory for one way: go back
                before the next ``forward``.

        Raises:
            DivergedError: something is no longer finite, or more than 1000 km off.
            InputError: a tape is recording, or ``tape`` is none.
            NotDifferentiableError: the simulation has got something without gradients, such as a grab.

        Warns:
            StabilityWarning: the simulation's ``substeps`` are too few for its integrator and the present parameters.
        """
        _check_no_tape_records()
        if tape is not None and not isinstance(tape, wp.Tape):
            raise InputError(f"Tape must be a warp.Tape, got {type(tape).__name__}.")
        simulation, self._derived = self.simulation, None
        self._forwards += 1
        check_differentiable(simulation)
        simulation.lookout.warn_if_unstable(self.start, self._frame_dt, self.substeps, simulation._airs)
        simulation.lookout.rest_since[:] = np.inf  # of where it was before, and of frames that nobody looks at
        self._origin.put(0)
        simulation.state.particle_q.assign(self.start.particle_q)
        simulation.state.particle_qd.assign(self.start.particle_qd)
        self._given.take(0)
        derived = record_derived(simulation)
        for first in range(0, self.steps, self.segment):
            self._checkpoints.take(first // self.segment)
            self._march(first, min(first + self.segment, self.steps), None)
        simulation.time = self._start_time + self.frames * self._frame_dt
        if not np.abs(self.end.particle_q.numpy()).max(initial=0.0) < FARTHEST:
            raise DivergedError(
                f"The roll-out has positions that are not finite, or far off, after {self.steps} steps; "
                "take more substeps."
            )
        for state in self.states:
            _zero_gradients(state)
        self._derived = derived
        if tape is not None:
            arrays = [self.start, *self.states]
            own = [array for state in arrays for array in (state.particle_q, state.particle_qd)]
            tape.record_func(partial(self._go_back, self._forwards), [*own, *self.parameters.values()])
        return self.states

    @launches_alone
    def backward(self, particle_q: Any = None, particle_qd: Any = None) -> dict[str, wp.array]:
        """Gradients of a loss of which those with respect to ``states`` are given; after :meth:`forward`, and before
        parameters are written to. The simulation stays where it is.

        Args:
            particle_q, particle_qd: with respect to the positions and velocities of ``end``, shape
                [particle_count, 3], None: zero. Without both, they are taken from ``particle_q.grad`` and
                ``particle_qd.grad`` of all ``states``.

        Returns:
            :attr:`gradients`, of this loss alone.

        Raises:
            InputError: there has been no :meth:`forward` that came to its end, a parameter is not what it was in it, a
                tape is recording, or arrays have other shapes.
        """
        for gradient in self.gradients.values():
            gradient.zero_()
        if particle_q is not None or particle_qd is not None:
            for state in self.states:
                _zero_gradients(state)
            shape = (self.model.particle_count, 3)
            for name, given in (("particle_q", particle_q), ("particle_qd", particle_qd)):
                if given is not None:
                    values = given.numpy() if isinstance(given, wp.array) else given
                    getattr(self.end, name).grad.assign(validate.array(values, name, shape))
        self._go_back(self._forwards)
        return self.gradients

    def _make_snapshots(self) -> None:
        """Memory for states on the way: at the starts of segments, within one of them, and the very first."""
        simulation = self.simulation
        memory = [*simulation.integrator.memory(), *simulation.forces.memory()]
        self._memory = [item.array for item in memory]
        state = simulation.state
        arrays = [state.particle_q, state.particle_qd, state.world_time, *self._memory]
        self._checkpoints = Snapshots(arrays, -(-self.steps // self.segment))
        self._within = Snapshots(arrays, self.segment)
        self._origin = Snapshots(arrays, 1)
        self._origin.take(0)
        self._present = Snapshots([*arrays, state.particle_f], 1)
        self._given = Snapshots(list(self.parameters.values()), 1)
        self._start_time = simulation.time
        self._passed_on = [array for array in self._memory if array.requires_grad]  # guesses of solvers are not
        self._lasting = [*self.parameters.values(), self.model.particle_inv_mass, *self._passed_on]

    def _march(self, first: int, last: int, kept: Snapshots | None) -> None:
        """Substeps ``first`` to ``last`` from the state of the simulation; ``kept`` takes what each begins with."""
        simulation = self.simulation
        for k in range(first, last):
            if kept is not None:
                kept.take(k - first)
            simulation.substep(self._dt)
            frame = (k + 1) // self.substeps
            if kept is None and (k + 1) % self.substeps == 0 and frame in self._observed:
                self._observed[frame].copy_from(simulation.state)

    @launches_alone
    def _go_back(self, forward: int) -> None:
        """Adds to the gradients what those of the observed states lead to, and leaves the simulation where it is.

        Args:
            forward: number of the call of :meth:`forward` that is to be gone back through.
        """
        _check_no_tape_records()
        if forward != self._forwards:
            raise InputError(
                "Rollout.forward has been called again since this tape noted it; go back after each, with a tape for "
                "each, or make a Rollout for each start."
            )
        if self._derived is None:
            raise InputError("There is nothing to go back through yet; call Rollout.forward first.")
        changed = self._given.changed(0)
        if changed:
            name = list(self.parameters)[changed[0]]
            raise InputError(f"Parameter '{name}' has changed since Rollout.forward; call that again, then go back.")
        self._present.take(0)
        try:
            self._add_gradients()
        finally:
            self._present.put(0)

    def _add_gradients(self) -> None:
        assert self._derived is not None
        for array in self._passed_on:
            array.grad.zero_()
        behind = fresh_state(self.start)
        _zero_gradients(behind)
        for number in reversed(range(self._checkpoints.count)):
            first = number * self.segment
            last = min(first + self.segment, self.steps)
            self._checkpoints.put(number)
            self._march(first, last, self._within)
            for k in reversed(range(first, last)):
                self._within.put(k - first)
                behind = self._step_back(k, behind)
        self._add(behind.particle_q.grad, self.start.particle_q.grad)
        self._add(behind.particle_qd.grad, self.start.particle_qd.grad)
        self._derived.backward()

    def _step_back(self, k: int, behind: State) -> State:
        """The start of substep k, with gradients, from those of its end in ``behind``."""
        simulation, model = self.simulation, self.model
        start, end = fresh_state(simulation.state), fresh_state(simulation.state)
        recording = Recording(simulation.forces, [*self._lasting, start.particle_q])
        simulation.contact.place(start, self._dt)
        recorded_step(simulation.integrator)(recording, simulation.integrator, model, start, end, self._dt)
        if simulation.contact.obstacles is not None:
            record_response(recording, simulation.contact, start, end, self._dt)
        memory = [item.array for item in simulation.forces.memory()]
        if memory:
            recording.in_place(lambda: simulation.forces.advance(end), memory)
        wp.copy(end.particle_q.grad, behind.particle_q.grad)
        wp.copy(end.particle_qd.grad, behind.particle_qd.grad)
        observed = self._observed.get((k + 1) // self.substeps) if (k + 1) % self.substeps == 0 else None
        if observed is not None:
            self._add(observed.particle_q.grad, end.particle_q.grad)
            self._add(observed.particle_qd.grad, end.particle_qd.grad)
        recording.backward()
        return start

    def _add(self, addend: wp.array, total: wp.array) -> None:
        kernel = self.model.kernels.particles.add_force
        launch(kernel, dim=len(total), inputs=[addend], outputs=[total], device=self.model.device)


def _zero_gradients(state: State) -> None:
    state.particle_q.grad.zero_()
    state.particle_qd.grad.zero_()


def _check_no_tape_records() -> None:
    try:
        with wp.Tape():
            pass
    except RuntimeError as error:
        raise InputError(
            "A tape is recording; leave its `with` block first, and give the tape to Rollout.forward."
        ) from error
