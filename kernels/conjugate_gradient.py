"""Preconditioned conjugate gradients for A x = −r₀, a system per world, all worlds at once and none coupled to another.

A = M + a K + b C is known by its products; the preconditioner is the inverse of its 3×3 diagonal blocks. Sums run in
float64 over *lanes*, short ranges of particles of one world, and then over the lanes of a world, always in the same
order: the result is bitwise repeatable on every device and does not depend on the other worlds.

Products are taken in float64, too: where only rounding is left to solve for, velocities of 1e-20 m/s, their squares
would vanish in float32, and the matrix look indefinite. What is not finite must stay visible: left out of a solution,
it would be taken for a particle, or a world, on which nothing acts.
"""

import sys

import warp as wp

from .direct import matrix_at, put, real_at, vector_at
from .precision import FORWARD_ONLY, mat33, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

WINDOW = wp.constant(8)
EASY = wp.constant(wp.float64(1.0e-6))


@wp.struct
class Lanes:
    """Lane l owns particles ``particle_start[l]`` to ``particle_end[l]``, all of world ``world[l]``; world w
    owns lanes ``lane_start[w]`` to ``lane_start[w + 1]``."""

    particle_start: wp.array(dtype=wp.int32)
    particle_end: wp.array(dtype=wp.int32)
    world: wp.array(dtype=wp.int32)
    lane_start: wp.array(dtype=wp.int32)


@wp.struct
class Solves:
    """State of the solve of each world, and ``remaining``, the number of worlds still at work."""

    active: wp.array(dtype=wp.int32)
    iterations: wp.array(dtype=wp.int32)
    indefinite: wp.array(dtype=wp.int32)
    rz: wp.array(dtype=wp.float64)
    alpha: wp.array(dtype=wp.float64)
    beta: wp.array(dtype=wp.float64)
    first_rz: wp.array(dtype=wp.float64)
    decrease: wp.array(dtype=wp.float64)
    mark: wp.array(dtype=wp.float64)
    remaining: wp.array(dtype=wp.int32)


@wp.func
def product(a: vec3, b: vec3):
    """a·b in float64."""
    total = wp.float64(a[0]) * wp.float64(b[0]) + wp.float64(a[1]) * wp.float64(b[1])
    return total + wp.float64(a[2]) * wp.float64(b[2])


@wp.func
def world_sum(lanes: Lanes, w: wp.int32, partial: wp.array(dtype=wp.float64)):
    """Sum of the lanes of a world, in order."""
    total = wp.float64(0.0)
    for lane in range(lanes.lane_start[w], lanes.lane_start[w + 1]):
        total += partial[lane]
    return total


@wp.kernel
def invert_blocks(
    # Model
    thread_offset: int,
    particle_mass: wp.array(dtype=real),
    particle_inv_mass: wp.array(dtype=real),
    # Out
    blocks_out: wp.array(dtype=mat33),
):
    """(m I + block)⁻¹ in place; 0 for pinned particles, which keeps them out of the solve."""
    i = thread_offset + wp.tid()
    block = particle_mass[i] * wp.identity(n=3, dtype=real) + blocks_out[i]
    if particle_inv_mass[i] > real(0.0):
        blocks_out[i] = wp.inverse(block)
    else:
        blocks_out[i] = mat33()


@wp.kernel
def begin(
    # Model
    thread_offset: int,
    lanes: Lanes,
    particle_mass: wp.array(dtype=real),
    # State in
    world_active: wp.array(dtype=wp.int32),
    residual: wp.array(dtype=vec3),
    preconditioner: wp.array(dtype=mat33),
    # Out
    x_out: wp.array(dtype=vec3),
    r_out: wp.array(dtype=vec3),
    p_out: wp.array(dtype=vec3),
    ap_out: wp.array(dtype=vec3),
    partial_out: wp.array(dtype=wp.float64),
):
    """x = 0, r = −residual, p = P r, A p started with M p, r·p summed. Nothing to do in worlds that are not active.

    Where p is not finite, x is not either.
    """
    lane = thread_offset + wp.tid()
    rz = wp.float64(0.0)
    for i in range(lanes.particle_start[lane], lanes.particle_end[lane]):
        r = -residual[i]
        p = preconditioner[i] * r
        if world_active[lanes.world[lane]] == 0:
            p = vec3()
        x = vec3()
        if not wp.isfinite(p):
            x = p
        x_out[i] = x
        r_out[i] = r
        p_out[i] = p
        ap_out[i] = particle_mass[i] * p
        rz += product(r, p)
    partial_out[lane] = rz


@wp.kernel
def begin_worlds(
    # Model
    lanes: Lanes,
    # State in
    partial: wp.array(dtype=wp.float64),
    # Out
    solves_out: Solves,
):
    """Worlds with something to solve become active; ``remaining`` must be 0 before."""
    w = wp.tid()
    rz = world_sum(lanes, w, partial)
    solves_out.rz[w] = rz
    solves_out.first_rz[w] = rz
    solves_out.mark[w] = wp.float64(0.0)
    solves_out.iterations[w] = 0
    solves_out.indefinite[w] = 0
    solves_out.decrease[w] = wp.float64(0.0)
    solves_out.active[w] = 0
    if rz > wp.float64(0.0) and wp.isfinite(rz):
        solves_out.active[w] = 1
        wp.atomic_add(solves_out.remaining, 0, 1)


