"""A Newton solver for particles and springs, with any of our integrators."""

import operator
from collections.abc import Mapping
from typing import Any

import newton
import numpy as np
import warp as wp
from newton import ModelFlags, StateFlags

from ... import stability, validate
from ...contact import ContactPlanes
from ...errors import InputError, NotDifferentiableError
from ...forces import AppliedForce, Forces, Springs
from ...integrators import make_integrator
from ...stability import MAX_SUBSTEPS
from ...state import Memory, State
from ...worlds import WorldRows
from .network import Network


class SolverMassSpring(newton.solvers.SolverBase):
    """Steps the particles and springs of a Newton model, in Newton's own arrays.

    ``state_in.particle_f`` acts on the particles, and is left as it is. Gravity of each world, particle flags and the
    soft contacts of ``contacts`` are read anew in each step; contacts do not let particles in and have Coulomb friction
    that holds what should stick, with the mean of both coefficients, whatever Newton's stiffness of contacts is.
    Particles without mass go on at their velocity.

    Not simulated: triangles, edges and tetrahedra (only springs hold particles together), contacts of edges and faces,
    contact among particles, ``particle_max_velocity``. Bodies and joints are left where they are: they move cloth but
    are not moved by it. Steps have no gradients; where a tape would want them, :meth:`step` says so.

    Args:
        model: the Newton model.
        integrator: name of the scheme, see ``warpcloth.integrators()``.
        integrator_options: its keyword options.
        substeps: steps of the integrator in each :meth:`step`; contacts and ``particle_f`` are the same in all of them.
        assembly: "scatter" or "gather", see :class:`warpcloth.forces.Springs`.

    Raises:
        InputError: a model without particles, springs that cannot be, unknown names, numbers out of range.
    """

    def __init__(
        self,
        model: newton.Model,
        integrator: str = "symplectic_euler",
        *,
        integrator_options: Mapping[str, Any] | None = None,
        substeps: int = 1,
        assembly: str = "scatter",
    ):
        if not isinstance(model, newton.Model):
            raise InputError(f"Model must be a newton.Model, got {type(model).__name__}.")
        super().__init__(model=model)
        self.network = network = Network(model)
        self.substeps = validate.integer(substeps, "substeps", minimum=1, maximum=MAX_SUBSTEPS)
        self._applied = AppliedForce(network)
        self._springs = Springs(network, assembly)
        self.forces = Forces(network, [self._springs, self._applied], model.gravity)
        self.integrator = make_integrator(integrator, network, integrator_options)
        start = State.of(network)
        self.world_time = start.world_time
        self._force, self._scratch = start.particle_f, [start.twin(), start.twin()]
        self._planes: ContactPlanes | None = None
        self._bodies = [name for name in ("body_q", "body_qd", "joint_q", "joint_qd") if getattr(model, name)]
        self._rows = WorldRows(network)
        self._memory = [*self.integrator.memory(), Memory(self.world_time, None)]

    def step(
        self,
        state_in: newton.State,
        state_out: newton.State,
        control: newton.Control | None,
        contacts: newton.Contacts | None,
        dt: float,
        *,
        observables: newton.solvers.SolverBase.Observables | None = None,
    ) -> None:
        """One step of dt [s] from ``state_in`` to ``state_out``, which must be two; ``control`` has no effect.

        Launches kernels only (unless the scheme is adaptive), once there have been contacts of that size before.

        Raises:
            InputError: dt is not a positive number, contacts are none, or arrays of the states do not fit the model.
            NotDifferentiableError: a tape records, and something of the model or of ``state_in`` requires gradients.
        """
        if not isinstance(contacts, newton.Contacts | None):
            raise InputError(f"Contacts must be newton.Contacts or None, got {type(contacts).__name__}.")
        self.validate_observables(observables, contacts)
        dt = validate.number(dt, "dt", above=0.0, maximum=1e3)
        now, end = self._particles(state_in, "state_in"), self._particles(state_out, "state_out")
        if now.particle_q.ptr == end.particle_q.ptr:
            raise InputError("state_in and state_out must be two states, got one and the same.")
        self._check_bodies(state_in, "state_in")
        self._check_bodies(state_out, "state_out")
        _check_no_gradients(self.model, state_in)
        self._applied.force = self._array(state_in.particle_f, "state_in.particle_f")
        self.network.refresh_flags()
        planes = None if contacts is None else self._listed(state_in, contacts)
        h = dt / self.substeps
        for k in range(self.substeps):
            later = end if k + 1 == self.substeps else self._scratch[k % 2]
            self._substep(now, later, h, planes, k * h)
            now = later
        self._pass_bodies(state_in, state_out)

    def reset(
        self,
        state: newton.State,
        world_mask: wp.array | None = None,
        flags: StateFlags | int | None = None,
    ) -> None:
        """Puts particles of ``state`` back to those of the model, and forgets what the scheme remembers of them.

        Args:
            state: the state, changed in place.
            world_mask: which worlds, bool, shape [world_count + 1], the last for particles of no world; None: all.
            flags: which of ``PARTICLE_Q`` and ``PARTICLE_QD`` to put back, as any combination of Newton's flags; None:
                both. Memory is forgotten regardless.

        Raises:
            InputError: the state is none of this model, the mask has another shape, dtype or device, or flags are no
                integer.
        """
        now = self._particles(state, "state")
        count, network = self.model.world_count + 1, self.network
        if world_mask is None:
            world_mask = wp.ones(count, dtype=wp.bool, device=network.device)
        mask = validate.device_array(world_mask, "world_mask", wp.bool, (count,), network.device)
        wanted = StateFlags.ALL if flags is None else _bits(flags, "newton.StateFlags.PARTICLE")
        mask = network.local_mask(mask)
        for flag, start, array in (
            (StateFlags.PARTICLE_Q, network.particle_q, now.particle_q),
            (StateFlags.PARTICLE_QD, network.particle_qd, now.particle_qd),
        ):
            if wanted & flag:
                self._rows.restore(mask, start, array)
        self._rows.clear(mask, self._memory)

    def notify_model_changed(self, flags: ModelFlags | int) -> None:
        """With ``MODEL_PROPERTIES``, springs are read anew; masses, flags, gravity and contacts always are.

        Graphs that have been captured go on with what has changed, but where the first damping comes or the last goes:
        then capture anew. What the scheme remembers stays.

        Raises:
            InputError: flags are no integer.
        """
        if _bits(flags, "newton.ModelFlags.MODEL_PROPERTIES") & ModelFlags.MODEL_PROPERTIES:
            self.network.refresh()
            self.forces.prepare()
            self.integrator.prepare()
            self._springs.velocity_dependent = bool(self.network.spring_damping.numpy().any())

    def stable_step(self) -> float:
        """Largest step [s] that the integrator can safely take, whatever the springs' directions; maybe infinite."""
        return stability.largest_stable_step(self.network, self.integrator)

    def _substep(self, now: State, later: State, h: float, planes: ContactPlanes | None, elapsed: float) -> None:
        network, source = self.network, self.model
        kernels, count, led = network.kernels.newton_particles, network.particle_count, network.led_pins
        now.forces_current = False
        inputs = [source.particle_flags, source.particle_inv_mass, now.particle_q, now.particle_qd]
        wp.launch(kernels.lead_kinematic, count, inputs, [led.place, led.velocity], device=network.device)
        self.integrator.step(network, now, later, self.forces, h)
        inputs = [source.particle_flags, now.particle_qd]
        wp.launch(kernels.keep_velocities, count, inputs, [later.particle_qd], device=network.device)
        if planes is not None:
            planes.respond(now, later, h, elapsed)
        wp.launch(
            network.kernels.particles.advance_time,
            dim=network.world_count,
            inputs=[h],
            outputs=[self.world_time],
            device=network.device,
        )

    def _particles(self, state: newton.State, what: str) -> State:
        """The state's own arrays, with our force and clock."""
        if not isinstance(state, newton.State):
            raise InputError(f"{what} must be a newton.State, got {type(state).__name__}.")
        q = self._array(state.particle_q, f"{what}.particle_q")
        return State(q, self._array(state.particle_qd, f"{what}.particle_qd"), self._force, self.world_time)

    def _array(self, array: wp.array, what: str) -> wp.array:
        return validate.device_array(array, what, wp.vec3, (self.network.particle_count,), self.network.device)

    def _check_bodies(self, state: newton.State, what: str) -> None:
        for name in self._bodies:
            own = getattr(self.model, name)
            validate.device_array(getattr(state, name), f"{what}.{name}", own.dtype, own.shape, own.device)

    def _pass_bodies(self, state_in: newton.State, state_out: newton.State) -> None:
        """Bodies and joints end where they began."""
        for name in self._bodies:
            start, end = getattr(state_in, name), getattr(state_out, name)
            if start.ptr != end.ptr:
                wp.copy(end, start)

    def _listed(self, state: newton.State, contacts: newton.Contacts) -> ContactPlanes | None:
        """Newton's contacts of particles as planes; None where there can be none."""
        source, network = self.model, self.network
        if contacts.soft_contact_max == 0 or source.shape_count == 0:
            return None
        if self._planes is None or self._planes.capacity != contacts.soft_contact_max:
            self._planes = ContactPlanes(network, contacts.soft_contact_max)
        wp.launch(
            network.kernels.newton_particles.planes_of_contacts,
            dim=contacts.soft_contact_max,
            inputs=[
                source.body_com, source.shape_body, source.shape_material_mu, source.shape_margin,
                network.particle_count, source.soft_contact_mu, state.body_q, state.body_qd,
                contacts.soft_contact_count, contacts.soft_contact_particle, contacts.soft_contact_shape,
                contacts.soft_contact_body_pos, contacts.soft_contact_body_vel, contacts.soft_contact_normal,
            ],
            outputs=[self._planes.planes],
            device=network.device,
        )  # fmt: skip
        wp.copy(self._planes.count, contacts.soft_contact_count)
        self._planes.list_all()
        return self._planes


def _check_no_gradients(model: newton.Model, state: newton.State) -> None:
    """A tape would go back through the step without a word, and find gradients of 0."""
    runtime: Any = wp._src.context.runtime
    if runtime.tape is None:
        return
    arrays = (*vars(model).values(), *vars(state).values())
    if model.requires_grad or any(isinstance(array, wp.array) and array.requires_grad for array in arrays):
        raise NotDifferentiableError(
            "SolverMassSpring has no gradients, but a tape records and the model or state_in requires them; step "
            "outside the tape, or take derivatives of a warpcloth.Simulation with warpcloth.gradients.Rollout."
        )


def _bits(flags: Any, example: str) -> int:
    """Newton's flags as an int, which combinations of them are."""
    try:
        if isinstance(flags, bool | np.bool_):
            raise TypeError
        return operator.index(flags)
    except TypeError:
        raise InputError(f"Flags must be an integer, such as {example}, got {validate.shown(flags)}.") from None
