"""The guard: no straight motion of an interval may take a pair through each other; what would is held back."""

import sys

import warp as wp

from .closest import time_of_impact
from .contact_pairs import Pairs, narrow, wide
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.kernel
def count_torn(
    # Model
    tri_indices: wp.array2d(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    particle_rest: wp.array(dtype=vec3),
    limit: wp.float64,
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    torn_out: wp.array(dtype=wp.int32),
):
    """Counts, per world, edges of triangles more than ``limit`` times as long as at rest, or of no number."""
    t = wp.tid()
    for k in range(3):
        a = tri_indices[t, k]
        b = tri_indices[t, (k + 1) % 3]
        rest = wp.length(wide(particle_rest[b]) - wide(particle_rest[a]))
        if not wp.length(wide(particle_q[b]) - wide(particle_q[a])) <= limit * rest:
            wp.atomic_add(torn_out, particle_world[a], 1)


@wp.kernel
def give_up(
    # State in
    torn: wp.array(dtype=wp.int32),
    # Out
    impacts_out: wp.array(dtype=wp.int32),
):
    """Nothing is looked at in a frame that has diverged: everything may meet everything there, and it is an error."""
    if torn[wp.tid()] > 0:
        impacts_out[0] = 0


@wp.kernel
def limit_motion(
    # Model
    particle_inv_mass: wp.array(dtype=real),
    pairs: Pairs,
    separation: wp.float64,
    stride: int,
    # State in
    particle_from: wp.array(dtype=vec3),
    particle_to: wp.array(dtype=vec3),
    fraction: wp.array(dtype=wp.float64),
    # Out
    fraction_out: wp.array(dtype=wp.float64),
    held_back_out: wp.array(dtype=wp.int32),
    counts_out: wp.array(dtype=wp.int32),
):
    """For each pair that would meet on its way: its particles may go only as far as the meeting.

    Counts the particles that had to be held back further than before, and pairs that are pinched: they meet though
    none of them can be held back any more, as what moves is prescribed.
    """
    for k in range(wp.tid(), wp.min(pairs.count[0], pairs.kind.shape[0]), stride):
        i = pairs.particles[k]
        x0 = wide(particle_from[i[0]])
        x1 = wide(particle_from[i[1]])
        x2 = wide(particle_from[i[2]])
        x3 = wide(particle_from[i[3]])
        u0 = fraction[i[0]] * (wide(particle_to[i[0]]) - x0)
        u1 = fraction[i[1]] * (wide(particle_to[i[1]]) - x1)
        u2 = fraction[i[2]] * (wide(particle_to[i[2]]) - x2)
        u3 = fraction[i[3]] * (wide(particle_to[i[3]]) - x3)
        t = time_of_impact(pairs.kind[k], x0, x1, x2, x3, u0, u1, u2, u3, separation)
        if not t < wp.float64(1.0):
            continue
        held = int(0)
        for m in range(4):
            f = fraction[i[m]]
            if particle_inv_mass[i[m]] > real(0.0) and f > wp.float64(0.0):
                g = wp.float64(0.9) * t * f
                if g < wp.float64(0.02):
                    g = wp.float64(0.0)
                wp.atomic_min(fraction_out, i[m], g)
                held += 1
        if held > 0:
            wp.atomic_add(held_back_out, 0, held)
        else:
            wp.atomic_add(counts_out, 1, 1)


@wp.kernel
def apply_limit(
    # State in
    particle_from: wp.array(dtype=vec3),
    fraction: wp.array(dtype=wp.float64),
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
    counts_out: wp.array(dtype=wp.int32),
):
    """Held-back particles stop where they may, and keep as much of their speed as of their way."""
    i = wp.tid()
    f = fraction[i]
    if f < wp.float64(1.0):
        x = wide(particle_from[i])
        particle_q_out[i] = narrow(x + f * (wide(particle_q_out[i]) - x))
        particle_qd_out[i] = real(f) * particle_qd_out[i]
        wp.atomic_add(counts_out, 0, 1)
