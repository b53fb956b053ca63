"""Obstacles as forces inside an implicit step: what stands on them is held up while the springs are solved for.

A particle closer to an obstacle than its contact distance plus ``slop`` is pushed out by a stiff spring, so stiff that
it gives way by micrometres: κ = ``STIFFNESS`` m/h², but not so stiff that the rounding of float32 hides by how much.
(With steps of 0.5 ms rounding then pushed harder than the weight, friction followed it, and cloth stuck to a slope
twice as steep as it can hold on to.) Coulomb friction acts on it against its slip relative to the obstacle, smoothed
where the particle sticks: there it slips by 1/``GRIP`` of what it would without friction. Both only bring the solution
near the true one. The response at the end of the step makes contact exact, and for that it needs to know the impulse
that was given here.

What begins a step within the contact distance, as clothes do that are cut close to a body, is held where it is: pushed
all the way out within the step it would leave at that way over the step, metres per second for millimetres. The
response puts it on the surface, and gives it no velocity for that.

Where a path meets an obstacle can jump as its end moves by next to nothing, from one face of a mesh to another, and
then there may be no solution. So once a particle was in ``free_looks`` places in a step it keeps the plane that it met:
from then on its force is continuous.
"""

import sys

import warp as wp

from .obstacle_hit import Hit, analytic_hit, find_hit, mean_friction
from .precision import OPTIONS, mat33, real, vec3
from .shapes import Placement, Shapes, to_local, to_world

wp.set_module_options(OPTIONS, module=sys.modules[__name__])

STIFFNESS = wp.constant(1.0e2)
GRIP = wp.constant(2.0e1)
GRAVITY = wp.constant(9.81)  # [m/s²]
SINK = wp.constant(0.3)  # of ``slop``, at least, by which a particle's own weight presses it in


@wp.struct
class Held:
    """What one obstacle does to one particle."""

    depth: real  # [m]
    force: vec3  # [N]
    stiffness: mat33  # [N/m]
    damping: mat33  # [N s/m]
    sliding: mat33  # what of the damping is too much, as sliding friction keeps its size


@wp.func
def held_by(
    hit: Hit, start: Placement, end: Placement, a: vec3, v: vec3, mass: real, slop: real, friction: real, dt: real,
    gamma: real,
):  # fmt: skip
    """The force of an obstacle on a particle of velocity v that began the step at a in its frame, and its blocks."""
    held = Held()
    held.depth = slop - hit.gap + wp.min(hit.start_gap + slop, real(0.0))
    if hit.found == 0 or held.depth <= real(0.0):
        held.depth = real(0.0)
        return held
    kappa = mass * wp.min(real(STIFFNESS) / (dt * dt), real(GRAVITY) / (real(SINK) * slop))
    n = end.rotation * hit.normal
    carried = to_world(end, a) - to_world(start, a) + end.rotation * hit.surface
    u = v - carried / dt
    u = u - wp.dot(u, n) * n
    most = friction * kappa * held.depth
    drag = real(GRIP) * mass / gamma
    if most < drag * wp.length(u):
        drag = most / wp.length(u)
        held.sliding = drag * wp.outer(u, u) / wp.dot(u, u)
    outer = wp.outer(n, n)
    held.stiffness = kappa * outer
    held.damping = drag * (wp.identity(n=3, dtype=real) - outer)
    held.force = kappa * held.depth * n - drag * u
    return held


@wp.struct
class Planes:
    """What each particle met in this step: where it was last (``seen``, in the world) and how often it had come to
    another place (``looks``); and the latest contact where it was deepest: the obstacle (−1: none), and in its frame
    the contact's normal and surface, where the particle was (``spot``), and how far from it then (``gap``) and when the
    step began (``start_gap``)."""

    seen: wp.array(dtype=vec3)
    looks: wp.array(dtype=wp.int32)
    shape: wp.array(dtype=wp.int32)
    normal: wp.array(dtype=vec3)
    surface: wp.array(dtype=vec3)
    spot: wp.array(dtype=vec3)
    gap: wp.array(dtype=real)
    start_gap: wp.array(dtype=real)


@wp.func
def look(planes_out: Planes, i: int, here: vec3, free_looks: int):
    """The obstacle whose plane the particle keeps; −1: none.

    Evaluations in the same place do not count: others in its world, or other worlds, may ask for them.
    """
    same = here == planes_out.seen[i]
    if planes_out.looks[i] == 0 or not same:
        planes_out.seen[i] = here
        planes_out.looks[i] = planes_out.looks[i] + 1
    kept = int(-1)
    if planes_out.looks[i] > free_looks:
        kept = planes_out.shape[i]
    return kept


@wp.func
def keep(planes_out: Planes, i: int, shape: int, hit: Hit, b: vec3):
    planes_out.shape[i] = shape
    planes_out.normal[i] = hit.normal
    planes_out.surface[i] = hit.surface
    planes_out.spot[i] = b
    planes_out.gap[i] = hit.gap
    planes_out.start_gap[i] = hit.start_gap


@wp.func
def kept_hit(planes: Planes, i: int, b: vec3):
    """The contact of a path that ends at b with the plane that was met before; at its ``spot`` it is that contact."""
    hit = Hit()
    hit.found = 1
    hit.normal = planes.normal[i]
    hit.surface = planes.surface[i]
    hit.gap = planes.gap[i] + wp.dot(hit.normal, b - planes.spot[i])
    hit.start_gap = planes.start_gap[i]
    return hit


