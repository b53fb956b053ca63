"""Response of particles to obstacles at the end of a step: non-penetration, restitution, Coulomb friction.

For each particle the step gave a path from x₀ to x₁ and a velocity v₁. A contact is a point of the shape's surface
moved out by the contact distance, with its normal n and the displacement of the obstacle's material there. Then

* the normal velocity relative to the obstacle becomes −e times the approach speed from *before* the step (so that a
  resting particle, which gravity accelerates within each step, does not bounce);
* friction takes at most μ times the normal impulse from the tangential relative velocity (Coulomb's cone, sticking
  included), and the same fraction from the tangential relative displacement, so that positions and velocities agree for
  any integrator and any number of substeps;
* the position is put back on the offset surface. What sticks keeps its place on the obstacle to the last bit: no creep.

Fast particles are swept along their path (sphere tracing for analytic shapes, a ray for meshes): no tunnelling.
Meshes are taken two-sided: a particle belongs to the side on which its step began, so no mesh needs an inside.
"""

import sys

import warp as wp

from .precision import OPTIONS, real, vec3
from .shapes import MESH, Placement, Shapes, distance, to_local, to_world

wp.set_module_options(OPTIONS, module=sys.modules[__name__])

MAX_PASSES = wp.constant(4)
MAX_MARCH = wp.constant(48)


@wp.struct
class Hit:
    """A contact, in the shape's frame."""

    found: wp.int32
    normal: vec3
    gap: real  # signed distance of the path's end from the contact plane [m]
    start_gap: real  # the same for its start
    surface: vec3  # displacement of a deforming surface during the step [m]


@wp.func
def analytic_hit(kind: int, size: vec3, a: vec3, b: vec3, offset: real, slop: real):
    """Contact of the path a → b with an analytic shape grown by ``offset``."""
    hit = Hit()
    end = distance(kind, size, b)
    normal = vec3(end[0], end[1], end[2])
    gap = end[3] - offset
    path = b - a
    length = wp.length(path)
    if length > real(0.5) * offset:
        t = real(0.0)
        for _i in range(MAX_MARCH):
            here = distance(kind, size, a + t * path)
            if here[3] - offset <= slop:
                normal = vec3(here[0], here[1], here[2])
                gap = wp.dot((real(1.0) - t) * path, normal) + here[3] - offset
                break
            t += (here[3] - offset) / length
            if t >= real(1.0):
                break
    if gap <= slop:
        start = distance(kind, size, a)
        hit.found = 1
        hit.normal = normal
        hit.gap = gap
        hit.start_gap = start[3] - offset
    return hit


@wp.func
def to_float3(x: vec3):
    return wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))


@wp.func
def from_float3(x: wp.vec3):
    return vec3(real(x[0]), real(x[1]), real(x[2]))


@wp.func
def surface_point(mesh: wp.uint64, face: int, u: wp.float32, v: wp.float32):
    """The point of barycentric coordinates (u, v), evaluated in the precision of this variant."""
    m = wp.mesh_get(mesh)
    p = from_float3(m.points[m.indices[3 * face]])
    q = from_float3(m.points[m.indices[3 * face + 1]])
    r = from_float3(m.points[m.indices[3 * face + 2]])
    return real(u) * p + real(v) * q + (real(1.0) - real(u) - real(v)) * r


@wp.func
def face_normal(mesh: wp.uint64, face: int):
    m = wp.mesh_get(mesh)
    p = from_float3(m.points[m.indices[3 * face]])
    q = from_float3(m.points[m.indices[3 * face + 1]])
    r = from_float3(m.points[m.indices[3 * face + 2]])
    return wp.normalize(wp.cross(q - p, r - p))


@wp.func
def mesh_hit(mesh: wp.uint64, speed: real, dt: real, a_rest: vec3, b: vec3, offset: real, slop: real):
    """Contact of the path a → b with a triangle mesh, either side, grown by ``offset``.

    A deforming mesh (``speed`` > 0, its greatest [m/s]) lies here as at the end of the step; the path's start is
    carried along with the surface nearest to it.
    """
    hit = Hit()
    a = a_rest
    if speed > real(0.0):
        reach = offset + slop + speed * dt + wp.length(b - a)
        carrier = wp.mesh_query_point_no_sign(mesh, to_float3(a), wp.float32(reach))
        if carrier.result:
            hit.surface = dt * from_float3(wp.mesh_eval_velocity(mesh, carrier.face, carrier.u, carrier.v))
            a = a + hit.surface
    path = b - a
    length = wp.length(path)
    near = wp.mesh_query_point_no_sign(mesh, to_float3(b), wp.float32(offset + slop))
    if (near.result or length > real(0.5) * offset) and length > real(0.0):
        along = path / length
        ray = wp.mesh_query_ray(mesh, to_float3(a), to_float3(along), wp.float32(length))
        if ray.result:
            n = face_normal(mesh, ray.face)
            if wp.dot(n, along) > real(0.0):
                n = -n
            on = surface_point(mesh, ray.face, ray.u, ray.v)
            hit.found = 1
            hit.normal = n
            hit.gap = wp.dot(b - on, n) - offset
            hit.start_gap = wp.dot(a - on, n) - offset
            return hit
    if near.result:
        on = surface_point(mesh, near.face, near.u, near.v)
        away = b - on
        d = wp.length(away)
        n = face_normal(mesh, near.face)
        if d > real(0.01) * offset:
            n = away / d
        elif wp.dot(n, a - on) < real(0.0):
            n = -n
        hit.found = 1
        hit.normal = n
        hit.gap = wp.dot(away, n) - offset
        hit.start_gap = wp.dot(a - on, n) - offset
    return hit


