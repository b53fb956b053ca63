"""What differs between implicit schemes: where their stage starts from, how the step ends, what they remember."""

import sys

import warp as wp

from .conjugate_gradient import Solves
from .precision import OPTIONS, real, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.kernel
def stage_base(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    particle_f: wp.array(dtype=vec3),
    past_q: wp.array(dtype=vec3),
    past_qd: wp.array(dtype=vec3),
    dt: real,
    at_start: real,
    past: real,
    # Out
    position_base_out: wp.array(dtype=vec3),
    velocity_base_out: wp.array(dtype=vec3),
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """x̄ = x + s dt v + p (x − x₋₁), v̄ = v + s dt f/m + p (v − v₋₁); the guess is the state itself.

    Where s is 0 nobody has worked out f, which may be what a step that diverged left there.
    """
    i = thread_offset + wp.tid()
    x = particle_q[i]
    v = particle_qd[i]
    pushed = vec3()
    if at_start != real(0.0):
        pushed = at_start * dt * particle_inv_mass[i] * particle_f[i]
    position_base_out[i] = x + at_start * dt * v + past * (x - past_q[i])
    velocity_base_out[i] = v + pushed + past * (v - past_qd[i])
    particle_q_out[i] = x
    particle_qd_out[i] = v


@wp.kernel
def extrapolate(
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    beyond: real,
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """From the stage to the end of the step, in place: on by ``beyond`` times the way from the start to the stage."""
    i = wp.tid()
    particle_q_out[i] = particle_q_out[i] + beyond * (particle_q_out[i] - particle_q[i])
    particle_qd_out[i] = particle_qd_out[i] + beyond * (particle_qd_out[i] - particle_qd[i])


@wp.kernel
def find_jumps(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    end_q: wp.array(dtype=vec3),
    end_qd: wp.array(dtype=vec3),
    past_dt: wp.array(dtype=wp.float64),
    # Out
    jumped_out: wp.array(dtype=wp.int32),
):
    """1 in worlds whose state is not that at which their last step ended; ``past_dt`` is 0 where there was none."""
    i = wp.tid()
    w = particle_world[i]
    same = particle_q[i] == end_q[i] and particle_qd[i] == end_qd[i]
    if past_dt[w] > wp.float64(0.0) and not same:
        jumped_out[w] = 1


@wp.kernel
def part_worlds(
    # State in
    jumped: wp.array(dtype=wp.int32),
    # Out
    smooth_out: wp.array(dtype=wp.int32),
    any_out: wp.array(dtype=wp.int32),
):
    """Which worlds go on smoothly, and whether any does not."""
    w = wp.tid()
    smooth_out[w] = 1 - jumped[w]
    if jumped[w] == 1:
        any_out[0] = 1


@wp.kernel
def take_jumped(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    # State in
    jumped: wp.array(dtype=wp.int32),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """The state in worlds that jumped."""
    i = wp.tid()
    if jumped[particle_world[i]] == 1:
        particle_q_out[i] = particle_q[i]
        particle_qd_out[i] = particle_qd[i]


@wp.kernel
def keep_end(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    dt: wp.float64,
    # Out
    end_q_out: wp.array(dtype=vec3),
    end_qd_out: wp.array(dtype=vec3),
    past_dt_out: wp.array(dtype=wp.float64),
):
    """Keeps the end of a step of dt."""
    i = wp.tid()
    end_q_out[i] = particle_q[i]
    end_qd_out[i] = particle_qd[i]
    past_dt_out[particle_world[i]] = dt


@wp.kernel
def ask_for_start(
    # State in
    past_dt: wp.array(dtype=wp.float64),
    dt: wp.float64,
    # Out
    wanted_out: wp.array(dtype=wp.int32),
):
    """1 if any world has no past dt ago."""
    if past_dt[wp.tid()] != dt:
        wanted_out[0] = 1


@wp.kernel
def recall(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    end_q: wp.array(dtype=vec3),
    end_qd: wp.array(dtype=vec3),
    first_qd: wp.array(dtype=vec3),
    past_dt: wp.array(dtype=wp.float64),
    dt: wp.float64,
    # Out
    past_q_out: wp.array(dtype=vec3),
    past_qd_out: wp.array(dtype=vec3),
):
    """The state dt ago, as a two-step scheme needs it.

    What changed the state since the last step ended (contact, the user) did so at once, so the past is moved along: it
    becomes the past of the motion that continues from here. Without a past dt ago it is where the velocities and
    accelerations at the end of an implicit Euler step from here, whose velocities are ``first_qd``, would have come
    from: wrong by O(dt²), which keeps the order, and that step is what BDF2 then makes of it. (With accelerations at
    the start instead, which makes it the θ-scheme with θ = 2/3, cloth with waves and not at rest came to 5 m/s within a
    step, where implicit Euler has 0.3. With velocities at the start, rough motion that is damped within a step still
    went on for a third of it: the energy of cloth grew 80-fold.)
    """
    i = wp.tid()
    h = real(dt)
    if past_dt[particle_world[i]] == dt:
        jump = particle_qd[i] - end_qd[i]
        past_q_out[i] = past_q_out[i] + (particle_q[i] - end_q[i]) - h * jump
        past_qd_out[i] = past_qd_out[i] + jump
    else:
        past_q_out[i] = particle_q[i] - h * first_qd[i]
        past_qd_out[i] = real(2.0) * particle_qd[i] - first_qd[i]


@wp.kernel
def remember(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    later_q: wp.array(dtype=vec3),
    later_qd: wp.array(dtype=vec3),
    dt: wp.float64,
    # Out
    past_q_out: wp.array(dtype=vec3),
    past_qd_out: wp.array(dtype=vec3),
    end_q_out: wp.array(dtype=vec3),
    end_qd_out: wp.array(dtype=vec3),
    past_dt_out: wp.array(dtype=wp.float64),
):
    """Keeps the start and the end of the step for the next one, and in each world its dt."""
    i = wp.tid()
    past_q_out[i] = particle_q[i]
    past_qd_out[i] = particle_qd[i]
    end_q_out[i] = later_q[i]
    end_qd_out[i] = later_qd[i]
    past_dt_out[particle_world[i]] = dt


@wp.kernel
def pin_changes(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    later_q: wp.array(dtype=vec3),
    later_qd: wp.array(dtype=vec3),
    dt: real,
    # Out
    velocity_out: wp.array(dtype=vec3),
    change_out: wp.array(dtype=vec3),
):
    """Known part of the velocities over a step: v of free particles, the mean of driven ones; known changes of v."""
    i = thread_offset + wp.tid()
    if particle_inv_mass[i] > real(0.0):
        velocity_out[i] = particle_qd[i]
        change_out[i] = vec3()
    else:
        velocity_out[i] = (later_q[i] - particle_q[i]) / dt
        change_out[i] = later_qd[i] - particle_qd[i]


@wp.kernel
def linear_residual(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_f: wp.array(dtype=vec3),
    dt: real,
    # Out
    residual_out: wp.array(dtype=vec3),
):
    """Completes −dt f + dt² K v + dt C Δv, whose products are there already; 0 for pinned particles."""
    i = thread_offset + wp.tid()
    if particle_inv_mass[i] > real(0.0):
        residual_out[i] = residual_out[i] - dt * particle_f[i]
    else:
        residual_out[i] = vec3()


@wp.kernel
def apply_change(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    change: wp.array(dtype=vec3),
    dt: real,
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """v ← v + Δv, x ← x + dt v with the new v, for free particles."""
    i = thread_offset + wp.tid()
    if particle_inv_mass[i] > real(0.0):
        v = particle_qd[i] + change[i]
        particle_qd_out[i] = v
        particle_q_out[i] = particle_q[i] + dt * v


@wp.kernel
def count_solves(
    # State in
    solves: Solves,
    max_iterations: wp.int32,
    # Out
    total_out: wp.array(dtype=wp.int64),
    failures_out: wp.array(dtype=wp.int32),
):
    """Adds up the iterations of linear solves, and those that ended before they were accurate."""
    w = wp.tid()
    total_out[w] = total_out[w] + wp.int64(solves.iterations[w])
    if solves.iterations[w] >= max_iterations:
        failures_out[w] = failures_out[w] + 1
