"""The work that forces did over a step, as two rules have it, and what an undamped rule gained by taking the wrong one.

Kinetic energy changes by F·Δx, F the force by which the rule stepped: that in the middle of the step, or the mean of
those at its ends. Both are the true work where forces are linear; where they differ, Simpson's rule is closer.
"""

import sys

import warp as wp

from .conjugate_gradient import Lanes, world_sum
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.struct
class Gains:
    """Of each world [J]: what was gained and not lost again, and the kinetic energy it is measured by."""

    gained: wp.array(dtype=wp.float64)
    energy: wp.array(dtype=wp.float64)


@wp.kernel
def find_middle(
    # Model
    thread_offset: int,
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    later_q: wp.array(dtype=vec3),
    later_qd: wp.array(dtype=vec3),
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """Half way between two states."""
    i = thread_offset + wp.tid()
    particle_q_out[i] = real(0.5) * (particle_q[i] + later_q[i])
    particle_qd_out[i] = real(0.5) * (particle_qd[i] + later_qd[i])


@wp.kernel
def measure(
    # Model
    thread_offset: int,
    lanes: Lanes,
    particle_mass: wp.array(dtype=real),
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    later_q: wp.array(dtype=vec3),
    later_qd: wp.array(dtype=vec3),
    particle_f: wp.array(dtype=vec3),
    middle_f: wp.array(dtype=vec3),
    later_f: wp.array(dtype=vec3),
    # Out
    partial_out: wp.array(dtype=wp.float64),
    energy_out: wp.array(dtype=wp.float64),
):
    """Of each lane: (f in the middle − mean of f at the ends)·Δx, and Σ ½ m v² at the end, of free particles."""
    lane = thread_offset + wp.tid()
    difference = wp.float64(0.0)
    energy = wp.float64(0.0)
    for i in range(lanes.particle_start[lane], lanes.particle_end[lane]):
        if particle_inv_mass[i] > real(0.0):
            f = middle_f[i] - real(0.5) * (particle_f[i] + later_f[i])
            difference += wp.float64(wp.dot(f, later_q[i] - particle_q[i]))
            energy += wp.float64(real(0.5) * particle_mass[i] * wp.dot(later_qd[i], later_qd[i]))
    partial_out[lane] = difference
    energy_out[lane] = energy


@wp.kernel
def judge(
    # Model
    lanes: Lanes,
    # State in
    partial: wp.array(dtype=wp.float64),
    energy: wp.array(dtype=wp.float64),
    jumped: wp.array(dtype=wp.int32),
    converged: wp.array(dtype=wp.int32),
    share: wp.float64,
    most: wp.float64,
    kept: wp.float64,
    # Out
    gains_out: Gains,
    failures_out: wp.array(dtype=wp.int32),
    damped_out: wp.array(dtype=wp.int32),
    any_out: wp.array(dtype=wp.int32),
):
    """Marks worlds to be damped: those that jumped, and those that would gain more than ``most`` of their energy.

    A step gains ``share`` of the difference between the two rules. Of what was before, ``kept`` still counts. Without
    finite numbers there is no comparison that holds, so such a step is marked, too; and one that was not solved, which
    is no failure then, as nothing is left of it.
    """
    w = wp.tid()
    gained = kept * gains_out.gained[w]
    scale = kept * gains_out.energy[w]
    gains_out.gained[w] = gained
    gains_out.energy[w] = scale
    damped_out[w] = jumped[w]
    if jumped[w] == 1:
        return
    gained += share * world_sum(lanes, w, partial)
    scale = wp.max(scale, world_sum(lanes, w, energy))
    if converged[w] == 0:
        failures_out[w] = failures_out[w] - 1
    if converged[w] == 1 and gained <= most * scale:
        gains_out.gained[w] = wp.max(gained, -most * scale)
        gains_out.energy[w] = scale
    else:
        damped_out[w] = 1
        any_out[0] = 1
