"""Damping matrices of the air: products, 3×3 blocks on the diagonal, and all of these."""

import sys

import warp as wp

from .air import Meeting, meeting_of
from .block_rows import BlockRows
from .precision import FORWARD_ONLY, mat33, real, vec3
from .wind import Wind

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.func
def air_damping(m: Meeting, drag: real, friction: real, project: real):
    """Symmetric part of ∂F/∂u [N s/m]; ``project`` = 1 leaves out what may be negative in it, the mixed products."""
    if m.speed == real(0.0):
        return mat33()
    nn = wp.outer(m.across, m.across)
    tt = wp.outer(m.along, m.along)
    identity = wp.identity(n=3, dtype=real)
    speed_across = wp.dot(m.across, m.across)
    across = mat33()
    if speed_across > real(0.0):
        across = nn / speed_across
    mixed = real(0.5) * (real(1.0) - project) * (drag + friction)
    mixed_products = wp.outer(m.across, m.along) + wp.outer(m.along, m.across)
    plain = drag * across + friction * (identity - across)
    turning = drag * nn + friction * tt + mixed * mixed_products
    return mat33(m.scale * (m.speed * plain + turning / m.speed))


@wp.kernel
def triangle_products(
    # Model
    thread_offset: int,
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_corner_share: wp.array(dtype=vec3),
    tri_air_drag: wp.array(dtype=real),
    tri_air_friction: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    wind: Wind,
    # State in
    world_project: wp.array(dtype=real),
    world_time: wp.array(dtype=wp.float64),
    time_offset: wp.float64,
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    x: wp.array(dtype=vec3),
    damping: real,
    # Out
    tri_product_out: wp.array(dtype=vec3),
):
    """``damping`` ∂F/∂u x of each triangle, x at its middle."""
    t = thread_offset + wp.tid()
    world = particle_world[tri_indices[t, 0]]
    time = world_time[world] + time_offset
    m = meeting_of(t, tri_indices, tri_corner_share, particle_q, particle_qd, wind, world, time)
    c = air_damping(m, tri_air_drag[t], tri_air_friction[t], world_project[world])
    share = tri_corner_share[t]
    middle = share[0] * x[tri_indices[t, 0]] + share[1] * x[tri_indices[t, 1]] + share[2] * x[tri_indices[t, 2]]
    tri_product_out[t] = damping * (c * middle)


@wp.kernel
def diagonal(
    # Model
    thread_offset: int,
    particle_corner_start: wp.array(dtype=wp.int32),
    particle_corner_ids: wp.array(dtype=wp.int32),
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_corner_share: wp.array(dtype=vec3),
    tri_air_drag: wp.array(dtype=real),
    tri_air_friction: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    wind: Wind,
    # State in
    world_project: wp.array(dtype=real),
    world_time: wp.array(dtype=wp.float64),
    time_offset: wp.float64,
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    damping: real,
    # Out
    blocks_out: wp.array(dtype=mat33),
):
    """Adds the 3×3 blocks on the diagonal of ``damping`` C, one thread per particle."""
    i = thread_offset + wp.tid()
    world = particle_world[i]
    time = world_time[world] + time_offset
    total = mat33()
    for k in range(particle_corner_start[i], particle_corner_start[i + 1]):
        t = particle_corner_ids[k] // 3
        share = tri_corner_share[t][particle_corner_ids[k] % 3]
        m = meeting_of(t, tri_indices, tri_corner_share, particle_q, particle_qd, wind, world, time)
        total += share * share * air_damping(m, tri_air_drag[t], tri_air_friction[t], world_project[world])
    blocks_out[i] = blocks_out[i] + damping * total


@wp.kernel
def add_blocks(
    # Model
    thread_offset: int,
    particle_corner_start: wp.array(dtype=wp.int32),
    particle_corner_ids: wp.array(dtype=wp.int32),
    pair_slot: wp.array(dtype=wp.int32),
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_corner_share: wp.array(dtype=vec3),
    tri_air_drag: wp.array(dtype=real),
    tri_air_friction: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    wind: Wind,
    # State in
    world_project: wp.array(dtype=real),
    world_time: wp.array(dtype=wp.float64),
    time_offset: wp.float64,
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    damping: real,
    # Out
    rows_out: BlockRows,
):
    """Adds ``damping`` C, one thread per particle: the pair of corners c and d of triangle t is 9 t + 3 c + d."""
    i = thread_offset + wp.tid()
    world = particle_world[i]
    time = world_time[world] + time_offset
    own = mat33()
    for k in range(particle_corner_start[i], particle_corner_start[i + 1]):
        corner = particle_corner_ids[k]
        t = corner // 3
        share = tri_corner_share[t]
        m = meeting_of(t, tri_indices, tri_corner_share, particle_q, particle_qd, wind, world, time)
        c = mat33(
            (damping * share[corner % 3]) * air_damping(m, tri_air_drag[t], tri_air_friction[t], world_project[world])
        )
        own += c  # shares of a triangle sum to 1
        for other in range(3):
            s = pair_slot[3 * corner + other]
            if s >= 0:
                rows_out.block[s] = rows_out.block[s] + share[other] * c
    rows_out.own[i] = rows_out.own[i] + own