@wp.func
def find_hit(shapes: Shapes, s: int, dt: real, a: vec3, b: vec3, offset: real, slop: real):
    if shapes.kind[s] == MESH:
        return mesh_hit(shapes.mesh[s], shapes.mesh_speed[s], dt, a, b, offset, slop)
    return analytic_hit(shapes.kind[s], shapes.size[s], a, b, offset, slop)


@wp.struct
class Motion:
    """End position [m] and velocity [m/s] of a particle."""

    x: vec3
    v: vec3


@wp.func
def resolve(
    x0: vec3, v0: vec3, end: Motion, n: vec3, carried: vec3, dt: real, gap: real, start_gap: real, slop: real,
    friction: real, restitution: real, given: vec3,
):  # fmt: skip
    """Motion after one contact with plane normal n; ``carried`` is the obstacle's displacement there [m].

    ``given`` is what the obstacle has already done to the velocity within the step [m/s]: its normal part counts for
    friction, and friction is put right to what Coulomb's law says, be it more or less.
    """
    out = Motion()
    surface_velocity = carried / dt
    v = end.v - surface_velocity
    approach = wp.min(wp.dot(v0 - surface_velocity, n), real(0.0))
    vn = wp.dot(v, n)
    held = wp.max(wp.dot(given, n), real(0.0))
    rubbed = given - wp.dot(given, n) * n
    impulse = -restitution * approach - vn
    tangential = v - vn * n
    change = -rubbed
    stuck = int(0)
    if impulse > real(0.0) or held > real(0.0):
        wanted = rubbed - tangential
        most = friction * (wp.max(impulse, real(0.0)) + held)
        size = wp.length(wanted)
        if size <= most:
            stuck = int(1)
            change = -tangential
        else:
            change = (most / size) * wanted - rubbed
        out.v = tangential + change + (vn + wp.max(impulse, real(0.0))) * n + surface_velocity
    else:
        out.v = v + change + surface_velocity
    resting = wp.abs(start_gap) <= slop
    if stuck == 1 and resting:
        out.x = x0 + carried
        return out
    moved = end.x - x0 - carried
    normal_part = wp.dot(moved, n)
    in_contact = real(1.0)
    if start_gap > slop and normal_part < real(0.0):
        in_contact = wp.clamp(gap / normal_part, real(0.0), real(1.0))
    slip = wp.length(tangential)
    slide = in_contact * (moved - normal_part * n)
    if wp.dot(given, given) > real(0.0):
        slide = -dt * change
    elif stuck == 0:
        slide = (wp.length(change) / wp.max(slip, real(1.0e-30))) * slide
    out.x = end.x - slide + wp.max(-gap, real(0.0)) * n
    return out


@wp.kernel
def respond(
    # Model
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    particle_radius: wp.array(dtype=real),
    particle_friction: wp.array(dtype=real),
    shapes: Shapes,
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    start: wp.array(dtype=Placement),
    end: wp.array(dtype=Placement),
    dt: real,
    impulse: wp.array(dtype=vec3),
    impulse_shape: wp.array(dtype=wp.int32),
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """Corrects the end of a step (``_out``) that began at (``particle_q``, ``particle_qd``) against every obstacle.

    ``impulse`` [m/s] of obstacle ``impulse_shape``, unless that is −1, is already in the velocities.
    """
    i = wp.tid()
    if particle_inv_mass[i] == real(0.0):
        return
    w = particle_world[i]
    x0 = particle_q[i]
    v0 = particle_qd[i]
    now = Motion()
    now.x = particle_q_out[i]
    now.v = particle_qd_out[i]
    for s in range(shapes.world_start[w], shapes.world_start[w + 1]):
        offset = particle_radius[i] + shapes.thickness[s]
        slop = real(1.0e-3) * offset
        friction = wp.sqrt(particle_friction[i] * shapes.friction[s])
        a = to_local(start[s], x0)
        given = vec3()
        if impulse_shape[i] == s:
            given = impulse[i]
        for _pass in range(MAX_PASSES):
            b = to_local(end[s], now.x)
            hit = find_hit(shapes, s, dt, a, b, offset, slop)
            if hit.found == 0:
                break
            n = end[s].rotation * hit.normal
            carried = to_world(end[s], a) - to_world(start[s], a) + end[s].rotation * hit.surface
            now = resolve(
                x0, v0, now, n, carried, dt, hit.gap, hit.start_gap, slop, friction, shapes.restitution[s], given
            )  # fmt: skip
            given = vec3()
            if hit.gap > -slop:
                break
    particle_q_out[i] = now.x
    particle_qd_out[i] = now.v
