"""Where the path of a particle meets an obstacle: the contact point's normal and the distances of both ends from it.

Fast particles are swept along their path (sphere tracing for analytic shapes, a ray for meshes): no tunnelling.
Meshes are taken two-sided: a particle belongs to the side on which its step began, so no mesh needs an inside.
"""

import warp as wp

from .precision import real, vec3
from .shapes import MESH, Shapes, distance

MAX_MARCH = wp.constant(48)
MAX_CREEP = wp.constant(32)
LOOKS = wp.constant(3)  # for where the surface has carried a particle; each is better by the turn in a step


@wp.struct
class Hit:
    """A contact, in the shape's frame."""

    found: wp.int32
    normal: vec3
    gap: real  # signed distance of the path's end from the contact plane [m]
    start_gap: real  # the same for its start
    surface: vec3  # displacement of a deforming surface during the step [m]


@wp.func
def glancing_touch(kind: int, size: vec3, a: vec3, path: vec3, offset: real, slop: real, marched: real):
    """As :func:`first_touch`, from the share ``marched`` on, by Newton's method: for paths so flat that marching, which
    goes on by no more than the distance, does not arrive. It never goes too far, as all these shapes are convex."""
    touch = real(-1.0)
    t = marched
    for _i in range(MAX_CREEP):
        here = distance(kind, size, a + t * path)
        if here[3] - offset <= slop:
            touch = t
            break
        slope = wp.dot(vec3(here[0], here[1], here[2]), path)
        if slope >= real(0.0):
            break
        t -= (here[3] - offset) / slope
        if t >= real(1.0):
            break
    return touch


@wp.func
def first_touch(kind: int, size: vec3, a: vec3, path: vec3, offset: real, slop: real):
    """Where the path from a comes within ``offset`` of the shape, as a share of it; −1: nowhere."""
    length = wp.length(path)
    touch = real(-1.0)
    t = real(0.0)
    for _i in range(MAX_MARCH):
        here = distance(kind, size, a + t * path)
        if here[3] - offset <= slop:
            touch = t
            break
        t += (here[3] - offset) / length
        if t >= real(1.0):
            break
    if touch < real(0.0) and t < real(1.0):
        touch = glancing_touch(kind, size, a, path, offset, slop, t)
    return touch


@wp.func_grad(first_touch)
def adj_first_touch(kind: int, size: vec3, a: vec3, path: vec3, offset: real, slop: real, adj_ret: real):
    """The march once more, with the derivatives of t: Warp's own adjoint of a loop does not know its earlier values."""
    length = wp.length(path)
    t = real(0.0)
    by_a = vec3()
    by_path = vec3()
    for _i in range(MAX_MARCH):
        here = distance(kind, size, a + t * path)
        gap = here[3] - offset
        if gap <= slop:
            wp.adjoint[a] += adj_ret * by_a
            wp.adjoint[path] += adj_ret * by_path
            t = real(1.0)
            break
        n = vec3(here[0], here[1], here[2])
        slope = real(1.0) + wp.dot(n, path) / length
        by_a = slope * by_a + n / length
        by_path = slope * by_path + (t / length) * n - (gap / (length * length * length)) * path
        t += gap / length
        if t >= real(1.0):
            break
    if t < real(1.0):
        touch = glancing_touch(kind, size, a, path, offset, slop, t)
        if touch >= real(0.0):
            here = distance(kind, size, a + touch * path)
            n = vec3(here[0], here[1], here[2])
            by_end = -(adj_ret / wp.dot(n, path)) * n
            wp.adjoint[a] += by_end
            wp.adjoint[path] += touch * by_end


@wp.func
def analytic_hit(kind: int, size: vec3, a: vec3, b: vec3, offset: real, slop: real):
    """Contact of the path a → b with an analytic shape grown by ``offset``."""
    hit = Hit()
    end = distance(kind, size, b)
    normal = vec3(end[0], end[1], end[2])
    gap = end[3] - offset
    path = b - a
    touch = real(-1.0)
    if wp.length(path) > real(0.5) * offset:
        touch = first_touch(kind, size, a, path, offset, slop)
    if touch >= real(0.0):
        here = distance(kind, size, a + touch * path)
        normal = vec3(here[0], here[1], here[2])
        gap = wp.dot((real(1.0) - touch) * path, normal) + here[3] - offset
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
    carried along with the point of the surface that was nearest to it then. Where that has come to is looked for again
    and again: what is nearest to the start now has another velocity, and on a turning slab what should stick crept
    outwards by its speed times the turn in a step.
    """
    hit = Hit()
    a = a_rest
    if speed > real(0.0):
        reach = offset + slop + speed * dt + wp.length(b - a)
        for _look in range(LOOKS):
            carrier = wp.mesh_query_point_no_sign(mesh, to_float3(a), wp.float32(reach))
            if carrier.result:
                hit.surface = dt * from_float3(wp.mesh_eval_velocity(mesh, carrier.face, carrier.u, carrier.v))
                a = a_rest + hit.surface
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


@wp.func
def mean_friction(particle: real, obstacle: real):
    """Geometric mean; its slope where it is zero is not asked for."""
    product = particle * obstacle
    if product > real(0.0):
        return wp.sqrt(product)
    return real(0.0)
