"""One implicit stage by Newton's method: M (v − v̄) = γ f(x̄ + γ v, v) for the velocity v, a problem per world.

Every implicit scheme here is such a stage with its own x̄, v̄, γ. Lanes and solves: see ``conjugate_gradient.py``.
"""

import sys

import warp as wp

from .conjugate_gradient import Lanes, Solves, world_sum
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

FADE = wp.constant(0.5)


@wp.struct
class Worlds:
    """Newton's method in each world: is it still at work, its iterations, the latest update (root mean square [m/s])
    with its step length, and the update that is small enough; for the next one the accuracy of the linear solve, and
    whether the matrix is projected; mass and number of its free particles, over which updates are averaged; totals over
    all steps; and how many worlds are at work or searching."""

    active: wp.array(dtype=wp.int32)
    searching: wp.array(dtype=wp.int32)
    iterations: wp.array(dtype=wp.int32)
    cg_iterations: wp.array(dtype=wp.int32)
    update: wp.array(dtype=wp.float64)
    step: wp.array(dtype=wp.float64)
    tolerance: wp.array(dtype=wp.float64)
    forcing: wp.array(dtype=wp.float64)
    project: wp.array(dtype=real)
    mass: wp.array(dtype=wp.float64)
    count: wp.array(dtype=wp.float64)
    converged: wp.array(dtype=wp.int32)
    newton_total: wp.array(dtype=wp.int64)
    cg_total: wp.array(dtype=wp.int64)
    failures: wp.array(dtype=wp.int32)
    at_work: wp.array(dtype=wp.int32)
    at_search: wp.array(dtype=wp.int32)


@wp.kernel
def survey(
    # Model
    thread_offset: int,
    lanes: Lanes,
    particle_mass: wp.array(dtype=real),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    reach_out: wp.array(dtype=wp.float64),
    mass_out: wp.array(dtype=wp.float64),
    count_out: wp.array(dtype=wp.float64),
):
    """The largest coordinate [m] of each lane, which tells how positions are rounded; mass [kg] and number of its free
    particles, which may be others than in the step before."""
    lane = thread_offset + wp.tid()
    most = real(0.0)
    mass = wp.float64(0.0)
    count = wp.float64(0.0)
    for i in range(lanes.particle_start[lane], lanes.particle_end[lane]):
        x = particle_q[i]
        for axis in range(3):
            most = wp.max(most, wp.abs(x[axis]))
        if particle_inv_mass[i] > real(0.0):
            mass += wp.float64(particle_mass[i])
            count += wp.float64(1.0)
    reach_out[lane] = wp.float64(most)
    mass_out[lane] = mass
    count_out[lane] = count


@wp.kernel
def start_worlds(
    # Model
    lanes: Lanes,
    # State in
    takes_part: wp.array(dtype=wp.int32),
    reach: wp.array(dtype=wp.float64),
    mass: wp.array(dtype=wp.float64),
    count: wp.array(dtype=wp.float64),
    tolerance: wp.float64,
    rounding: wp.float64,
    loosest: wp.float64,
    # Out
    worlds_out: Worlds,
):
    """Worlds at work are those that take part, of the others nothing is touched; ``at_work`` must be 0 before.

    Updates [m/s] are small enough below ``tolerance``, or below ``rounding`` [1/s] times the largest coordinate.
    """
    w = wp.tid()
    worlds_out.active[w] = takes_part[w]
    worlds_out.searching[w] = 0
    if takes_part[w] == 0:
        return
    worlds_out.iterations[w] = 0
    worlds_out.cg_iterations[w] = 0
    worlds_out.converged[w] = 0
    worlds_out.update[w] = wp.float64(0.0)
    worlds_out.forcing[w] = loosest
    worlds_out.project[w] = real(1.0)
    most = wp.float64(0.0)
    for lane in range(lanes.lane_start[w], lanes.lane_start[w + 1]):
        most = wp.max(most, reach[lane])
    worlds_out.mass[w] = world_sum(lanes, w, mass)
    worlds_out.count[w] = world_sum(lanes, w, count)
    worlds_out.tolerance[w] = wp.max(tolerance, rounding * most)
    wp.atomic_add(worlds_out.at_work, 0, 1)