@wp.kernel(enable_backward=False)
def support(
    # Model
    thread_offset: int,
    particle_mass: wp.array(dtype=real),
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    particle_radius: wp.array(dtype=real),
    particle_friction: wp.array(dtype=real),
    shapes: Shapes,
    # State in
    particle_start: wp.array(dtype=vec3),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    start: wp.array(dtype=Placement),
    end: wp.array(dtype=Placement),
    dt: real,
    gamma: real,
    free_looks: int,
    # Out
    particle_f_out: wp.array(dtype=vec3),
    stiffness_out: wp.array(dtype=mat33),
    damping_out: wp.array(dtype=mat33),
    sliding_out: wp.array(dtype=mat33),
    impulse_out: wp.array(dtype=vec3),
    shape_out: wp.array(dtype=wp.int32),
    planes_out: Planes,
):
    """Adds the forces; their 3×3 stiffness and damping blocks, what of the damping is too much as friction keeps its
    size, the velocity that they give to the particle in a step of weight ``gamma``, and the obstacle that gives most
    of it."""
    i = thread_offset + wp.tid()
    total = Held()
    impulse = vec3()
    shape = int(-1)
    if particle_inv_mass[i] > real(0.0):
        w = particle_world[i]
        kept = look(planes_out, i, particle_q[i], free_looks)
        mass = particle_mass[i]
        for s in range(shapes.world_start[w], shapes.world_start[w + 1]):
            offset = particle_radius[i] + shapes.thickness[s]
            slop = real(1.0e-3) * offset
            friction = mean_friction(particle_friction[i], shapes.friction[s])
            a = to_local(start[s], particle_start[i])
            b = to_local(end[s], particle_q[i])
            hit = Hit()
            if s == kept:
                hit = kept_hit(planes_out, i, b)
            else:
                hit = find_hit(shapes, s, dt, a, b, offset, slop)
            held = held_by(hit, start[s], end[s], a, particle_qd[i], mass, slop, friction, dt, gamma)
            total.force += held.force
            total.stiffness += held.stiffness
            total.damping += held.damping
            total.sliding += held.sliding
            if held.depth > total.depth:
                total.depth = held.depth
                shape = s
                impulse = (gamma / mass) * held.force
                if kept < 0:
                    keep(planes_out, i, s, hit, b)
        particle_f_out[i] = particle_f_out[i] + total.force
    stiffness_out[i] = total.stiffness
    damping_out[i] = total.damping
    sliding_out[i] = total.sliding
    impulse_out[i] = impulse
    shape_out[i] = shape


@wp.kernel
def support_once(
    # Model
    particle_mass: wp.array(dtype=real),
    particle_inv_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    particle_radius: wp.array(dtype=real),
    particle_friction: wp.array(dtype=real),
    shapes: Shapes,
    # State in
    particle_start: wp.array(dtype=vec3),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    start: wp.array(dtype=Placement),
    end: wp.array(dtype=Placement),
    dt: real,
    gamma: real,
    shape: wp.array(dtype=wp.int32),
    number: int,
    # Out
    particle_f_out: wp.array(dtype=vec3),
    impulse_out: wp.array(dtype=vec3),
):
    """Force of the obstacle ``number`` of each world, no mesh, and its impulse if it is ``shape`` of the particle.

    Without the loop of :func:`support`, as adjoints of loops do not know earlier values.
    """
    i = wp.tid()
    s = shapes.world_start[particle_world[i]] + number
    if particle_inv_mass[i] > real(0.0) and s < shapes.world_start[particle_world[i] + 1]:
        mass = particle_mass[i]
        offset = particle_radius[i] + shapes.thickness[s]
        slop = real(1.0e-3) * offset
        friction = mean_friction(particle_friction[i], shapes.friction[s])
        a = to_local(start[s], particle_start[i])
        hit = analytic_hit(shapes.kind[s], shapes.size[s], a, to_local(end[s], particle_q[i]), offset, slop)
        held = held_by(hit, start[s], end[s], a, particle_qd[i], mass, slop, friction, dt, gamma)
        particle_f_out[i] = particle_f_out[i] + held.force
        if shape[i] == s:
            impulse_out[i] = (gamma / mass) * held.force


@wp.func
def block(stiffness: mat33, damping: mat33, sliding: mat33, project: real, a: real, b: real):
    """a K + b C; friction as if it grew with the slip, which makes far steps safe, as long as projection is wanted."""
    if project > real(0.0):
        return a * stiffness + b * damping
    return a * stiffness + b * (damping - sliding)


@wp.kernel(enable_backward=False)
def products(
    # Model
    thread_offset: int,
    particle_world: wp.array(dtype=wp.int32),
    # State in
    world_project: wp.array(dtype=real),
    stiffness: wp.array(dtype=mat33),
    damping: wp.array(dtype=mat33),
    sliding: wp.array(dtype=mat33),
    x: wp.array(dtype=vec3),
    a: real,
    b: real,
    # Out
    product_out: wp.array(dtype=vec3),
):
    """Adds (a K + b C) x."""
    i = thread_offset + wp.tid()
    project = world_project[particle_world[i]]
    product_out[i] = product_out[i] + block(stiffness[i], damping[i], sliding[i], project, a, b) * x[i]


@wp.kernel(enable_backward=False)
def diagonal(
    # Model
    thread_offset: int,
    particle_world: wp.array(dtype=wp.int32),
    # State in
    world_project: wp.array(dtype=real),
    stiffness: wp.array(dtype=mat33),
    damping: wp.array(dtype=mat33),
    sliding: wp.array(dtype=mat33),
    a: real,
    b: real,
    # Out
    blocks_out: wp.array(dtype=mat33),
):
    """Adds a K + b C."""
    i = thread_offset + wp.tid()
    project = world_project[particle_world[i]]
    blocks_out[i] = blocks_out[i] + block(stiffness[i], damping[i], sliding[i], project, a, b)
