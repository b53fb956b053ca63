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

from .direct import int_at, put, real_at, triple_at, vector_at
from .precision import OPTIONS, real, vec3
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
    squared = wp.dot(normal, normal)  # of twice the area
    if squared > real(0.0):
        u = air - v
        m.across = (wp.dot(u, normal) / squared) * normal
        m.along = u - m.across
        m.speed = wp.length(u)
        m.scale = real(0.25) * density * wp.sqrt(squared)
    return m


@wp.func
def air_force(m: Meeting, drag: real, friction: real):
    """F [N] of C_n = ``drag`` and C_t = ``friction``."""
    return m.scale * m.speed * (drag * m.across + friction * m.along)


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
    corners = triple_at(tri_indices, t)
    share = vector_at(tri_corner_share, t)
    a = vector_at(particle_q, corners[0])
    b = vector_at(particle_q, corners[1])
    c = vector_at(particle_q, corners[2])
    v = share[0] * vector_at(particle_qd, corners[0])
    v += share[1] * vector_at(particle_qd, corners[1])
    v += share[2] * vector_at(particle_qd, corners[2])
    air = wind_velocity(wind, world, share[0] * a + share[1] * b + share[2] * c, time)
    return meet(a, b, c, v, air, wind.density[world])


@wp.kernel
def triangle_forces(
    # Model
    thread_offset: int,
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
    t = thread_offset + wp.tid()
    world = int_at(particle_world, triple_at(tri_indices, t)[0])
    time = world_time[world] + time_offset
    m = meeting_of(t, tri_indices, tri_corner_share, particle_q, particle_qd, wind, world, time)
    put(tri_force_out, t, air_force(m, real_at(tri_air_drag, t), real_at(tri_air_friction, t)))
