"""Newton's particles, springs and contacts in the terms of this package; Newton's own arrays are float32 throughout."""

import sys

import warp as wp

from .contact_planes import Planes
from .precision import OPTIONS, real, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])

ACTIVE = wp.constant(wp.int32(1))


@wp.kernel
def convert_springs(
    # Model
    rest_length: wp.array(dtype=wp.float32),
    stiffness: wp.array(dtype=wp.float32),
    damping: wp.array(dtype=wp.float32),
    # Out
    stiffness_out: wp.array(dtype=real),
    damping_out: wp.array(dtype=real),
):
    """From Newton's stiffness [N/m] and damping [N s/m] to k_s [N] and k_d [N s]: both times the rest length."""
    s = wp.tid()
    r = real(rest_length[s])
    stiffness_out[s] = real(stiffness[s]) * r
    damping_out[s] = real(damping[s]) * r


@wp.kernel
def free_particles(
    # Model
    particle_flags: wp.array(dtype=wp.int32),
    particle_inv_mass: wp.array(dtype=wp.float32),
    # Out
    inv_mass_out: wp.array(dtype=real),
):
    """Inverse masses with which particles move now: 0 for those that are not active."""
    i = wp.tid()
    inv_mass = real(0.0)
    if (particle_flags[i] & ACTIVE) != 0:
        inv_mass = real(particle_inv_mass[i])
    inv_mass_out[i] = inv_mass


@wp.func
def is_kinematic(flags: wp.int32, inv_mass: wp.float32):
    """Whether a particle goes on at its velocity: active, and without inverse mass."""
    return (flags & ACTIVE) != 0 and inv_mass == wp.float32(0.0)


@wp.kernel
def lead_kinematic(
    # Model
    particle_flags: wp.array(dtype=wp.int32),
    particle_inv_mass: wp.array(dtype=wp.float32),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    place_out: wp.array(dtype=wp.vec3d),
    velocity_out: wp.array(dtype=vec3),
):
    """Where particles are, and at what velocity they go on if they are held: those that are not active stay."""
    i = wp.tid()
    x = particle_q[i]
    place_out[i] = wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2]))
    velocity_out[i] = vec3()
    if is_kinematic(particle_flags[i], particle_inv_mass[i]):
        velocity_out[i] = particle_qd[i]


@wp.kernel
def keep_velocities(
    # Model
    particle_flags: wp.array(dtype=wp.int32),
    # State in
    particle_qd: wp.array(dtype=vec3),
    # Out
    particle_qd_out: wp.array(dtype=vec3),
):
    """Particles that are not active keep their velocity, though they stay."""
    i = wp.tid()
    if (particle_flags[i] & ACTIVE) == 0:
        particle_qd_out[i] = particle_qd[i]


@wp.func
def exact(x: wp.vec3):
    return vec3(real(x[0]), real(x[1]), real(x[2]))


@wp.kernel
def planes_of_contacts(
    # Model
    body_com: wp.array(dtype=wp.vec3),
    shape_body: wp.array(dtype=wp.int32),
    shape_friction: wp.array(dtype=wp.float32),
    shape_margin: wp.array(dtype=wp.float32),
    particle_count: int,
    particle_friction: wp.float32,
    # State in
    body_q: wp.array(dtype=wp.transform),
    body_qd: wp.array(dtype=wp.spatial_vector),
    contact_count: wp.array(dtype=wp.int32),
    contact_particle: wp.array(dtype=wp.int32),
    contact_shape: wp.array(dtype=wp.int32),
    contact_point: wp.array(dtype=wp.vec3),
    contact_velocity: wp.array(dtype=wp.vec3),
    contact_normal: wp.array(dtype=wp.vec3),
    # Out
    planes_out: Planes,
):
    """Newton's soft contacts as planes. Point and velocity are the body's own, so they turn and move with it.

    A shape acts as if it were its margin further out, but Newton lists points of the shape itself.
    The friction of a pair is the mean of both coefficients, as in Newton's own solvers. Contacts do not say whose they
    are: those of particles or shapes that this model does not have, as another one's are, get none.
    """
    row = wp.tid()
    if row >= contact_count[0]:
        return
    shape = contact_shape[row]
    particle = contact_particle[row]
    planes_out.particle[row] = -1
    if particle < 0 or particle >= particle_count or shape < 0 or shape >= shape_body.shape[0]:
        return
    body = shape_body[shape]
    point = contact_point[row]
    velocity = contact_velocity[row]
    outwards = shape_margin[shape] * contact_normal[row]
    if body < 0:
        point = point + outwards
    else:
        place = body_q[body]
        twist = body_qd[body]
        point = wp.transform_point(place, point) + outwards
        arm = point - wp.transform_point(place, body_com[body])
        turning = wp.cross(wp.spatial_bottom(twist), arm)
        velocity = wp.spatial_top(twist) + turning + wp.transform_vector(place, velocity)
    planes_out.particle[row] = particle
    planes_out.point[row] = exact(point)
    planes_out.normal[row] = exact(contact_normal[row])
    planes_out.velocity[row] = exact(velocity)
    planes_out.friction[row] = real(0.5 * (particle_friction + shape_friction[shape]))