@wp.kernel
def curvature(
    # Model
    thread_offset: int,
    lanes: Lanes,
    # State in
    p: wp.array(dtype=vec3),
    ap: wp.array(dtype=vec3),
    # Out
    partial_out: wp.array(dtype=wp.float64),
):
    """p·A p of each lane."""
    lane = thread_offset + wp.tid()
    total = wp.float64(0.0)
    for i in range(lanes.particle_start[lane], lanes.particle_end[lane]):
        total += product(vector_at(p, i), vector_at(ap, i))
    partial_out[lane] = total


@wp.kernel
def step_length(
    # Model
    lanes: Lanes,
    # State in
    partial: wp.array(dtype=wp.float64),
    # Out
    solves_out: Solves,
):
    """α = r·z / p·A p. Where p·A p < 0 the matrix is indefinite: the solve ends, and says so.

    Where it is 0, p is too small for the numbers there are; where it is not finite, α is no number.
    """
    w = wp.tid()
    if solves_out.active[w] == 0:
        return
    pap = world_sum(lanes, w, partial)
    alpha = wp.float64(0.0)
    if not wp.isfinite(pap):
        alpha = wp.float64(wp.NAN)
    elif pap > wp.float64(0.0):
        alpha = solves_out.rz[w] / pap
    elif pap < wp.float64(0.0):
        solves_out.indefinite[w] = 1
    solves_out.alpha[w] = alpha


@wp.kernel
def advance(
    # Model
    thread_offset: int,
    lanes: Lanes,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    solves: Solves,
    preconditioner: wp.array(dtype=mat33),
    p: wp.array(dtype=vec3),
    ap: wp.array(dtype=vec3),
    # Out
    x_out: wp.array(dtype=vec3),
    r_out: wp.array(dtype=vec3),
    partial_out: wp.array(dtype=wp.float64),
):
    """x += α p, r −= α A p, and the new r·P r."""
    lane = thread_offset + wp.tid()
    w = lanes.world[lane]
    if solves.active[w] == 0:
        return
    alpha = real(solves.alpha[w])
    rz = wp.float64(0.0)
    for i in range(lanes.particle_start[lane], lanes.particle_end[lane]):
        if real_at(particle_inv_mass, i) > real(0.0):
            r = vector_at(r_out, i) - alpha * vector_at(ap, i)
            put(x_out, i, vector_at(x_out, i) + alpha * vector_at(p, i))
            put(r_out, i, r)
            rz += product(r, matrix_at(preconditioner, i) * r)
    partial_out[lane] = rz


@wp.kernel
def judge(
    # Model
    lanes: Lanes,
    # State in
    partial: wp.array(dtype=wp.float64),
    world_tolerance: wp.array(dtype=wp.float64),
    max_iterations: wp.int32,
    # Out
    solves_out: Solves,
):
    """β, and whether to go on.

    Each iteration lowers the quadratic model, which is the square of the error in the energy norm, by α r·z. The solve
    ends when the latest ``WINDOW`` iterations contributed at most tolerance² of what all did (Hestenes and Stiefel's
    estimate): unlike the residual that error falls steadily, and smooth modes, whose residual is small, count in it.
    Easy systems end before that, by their residual.
    """
    w = wp.tid()
    if solves_out.active[w] == 0:
        return
    gain = solves_out.alpha[w] * solves_out.rz[w]
    rz = world_sum(lanes, w, partial)
    k = solves_out.iterations[w] + 1
    decrease = solves_out.decrease[w] + gain
    solves_out.beta[w] = rz / solves_out.rz[w]
    solves_out.rz[w] = rz
    solves_out.iterations[w] = k
    solves_out.decrease[w] = decrease
    tolerance = world_tolerance[w]
    square = tolerance * tolerance
    small = rz <= EASY * square * solves_out.first_rz[w]
    if k % WINDOW == 0:
        small = small or decrease - solves_out.mark[w] <= square * decrease
        solves_out.mark[w] = decrease
    if small or gain == wp.float64(0.0) or k >= max_iterations or not rz > wp.float64(0.0):
        solves_out.active[w] = 0
        wp.atomic_sub(solves_out.remaining, 0, 1)


@wp.kernel
def turn(
    # Model
    thread_offset: int,
    particle_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    # State in
    solves: Solves,
    preconditioner: wp.array(dtype=mat33),
    r: wp.array(dtype=vec3),
    # Out
    p_out: wp.array(dtype=vec3),
    ap_out: wp.array(dtype=vec3),
):
    """p = P r + β p, and A p started with M p; nothing moves in worlds that are done."""
    i = thread_offset + wp.tid()
    w = particle_world[i]
    p = vec3()
    if solves.active[w] == 1:
        p = matrix_at(preconditioner, i) * vector_at(r, i) + real(solves.beta[w]) * vector_at(p_out, i)
    put(p_out, i, p)
    put(ap_out, i, real_at(particle_mass, i) * p)
