"""Drag and lift of the air on each triangle.

With u the velocity of the air relative to a triangle of area A and unit normal n, u_n = (u·n) n and u_t = u − u_n:

    F = ½ ρ A |u| ( C_n u_n + C_t u_t )

C_n is the drag coefficient of a piece held across the flow, C_t that of its two faces held along it. Of the normal part
C_n sin²α is drag and C_n sinα cosα is lift at an angle of attack α. Neither depends on the number of triangles, nor on
which side is outside. Corners share velocity and force in proportion to the masses that they have of the triangle, so
that a sheet moves as one: with thirds on a grid, where vertices have four or eight triangles, it would buckle.
"""

import sys

import warp as wp

from .precision import OPTIONS, mat33, real, vec3
from .wind import Wind, wind_velocity

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.struct
class Meeting:
    """Air that meets a triangle: u_n and u_t [m/s], |u|, and ½ ρ A [kg/m]."""

    across: vec3
    along: vec3
    speed: real
    scale: real


@wp.func
def meet(a: vec3, b: vec3, c: vec3, v: vec3, air: vec3, density: real):
    """The air's velocity ``air`` relative to triangle abc, whose mean velocity is v; a sliver without area has none."""
    m = Meeting()
    normal = wp.cross(b - a, c - a)
    twice_area = wp.length(normal)
    if twice_area > real(0.0):
        n = normal / twice_area
        u = air - v
        m.across = wp.dot(u, n) * n
        m.along = u - m.across
        m.speed = wp.length(u)
        m.scale = real(0.25) * density * twice_area
    return m


@wp.func
def air_force(m: Meeting, drag: real, friction: real):
    """F [N] of C_n = ``drag`` and C_t = ``friction``."""
    return m.scale * m.speed * (drag * m.across + friction * m.along)


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


@wp.func
def meeting_of(
    t: int,
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_corner_share: wp.array(dtype=vec3),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    wind: Wind,
    world: int,
    time: wp.float64,
):
    i = tri_indices[t, 0]
    j = tri_indices[t, 1]
    k = tri_indices[t, 2]
    share = tri_corner_share[t]
    middle = share[0] * particle_q[i] + share[1] * particle_q[j] + share[2] * particle_q[k]
    v = share[0] * particle_qd[i] + share[1] * particle_qd[j] + share[2] * particle_qd[k]
    air = wind_velocity(wind, world, middle, time)
    return meet(particle_q[i], particle_q[j], particle_q[k], v, air, wind.density[world])


@wp.kernel
def triangle_forces(
    # Model
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_corner_share: wp.array(dtype=vec3),
    tri_air_drag: wp.array(dtype=real),
    tri_air_friction: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    wind: Wind,
    # State in
    world_time: wp.array(dtype=wp.float64),
    time_offset: wp.float64,
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    tri_force_out: wp.array(dtype=vec3),
):
    """The air's force on each triangle [N]."""
    t = wp.tid()
    world = particle_world[tri_indices[t, 0]]
    time = world_time[world] + time_offset
    m = meeting_of(t, tri_indices, tri_corner_share, particle_q, particle_qd, wind, world, time)
    tri_force_out[t] = air_force(m, tri_air_drag[t], tri_air_friction[t])


@wp.kernel
def triangle_products(
    # Model
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_corner_share: wp.array(dtype=vec3),
    tri_air_drag: wp.array(dtype=real),
    tri_air_friction: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    wind: Wind,
    # State in
    world_project: wp.array(dtype=real),
    world_time: wp.array(dtype=wp.float64),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    x: wp.array(dtype=vec3),
    damping: real,
    # Out
    tri_product_out: wp.array(dtype=vec3),
):
    """``damping`` ∂F/∂u x of each triangle, x at its middle."""
    t = wp.tid()
    world = particle_world[tri_indices[t, 0]]
    m = meeting_of(t, tri_indices, tri_corner_share, particle_q, particle_qd, wind, world, world_time[world])
    c = air_damping(m, tri_air_drag[t], tri_air_friction[t], world_project[world])
    share = tri_corner_share[t]
    middle = share[0] * x[tri_indices[t, 0]] + share[1] * x[tri_indices[t, 1]] + share[2] * x[tri_indices[t, 2]]
    tri_product_out[t] = damping * (c * middle)


@wp.kernel
def diagonal(
    # Model
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
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    damping: real,
    # Out
    blocks_out: wp.array(dtype=mat33),
):
    """Adds the 3×3 blocks on the diagonal of ``damping`` C, one thread per particle."""
    i = wp.tid()
    world = particle_world[i]
    total = mat33()
    for k in range(particle_corner_start[i], particle_corner_start[i + 1]):
        t = particle_corner_ids[k] // 3
        share = tri_corner_share[t][particle_corner_ids[k] % 3]
        m = meeting_of(t, tri_indices, tri_corner_share, particle_q, particle_qd, wind, world, world_time[world])
        total += share * share * air_damping(m, tri_air_drag[t], tri_air_friction[t], world_project[world])
    blocks_out[i] = blocks_out[i] + damping * total
