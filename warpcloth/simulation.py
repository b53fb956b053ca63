"""The simulation loop: forces → integrator → contact, many substeps a frame, each frame recorded once and replayed."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from . import diagnostics, stability, validate
from .air import Air
from .backup import Backup
from .contact import ContactStage
from .force_terms import airs_of, force_terms, world_gravity
from .forces import BlockMatrix, Forces, Grabs
from .forces.grabs import Hold
from .forces.user import UserForce, user_forces
from .frames import Frames
from .grab import Grab, GrabTape, make_hold
from .hooks import Hook, memory_of
from .integrators import make_integrator
from .integrators.limit_pass import LimitPass
from .kinematics import drive_pins
from .launching import copy, launch, launches, records, repeat
from .lookout import Lookout
from .model import Model, of_model
from .recording import missed_pairs, recordable_substeps
from .stability import MAX_SUBSTEPS
from .state import Memory, OnDevice, State
from .stopwatch import Stopwatch
from .untangle import untangle
from .worlds import WorldReset, take_worlds, world_mask, worlds_to_keep


class Simulation(OnDevice):
    """Advances a model in time.

    Args:
        model: what is simulated.
        integrator: name of the scheme, see ``warpcloth.integrators()``.
        integrator_options: keyword options of the scheme, such as iteration counts.
        gravity: acceleration [m/s²], shape [3], or one per world, shape [world_count, 3].
        substeps: integrator steps per call of :meth:`step`, or "auto": as few as are stable for the model at the start,
            and with contact as keep cloth from moving by more than a part of a cell at once (not explicit schemes).
        contact: "obstacles", "all" (cloth with itself, other cloth and the edges of obstacles, too), or "none".
        air: the :class:`Air` that triangles of cloth move through, or one per world; None: a vacuum.
        assembly: "scatter" or "gather", see :class:`warpcloth.forces.Springs`.
        graph: record each frame and replay it, where integrator and device can.
        check: after each frame, raise if anything is not finite, or cloth is torn to many times its length.
        forces: forces of your own, besides those of the model.
        hooks: what you do between the stages of each substep.
        untangled: try to resolve intersections at the start; what that did is in the attribute of the same name.
        profile: time the stages of each frame; it then runs without graphs, to the same result.
        check_start: refuse cloth that starts inside an obstacle or intersecting.
        threads: cores of the CPU to use; None: all, but for small models. The result is the same with any number.
            Frames with forces or hooks of yours use one, as Warp's graphs do.

    Raises:
        InputError: on unknown names or numbers out of range.
        BadStartError: a particle starts inside a solid obstacle.

    Attributes:
        state: the current :class:`State`; its arrays stay the same objects for the life of the simulation.
        forces: all :class:`Forces`.
        time: simulated time [s].
        graph, threads: whether frames are recorded, and the cores of the CPU that they run on.
        substeps: steps per frame in use; 0 before the first frame when "auto".
        watch: with ``profile``, wall times [s] of detecting, integrating, responding, guarding: ``watch.seconds``.
        lookout: what has been seen of the frames, see :class:`~warpcloth.lookout.Lookout`.
        tape: a :class:`GrabTape` of all that was done with :meth:`grab`.
    """

    @launches
    def __init__(
        self,
        model: Model,
        integrator: str = "symplectic_euler",
        gravity: Any = (0.0, 0.0, -9.81),
        substeps: int | str = "auto",
        *,
        integrator_options: Mapping[str, Any] | None = None,
        contact: str = "obstacles",
        air: Air | Sequence[Air] | None = None,
        assembly: str = "scatter",
        graph: bool = True,
        check: bool = True,
        profile: bool = False,
        untangled: bool = False,
        forces: Sequence[UserForce] = (),
        hooks: Sequence[Hook] = (),
        check_start: bool = True,
        threads: int | None = None,
    ):
        self.model = validate.instance(model, Model, "Model")
        self.hooks = of_model(model, validate.instances(hooks, Hook, "hooks"))
        own = of_model(model, user_forces(forces))
        self.integrator = make_integrator(integrator, model, integrator_options)
        self.watch = Stopwatch(model.device, validate.flag(profile, "profile"))
        replay = validate.flag(graph, "graph") and self.integrator.capturable and not self.watch.active
        self._frames = Frames(model, replay, not all(map(records, (*self.hooks, *own))), threads)
        self._airs = airs_of(model, air)
        terms = force_terms(model, self.integrator, assembly, self._airs, self._frames.threads)
        self.forces = Forces(model, terms, world_gravity(model, gravity))
        passes = model.limits_strain and self.integrator.solves_springs_only
        self._limit_pass = LimitPass(model) if passes else None
        self.contact = ContactStage(model, contact, self.integrator.contact_share, self._frames.threads)
        if self.contact.support is not None:
            self.forces.terms.append(self.contact.support)
        self.forces.terms += own
        if self.integrator.linearizes:
            matrix = BlockMatrix(model, self.forces.terms)
            self.forces.blocks = matrix if matrix.terms else None
        self.state = State.of(model)
        drive_pins(model, self.state.world_time, 0.0, self.state.particle_q, self.state.particle_qd)
        self._other = self.state.twin()
        self._memory = [item for own in self._memories() for item in own]
        self._backup = Backup(self.state, self._memory, self.integrator, self.contact, self._frames)
        self._auto = isinstance(substeps, str)
        self._pace: stability.Pace | None = None
        if self._auto:
            validate.choice(substeps, ("auto",), "substeps")
        self.substeps = 0 if self._auto else validate.integer(substeps, "substeps", minimum=1, maximum=MAX_SUBSTEPS)
        self.graph, self.threads = self._frames.replay, self._frames.threads
        self.check = validate.flag(check, "check")
        self.time, self.tape = 0.0, GrabTape()
        self._grabs: Grabs | None = None
        self.lookout = Lookout(model, self.integrator, self.contact)
        self.untangled = untangle(model, self.state) if validate.flag(untangled, "untangled") else None
        self._reset = WorldReset(model, self.state)
        if validate.flag(check_start, "check_start"):
            diagnostics.check_start_for(contact, model, self.state, self.untangled)

    @launches
    def step(self, dt: float) -> None:
        """One frame of dt [s] in ``substeps`` equal steps.

        While the caller captures a graph on the model's device the frame is recorded there, and does not happen before
        that graph is launched; see :meth:`verify`.

        Raises:
            InputError: dt is not a positive number, or the frame cannot be recorded.
            SimulationError: automatic substeps would be too many, or the integrator cannot go on: there was no frame.
            DivergedError: (when ``check``) something is not finite, or cloth is torn; ``state`` is what came out.

        Warns:
            StabilityWarning: the given ``substeps`` are too few for the integrator; named are those that would do.
        """
        dt = validate.number(dt, "dt", above=0.0, maximum=1e3)
        if self.model.device.is_capturing:
            self._frame(dt, recordable_substeps(self.model, self.integrator, self.substeps))
            return
        if self._auto:
            self.substeps = self._stable_substeps(dt)
        else:
            self.lookout.warn_if_unstable(self.state, dt, self.substeps, self._airs)
        if self._grabs is not None:
            self._grabs.begin_frame(self.state, dt, dt / self.substeps)
        key = (dt, self.substeps)
        self._backup.attempt(lambda: self._frames.run(key, lambda: self._frame(*key)))
        if self._grabs is not None:
            self._grabs.end_frame()
        self.time += dt
        if self.check:
            self.lookout.look(self._backup.before, self.state, self.time, dt, self.substeps)

    @launches
    def reset(self, worlds: Any = None) -> None:
        """Puts worlds back to their start: particles, clock, and what schemes and forces remember.

        Launches kernels only, but for ``check``, which reads the mask. ``time`` goes on, for it is that of no world.
        Without ``worlds`` all starts again: ``time`` at 0, another ``tape``, automatic substeps for the model as it is.

        Args:
            worlds: which ones: bool, shape [world_count], a Warp array on the model's device or anything like one;
                None: all.

        Raises:
            InputError: another shape, dtype or device.
        """
        mask = world_mask(worlds, self.model)
        self._reset.apply(mask, self._memory)
        if worlds is None:
            self.integrator.reset()
            self.time, self.tape, self._pace = 0.0, self.tape.begun_again(), None
        if self.check and not self.model.device.is_capturing:
            self.lookout.rest_since[mask.numpy()] = np.inf

    @launches
    def verify(self) -> None:
        """Call it now and then while you replay frames from a graph of your own; it brings ``time`` up to date, by the
        clock of the world that has gone on longest since its reset.

        Raises:
            SimulationError: contact needed more memory than it had, so pairs were missed.
            DivergedError: the integrator moved cloth absurdly far.
        """
        if self.contact.grow():
            self._frames.forget()
            raise missed_pairs()
        self.time = max(self.time, float(self.state.world_time.numpy().max()))

    @launches
    def substep(self, dt: float) -> None:
        """One step of the integrator, dt [s], without what :meth:`step` does for whole frames: no automatic substeps,
        no checks, no contact among cloths; ``time`` stays, the worlds' clocks go on. For gradients."""
        dt = validate.number(dt, "dt", above=0.0, maximum=1e3)
        self._prepare()
        self._substep(self.state, self._other, dt, among_cloths=False)
        self._end(self._other)

    def substeps_for(self, dt: float) -> int:
        """How many substeps a frame of dt [s] from here takes."""
        dt = validate.number(dt, "dt", above=0.0, maximum=1e3)
        return self._stable_substeps(dt) if self._auto else self.substeps

    def run(self, frames: int, fps: float = 60.0, on_frame: Callable[["Simulation", int], None] | None = None) -> None:
        """``frames`` frames of 1/fps [s]; ``on_frame(simulation, number)`` after each, numbers from 1."""
        dt = 1.0 / validate.number(fps, "fps", minimum=1e-3)
        look = validate.function(on_frame, "on_frame") or (lambda *_: None)
        for number in range(1, validate.integer(frames, "frames", minimum=0, maximum=10**9) + 1):
            self.step(dt)
            look(self, number)

    @launches
    def grab(self, what: Any, stiffness: float | None = None) -> Grab:
        """Takes hold of a point of the cloth with a damped spring; ``.move(target)`` leads it, ``.release()`` lets go.

        Call it and its methods between frames. A pinned particle stays where it is.

        Args:
            what: number of a particle, or a ray (origin, direction) [m], as from a mouse, for the first cloth on it.
            stiffness: [N/m]; by default what holds the weight of all cloth 2 cm below the target. Explicit and
                position-based integrators soften what is stiffer than their steps can carry, of all grabs together.

        Raises:
            InputError: no such particle, no cloth on the ray, a stiffness not above 0, or 32 grabs already.
        """
        return self.grab_hold(*make_hold(self.model, self.state.particle_q.numpy(), what, stiffness))

    @launches
    def grab_hold(self, hold: Hold, target: Any) -> Grab:
        """Like :meth:`grab`, of a point given by particles and weights, led to ``target`` [m] from the start."""
        if self._grabs is None:
            scheme = self.integrator
            self._grabs = Grabs(self.model, not (scheme.implicit or scheme.adaptive) or scheme.solves_springs_only)
            self.forces.terms.append(self._grabs)
            self._frames.forget()
        return Grab(self, self._grabs, hold, validate.vector(target, "target"))

    @launches
    def energy(self) -> dict[str, float]:
        """Energies of all worlds [J]: kinetic, spring, bending, gravity (zero at the origin), total."""
        energies = {"kinetic": diagnostics.kinetic_energy(self.model, self.state), **self.forces.energy(self.state)}
        return {**energies, "total": sum(energies.values())}

    @launches
    def metrics(self) -> dict[str, Any]:
        """Measures of the state (:func:`warpcloth.diagnostics.measure`), ``settled``, and the integrator's own."""
        measures = diagnostics.measure(self.model, self.state, self.time)
        return {**measures, "settled": self.settled, **self.contact.metrics(), **self.integrator.metrics()}

    @property
    def settled(self) -> bool:
        """Whether every world is at rest; see :meth:`settled_worlds`."""
        return bool(self.settled_worlds().all())

    def settled_worlds(self) -> np.ndarray:
        """Per world whether its particles' mean way per frame has stayed below 0.01 m/s for the last 0.25 s.

        Needs ``check``; bool, shape [world_count].
        """
        return self.lookout.settled(self.time)

    @launches
    def continue_from(self, other: "Simulation", worlds: Sequence[int]) -> None:
        """Goes on where ``other`` is with some of its worlds, each as it would there if the integrator couples none.

        Args:
            other: a simulation with the same options, hooks among them, and no grabs, between two frames.
            worlds: which worlds of ``other`` this model has, in rising order; what cannot be so is an ``InputError``.
        """
        keep = worlds_to_keep(self, validate.instance(other, Simulation, "Simulation"), worlds)
        for mine, theirs in zip(self._memories(), other._memories(), strict=True):
            # What a scheme or a force keeps may be in fewer arrays here: the last ones were of other worlds.
            take_worlds(self.state, mine, other.model, other.state, theirs, keep)
        self.time, self.substeps, self._pace = other.time, other.substeps, other._pace
        self.lookout.rest_since = other.lookout.rest_since[keep]

    def _memories(self) -> tuple[Sequence[Memory], ...]:
        return self.integrator.memory(), self.forces.memory(), self.contact.memory(), *map(memory_of, self.hooks)

    def _frame(self, dt: float, substeps: int) -> None:
        now, later = self.state, self._other
        self._prepare()

        def there_and_back() -> None:
            self._substep(now, later, dt / substeps)
            self._substep(later, now, dt / substeps)

        for length in self.contact.interval_lengths(dt, substeps):
            span = length * dt / substeps
            with self.watch.stage("detect"):
                self.contact.begin(now, span)
            repeat(length // 2, there_and_back)
            if length % 2:
                self._substep(now, later, dt / substeps)
                now, later = later, now
            with self.watch.stage("guard"):
                self.contact.end(now, span)
        self._end(now)
        self.lookout.count_torn(self.state)

    def _prepare(self) -> None:
        """Takes over what the caller may have changed since the last step: the state, and what the model has."""
        self.state.forces_current = False
        for item in (self.forces, self.integrator, self._limit_pass):
            if item is not None:
                item.prepare()

    def _end(self, end: State) -> None:
        """Puts the end of the last step into ``state``, with the forces of the latest evaluation."""
        own = self.state.particle_q, self.state.particle_qd, self.state.particle_f
        for array, source in zip(own, (end.particle_q, end.particle_qd, self.forces.latest), strict=True):
            if source is not None and source is not array:
                copy(array, source)

    def _substep(self, now: State, later: State, dt: float, among_cloths: bool = True) -> None:
        later.forces_current = False
        for hook in self.hooks:
            hook.before_step(now, dt)
        self.contact.place(now, dt)
        with self.watch.stage("integrate"):
            self.integrator.step(self.model, now, later, self.forces, dt)
            if self._limit_pass is not None:
                self._limit_pass.apply(later, dt)
        for hook in self.hooks:
            hook.after_integration(now, later, dt)
        with self.watch.stage("respond"):
            self.contact.resolve(now, later, dt, among_cloths)
        for hook in self.hooks:
            hook.after_step(now, later, dt)
        self.forces.advance(later)
        later.forces_current &= not (self.contact.acts or self.hooks)  # which change it, or will at the next step
        advance = self.model.kernels.particles.advance_time
        launch(advance, self.model.world_count, [dt], [now.world_time], self.model.device)

    def _stable_substeps(self, dt: float) -> int:
        if self._pace is None:
            self._pace = stability.pace(self.model, self.integrator, self._airs, self.forces.world_gravity.numpy())
        stable = stability.count_steps(self.integrator, self._pace.step, dt, MAX_SUBSTEPS)
        per_travel = self._pace.haste * self.integrator.steps_per_travel
        return max(stable, self.contact.fewest_substeps(dt, MAX_SUBSTEPS, per_travel))
