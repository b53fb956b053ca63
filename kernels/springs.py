"""Spring forces of a whole network: scattered with atomic adds, or gathered per particle in a fixed order."""

import sys

import warp as wp

from .direct import int_at, real_at
from .lanes import LANES
from .precision import OPTIONS, real, vec3
from .spring_law import spring_energy, spring_force

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.kernel
def scatter_forces(
    # Model
    spring_indices: wp.array(dtype=wp.vec2i),
    spring_rest_length: wp.array(dtype=real),
    spring_stiffness: wp.array(dtype=real),
    spring_damping: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    particle_f_out: wp.array(dtype=vec3),
):
    """One thread per spring adds its force to both ends."""
    s = wp.tid()
    ends = spring_indices[s]
    d = particle_q[ends[1]] - particle_q[ends[0]]
    u = particle_qd[ends[1]] - particle_qd[ends[0]]
    f = spring_force(d, u, spring_rest_length[s], spring_stiffness[s], spring_damping[s])
    wp.atomic_add(particle_f_out, ends[0], f)
    wp.atomic_sub(particle_f_out, ends[1], f)


@wp.kernel
def gather_forces(
    # Model
    thread_offset: int,
    particle_spring_start: wp.array(dtype=wp.int32),
    particle_spring_ids: wp.array(dtype=wp.int32),
    spring_indices: wp.array(dtype=wp.vec2i),
    spring_rest_length: wp.array(dtype=real),
    spring_stiffness: wp.array(dtype=real),
    spring_damping: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    particle_f_out: wp.array(dtype=vec3),
):
    """One thread per particle sums its springs in the order of their numbers: bitwise repeatable on any device."""
    i = thread_offset + wp.tid()
    x = particle_q[i]
    v = particle_qd[i]
    total = vec3()
    for k in range(particle_spring_start[i], particle_spring_start[i + 1]):
        s = particle_spring_ids[k]
        ends = spring_indices[s]
        other = ends[0] + ends[1] - i
        d = particle_q[other] - x
        u = particle_qd[other] - v
        total += spring_force(d, u, spring_rest_length[s], spring_stiffness[s], spring_damping[s])
    particle_f_out[i] = particle_f_out[i] + total


@wp.kernel
def energy(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    spring_indices: wp.array(dtype=wp.vec2i),
    spring_rest_length: wp.array(dtype=real),
    spring_stiffness: wp.array(dtype=real),
    spring_group: wp.array(dtype=wp.int32),
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    energy_out: wp.array2d(dtype=wp.float64),
):
    """Adds each spring's energy [J] to ``energy_out[world, group]``; group 0 is in-plane, group 1 bending."""
    s = wp.tid()
    ends = spring_indices[s]
    d = particle_q[ends[1]] - particle_q[ends[0]]
    e = spring_energy(d, spring_rest_length[s], spring_stiffness[s])
    wp.atomic_add(energy_out, particle_world[ends[0]], spring_group[s], wp.float64(e))


@wp.kernel
def arrange_law(
    # Model
    thread_offset: int,
    spring_order: wp.array(dtype=wp.int32),
    spring_rest_length: wp.array(dtype=real),
    spring_stiffness: wp.array(dtype=real),
    spring_damping: wp.array(dtype=real),
    # Out
    spring_law_out: wp.array(dtype=vec3),
):
    """(r [m], k_s/r [N/m], k_d/r [N s/m]) of springs in another order."""
    j = thread_offset + wp.tid()
    s = spring_order[j]
    r = spring_rest_length[s]
    spring_law_out[j] = vec3(r, spring_stiffness[s] / r, spring_damping[s] / r)


@wp.kernel
def take_properties(
    # Model
    thread_offset: int,
    spring_order: wp.array(dtype=wp.int32),
    first: wp.array(dtype=real),
    second: wp.array(dtype=real),
    third: wp.array(dtype=real),
    # Out
    spring_properties_out: wp.array(dtype=vec3),
):
    """Three properties of springs in another order."""
    j = thread_offset + wp.tid()
    s = spring_order[j]
    spring_properties_out[j] = vec3(first[s], second[s], third[s])


@wp.kernel
def arrange_lanes(
    # Model
    thread_offset: int,
    lane_spring: wp.array(dtype=wp.int32),
    spring_rest_length: wp.array(dtype=real),
    spring_stiffness: wp.array(dtype=real),
    spring_damping: wp.array(dtype=real),
    # Out
    law_out: wp.array(dtype=real),
    shared_law_out: wp.array(dtype=vec3),
    shared_by_out: wp.array(dtype=wp.int32),
):
    """r [m], k_s/r [N/m] and k_d/r [N s/m] of an entry's lanes, eight of each in turn; zeros for −1, no spring.

    Where all springs of an entry have one law, it is in ``shared_law_out``, and ``shared_by_out`` has a bit for each
    lane with a spring; so that an eighth is read. Otherwise that is −1.
    """
    e = thread_offset + wp.tid()
    shared = vec3()
    lanes = int(0)
    for lane in range(LANES):
        s = int_at(lane_spring, LANES * e + lane)
        law = vec3()
        if s >= 0:
            r = real_at(spring_rest_length, s)
            law = vec3(r, real_at(spring_stiffness, s) / r, real_at(spring_damping, s) / r)
            if lanes == 0:
                shared = law
            if lanes >= 0 and law == shared:
                lanes += 1 << lane
            else:
                lanes = -1
        for k in range(3):
            law_out[(3 * e + k) * LANES + lane] = law[k]
    shared_law_out[e] = shared
    shared_by_out[e] = lanes
