"""Contacts that somebody else has found, each a particle and a plane: listed by particle, then resolved one by one."""

import sys

import warp as wp

from .obstacle_contact import Motion, resolve
from .precision import OPTIONS, real, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])

SMALLEST_SLOP = wp.constant(1.0e-6)  # [m]


@wp.struct
class Planes:
    """Contacts in the rows below ``count[0]``, and the rows of each particle as a chain.

    ``particle`` −1 leaves a row out. ``point`` on the plane [m], its unit ``normal`` to the particle's side and its
    ``velocity`` [m/s], all at the start of the step; ``friction`` is Coulomb's coefficient of the pair.
    """

    count: wp.array(dtype=wp.int32)
    particle: wp.array(dtype=wp.int32)
    point: wp.array(dtype=vec3)
    normal: wp.array(dtype=vec3)
    velocity: wp.array(dtype=vec3)
    friction: wp.array(dtype=real)
    first: wp.array(dtype=wp.int32)
    next: wp.array(dtype=wp.int32)


@wp.kernel
def chain(
    # State in
    planes: Planes,
    # Out
    first_out: wp.array(dtype=wp.int32),
    next_out: wp.array(dtype=wp.int32),
):
    """Chains the contacts of each particle; ``first_out`` starts at −1."""
    row = wp.tid()
    if row >= planes.count[0]:
        return
    particle = planes.particle[row]
    if particle >= 0:
        next_out[row] = wp.atomic_exch(first_out, particle, row)


@wp.kernel
def respond(
    # Model
    particle_inv_mass: wp.array(dtype=real),
    particle_radius: wp.array(dtype=real),
    # State in
    planes: Planes,
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    elapsed: real,
    dt: real,
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """Corrects the end of a step of dt [s] that began at (``particle_q``, ``particle_qd``), without restitution.

    The planes are where they were ``elapsed`` [s] before, and have moved on at their velocities since.
    """
    i = wp.tid()
    row = planes.first[i]
    if particle_inv_mass[i] == real(0.0) or row < 0:
        return
    radius = particle_radius[i]
    slop = wp.max(real(1.0e-3) * radius, real(SMALLEST_SLOP))
    x0 = particle_q[i]
    v0 = particle_qd[i]
    now = Motion()
    now.x = particle_q_out[i]
    now.v = particle_qd_out[i]
    while row >= 0:
        n = planes.normal[row]
        velocity = planes.velocity[row]
        point = planes.point[row] + elapsed * velocity
        carried = dt * velocity
        start_gap = wp.dot(x0 - point, n) - radius
        gap = wp.dot(now.x - point - carried, n) - radius
        if gap <= slop:
            now = resolve(
                x0, v0, now, n, carried, dt, gap, start_gap, slop, planes.friction[row], real(0.0), vec3()
            )  # fmt: skip
        row = planes.next[row]
    particle_q_out[i] = now.x
    particle_qd_out[i] = now.v
