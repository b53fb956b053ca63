"""Where Newton's method begins: velocities that changed alike in the two steps before change so once more.

For smooth motion that is one order better than the velocities themselves. What contact takes from cloth after each
step, the next solution brings back as long as layers are pressed together: single particles of a cloth on the ears of a
bunny went 3 m/s forth in each solution and back in contact. A guess that knows of it saves up to half of the
iterations where cloth lies on something, and some wherever it moves smoothly.

Changes that are unlike, as of an impact, are not led on with. Nor are those hardly above the tolerance of the
solutions, which are what these lack: cloth that hangs still would keep trembling. Whether to lead on is asked of a
world, and all its particles follow, as then the momentum led on with is that of outer forces; asked of each particle it
took as many iterations.
"""

import sys

import warp as wp

from .conjugate_gradient import Lanes, world_sum
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

LEAST = wp.constant(wp.float64(4.0))  # tolerances
ALIKE = wp.constant(wp.float64(1.0))  # of the latest change: how far the one before it may be from that


@wp.kernel
def weigh(
    # Model
    thread_offset: int,
    lanes: Lanes,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    change: wp.array(dtype=vec3),
    change_before: wp.array(dtype=vec3),
    # Out
    size_out: wp.array(dtype=wp.float64),
    difference_out: wp.array(dtype=wp.float64),
):
    """Sums of the squares of the latest changes of free particles and of what they differ from those before [m²/s²]."""
    lane = thread_offset + wp.tid()
    size = wp.float64(0.0)
    difference = wp.float64(0.0)
    for i in range(lanes.particle_start[lane], lanes.particle_end[lane]):
        if particle_inv_mass[i] > real(0.0):
            a = change[i]
            b = a - change_before[i]
            size += wp.float64(wp.dot(a, a))
            difference += wp.float64(wp.dot(b, b))
    size_out[lane] = size
    difference_out[lane] = difference


@wp.kernel
def decide(
    # Model
    lanes: Lanes,
    # State in
    takes_part: wp.array(dtype=wp.int32),
    tolerance: wp.array(dtype=wp.float64),
    count: wp.array(dtype=wp.float64),
    size: wp.array(dtype=wp.float64),
    difference: wp.array(dtype=wp.float64),
    # Out
    leads_out: wp.array(dtype=wp.int32),
):
    """1 for worlds whose changes go on, by their root mean squares over the ``count`` free particles."""
    w = wp.tid()
    if takes_part[w] == 0:
        return
    squares = world_sum(lanes, w, size)
    least = LEAST * tolerance[w]
    leads_out[w] = int(squares > count[w] * least * least and world_sum(lanes, w, difference) < ALIKE * ALIKE * squares)


@wp.kernel
def lead(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    # State in
    takes_part: wp.array(dtype=wp.int32),
    leads: wp.array(dtype=wp.int32),
    # Out
    change_out: wp.array(dtype=vec3),
    change_before_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """From the velocities at the start of a step to the guess; ``change_out`` keeps what :func:`learn` needs."""
    i = thread_offset + wp.tid()
    w = particle_world[i]
    if takes_part[w] == 1 and particle_inv_mass[i] > real(0.0):
        v = particle_qd_out[i]
        change = change_out[i]
        if leads[w] == 1:
            particle_qd_out[i] = v + change
        change_before_out[i] = change
        change_out[i] = -v


@wp.kernel
def learn(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    # State in
    takes_part: wp.array(dtype=wp.int32),
    particle_qd: wp.array(dtype=vec3),
    # Out
    change_out: wp.array(dtype=vec3),
):
    """By how much velocities have changed from the start of the step to the solution [m/s]."""
    i = thread_offset + wp.tid()
    if takes_part[particle_world[i]] == 1 and particle_inv_mass[i] > real(0.0):
        change_out[i] = change_out[i] + particle_qd[i]