@wp.kernel
def place(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    position_base: wp.array(dtype=vec3),
    gamma: real,
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """x = x̄ + γ v of free particles; pinned ones keep their place and stand still until they are driven."""
    i = thread_offset + wp.tid()
    if particle_inv_mass[i] > real(0.0):
        particle_q_out[i] = position_base[i] + gamma * particle_qd_out[i]
    else:
        particle_qd_out[i] = vec3()


@wp.kernel
def residual(
    # Model
    thread_offset: int,
    lanes: Lanes,
    particle_mass: wp.array(dtype=real),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    velocity_base: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    particle_f: wp.array(dtype=vec3),
    direction: wp.array(dtype=vec3),
    gamma: real,
    # Out
    residual_out: wp.array(dtype=vec3),
    partial_out: wp.array(dtype=wp.float64),
):
    """R = M (v − v̄) − γ f, 0 for pinned particles, and R·direction of each lane."""
    lane = thread_offset + wp.tid()
    slope = wp.float64(0.0)
    for i in range(lanes.particle_start[lane], lanes.particle_end[lane]):
        r = vec3()
        if particle_inv_mass[i] > real(0.0):
            r = particle_mass[i] * (particle_qd[i] - velocity_base[i]) - gamma * particle_f[i]
        residual_out[i] = r
        slope += wp.float64(wp.dot(r, direction[i]))
    partial_out[lane] = slope


@wp.kernel
def start_search(
    # Model
    thread_offset: int,
    lanes: Lanes,
    particle_mass: wp.array(dtype=real),
    # State in
    particle_qd: wp.array(dtype=vec3),
    direction: wp.array(dtype=vec3),
    # Out
    start_out: wp.array(dtype=vec3),
    by_mass_out: wp.array(dtype=wp.float64),
    by_count_out: wp.array(dtype=wp.float64),
):
    """Keeps the velocities from which the line search starts, and sums m |direction|² and |direction|²."""
    lane = thread_offset + wp.tid()
    by_mass = wp.float64(0.0)
    by_count = wp.float64(0.0)
    for i in range(lanes.particle_start[lane], lanes.particle_end[lane]):
        start_out[i] = particle_qd[i]
        square = wp.dot(direction[i], direction[i])
        by_mass += wp.float64(particle_mass[i] * square)
        by_count += wp.float64(square)
    by_mass_out[lane] = by_mass
    by_count_out[lane] = by_count


@wp.kernel
def start_search_worlds(
    # Model
    lanes: Lanes,
    # State in
    by_mass: wp.array(dtype=wp.float64),
    by_count: wp.array(dtype=wp.float64),
    solves: Solves,
    # Out
    worlds_out: Worlds,
):
    """Worlds at work try the full step first, but none of an indefinite matrix; ``at_search`` must be 0 before.

    An update is averaged both over mass and over particles, and the larger mean counts: by mass alone nothing would be
    asked of what is a thousand times as light as the rest, and by number alone nothing of a few heavy particles.
    """
    w = wp.tid()
    worlds_out.searching[w] = 0
    if worlds_out.active[w] == 0:
        return
    worlds_out.cg_iterations[w] = worlds_out.cg_iterations[w] + solves.iterations[w]
    square = wp.float64(0.0)
    if worlds_out.count[w] > wp.float64(0.0):
        heavy = world_sum(lanes, w, by_mass) / worlds_out.mass[w]
        square = wp.max(heavy, world_sum(lanes, w, by_count) / worlds_out.count[w])
    worlds_out.update[w] = wp.sqrt(square)
    worlds_out.step[w] = wp.float64(0.0)
    if solves.indefinite[w] == 0:
        worlds_out.searching[w] = 1
        worlds_out.step[w] = wp.float64(1.0)
        wp.atomic_add(worlds_out.at_search, 0, 1)


@wp.kernel
def attempt(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    # State in
    worlds: Worlds,
    position_base: wp.array(dtype=vec3),
    start: wp.array(dtype=vec3),
    direction: wp.array(dtype=vec3),
    gamma: real,
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """Velocities at the present step length, and their positions."""
    i = thread_offset + wp.tid()
    w = particle_world[i]
    if worlds.active[w] == 1 and particle_inv_mass[i] > real(0.0):
        v = start[i] + real(worlds.step[w]) * direction[i]
        particle_qd_out[i] = v
        particle_q_out[i] = position_base[i] + gamma * v


@wp.kernel
def judge_step(
    # Model
    lanes: Lanes,
    # State in
    partial: wp.array(dtype=wp.float64),
    solves: Solves,
    overshoot: wp.float64,
    shortest: wp.float64,
    # Out
    worlds_out: Worlds,
):
    """Shortens steps that overshoot: R·Δ, the slope of the energy along Δ, is −d at first, d the solve's decrease.

    A step is taken when its slope is at most ``overshoot`` d; else the zero of the linear slope is tried. With damping
    there is no energy, but the slope is still what must vanish. A step below ``shortest`` is taken as it is, and so is
    an update within the tolerance, whose slope is rounding. A slope that is no number is too far, like a large one.
    """
    w = wp.tid()
    if worlds_out.searching[w] == 0:
        return
    slope = world_sum(lanes, w, partial)
    first = solves.decrease[w]
    step = worlds_out.step[w]
    matters = worlds_out.update[w] > worlds_out.tolerance[w]
    if matters and not slope <= overshoot * first and step > shortest:
        shorter = wp.float64(0.1)
        if wp.isfinite(slope):
            shorter = wp.clamp(first / (first + slope), wp.float64(0.1), wp.float64(0.5))
        worlds_out.step[w] = step * shorter
    else:
        worlds_out.searching[w] = 0
        wp.atomic_sub(worlds_out.at_search, 0, 1)


@wp.func
def prepare_next(worlds_out: Worlds, w: wp.int32, indefinite: wp.int32, loosest: wp.float64, tightest: wp.float64):
    """How the next linear system is made and solved.

    Projection makes far steps safe, its absence makes the last ones converge faster than linearly; so it fades while
    full steps are taken, and returns when they are not, or when the matrix is found indefinite. Linear solves are
    accurate when it is gone: before that, they would only make a wrong direction exact.
    """
    project = worlds_out.project[w]
    if indefinite == 1:
        project = real(1.0)
    elif worlds_out.step[w] == wp.float64(1.0):
        project = real(FADE) * project
        if project < real(0.05):
            project = real(0.0)
    else:
        project = wp.min(real(1.0), real(2.0) * project + real(0.05))
    worlds_out.project[w] = project
    worlds_out.forcing[w] = loosest
    if project == real(0.0):
        worlds_out.forcing[w] = tightest


@wp.kernel
def judge_worlds(
    # State in
    solves: Solves,
    max_iterations: wp.int32,
    loosest: wp.float64,
    tightest: wp.float64,
    # Out
    worlds_out: Worlds,
):
    """A world is done when a full step of a definite system changed its velocities by no more than the tolerance.

    One whose velocities are no longer finite gives up.
    """
    w = wp.tid()
    if worlds_out.active[w] == 0:
        return
    k = worlds_out.iterations[w] + 1
    worlds_out.iterations[w] = k
    done = worlds_out.step[w] == wp.float64(1.0) and worlds_out.update[w] <= worlds_out.tolerance[w]
    prepare_next(worlds_out, w, solves.indefinite[w], loosest, tightest)
    if not done and k < max_iterations and wp.isfinite(worlds_out.update[w]):
        return
    worlds_out.active[w] = 0
    wp.atomic_sub(worlds_out.at_work, 0, 1)
    worlds_out.newton_total[w] = worlds_out.newton_total[w] + wp.int64(k)
    worlds_out.cg_total[w] = worlds_out.cg_total[w] + wp.int64(worlds_out.cg_iterations[w])
    if done:
        worlds_out.converged[w] = 1
    else:
        worlds_out.failures[w] = worlds_out.failures[w] + 1
