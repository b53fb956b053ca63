"""Obstacle shapes: signed distance and outward normal in the shape's own frame, and rigid placement in the world.

A new analytic shape is one distance function here and one line in :func:`distance`. Each returns (n, d): the outward
unit normal at the point and its signed distance [m], negative inside.
"""

import sys

import warp as wp

from .motion import Tracks, pose_at, rotation_matrix
from .precision import FORWARD_ONLY, mat33, real, vec3, vec4

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

PLANE = wp.constant(0)
SPHERE = wp.constant(1)
CAPSULE = wp.constant(2)
BOX = wp.constant(3)
MESH = wp.constant(4)


@wp.struct
class Shapes:
    """All obstacles, sorted by world; world w owns shapes ``world_start[w]`` to ``world_start[w + 1]``."""

    world_start: wp.array(dtype=wp.int32)
    world: wp.array(dtype=wp.int32)
    kind: wp.array(dtype=wp.int32)
    size: wp.array(dtype=vec3)
    mesh: wp.array(dtype=wp.uint64)
    mesh_speed: wp.array(dtype=real)
    solid: wp.array(dtype=wp.int32)  # 0 for meshes that are shells
    thickness: wp.array(dtype=real)
    friction: wp.array(dtype=real)
    restitution: wp.array(dtype=real)
    track: wp.array(dtype=wp.int32)
    rest_position: wp.array(dtype=wp.vec3d)
    rest_rotation: wp.array(dtype=wp.vec3d)
    pivot: wp.array(dtype=wp.vec3d)


@wp.struct
class Placement:
    """Shape frame to world: x = rotation · x_local + position."""

    position: vec3
    rotation: mat33


@wp.func
def to_local(place: Placement, x: vec3):
    return wp.transpose(place.rotation) * (x - place.position)


@wp.func
def to_world(place: Placement, x: vec3):
    return place.rotation * x + place.position


@wp.func
def sphere_distance(x: vec3, radius: real):
    length = wp.length(x)
    n = vec3(real(0.0), real(0.0), real(1.0))
    if length > real(0.0):
        n = x / length
    return vec4(n[0], n[1], n[2], length - radius)


@wp.func
def capsule_distance(x: vec3, radius: real, half_length: real):
    z = wp.clamp(x[2], -half_length, half_length)
    return sphere_distance(vec3(x[0], x[1], x[2] - z), radius)


@wp.func
def box_distance(x: vec3, half: vec3):
    """Exact outside and inside; inside, the normal points to the nearest face."""
    q = vec3(wp.abs(x[0]) - half[0], wp.abs(x[1]) - half[1], wp.abs(x[2]) - half[2])
    sign = vec3(wp.sign(x[0]), wp.sign(x[1]), wp.sign(x[2]))
    outside = vec3(wp.max(q[0], real(0.0)), wp.max(q[1], real(0.0)), wp.max(q[2], real(0.0)))
    away = wp.length(outside)
    if away > real(0.0):
        n = wp.cw_mul(outside, sign) / away
        return vec4(n[0], n[1], n[2], away)
    if q[0] >= q[1] and q[0] >= q[2]:
        return vec4(sign[0], real(0.0), real(0.0), q[0])
    if q[1] >= q[2]:
        return vec4(real(0.0), sign[1], real(0.0), q[1])
    return vec4(real(0.0), real(0.0), sign[2], q[2])


@wp.func
def distance(kind: int, size: vec3, x: vec3):
    """Outward normal and signed distance of an analytic shape at local point x."""
    if kind == SPHERE:
        return sphere_distance(x, size[0])
    if kind == CAPSULE:
        return capsule_distance(x, size[0], size[1])
    if kind == BOX:
        return box_distance(x, size)
    return vec4(real(0.0), real(0.0), real(1.0), x[2])


@wp.func
def to_real3(x: wp.vec3d):
    return vec3(real(x[0]), real(x[1]), real(x[2]))


@wp.func
def placement_at(shapes: Shapes, tracks: Tracks, s: int, t: wp.float64):
    """Where shape s is at time t [s]: its rest placement moved by its motion about its pivot."""
    position = shapes.rest_position[s]
    rotation = rotation_matrix(shapes.rest_rotation[s])
    if shapes.track[s] >= 0:
        pose = pose_at(tracks, shapes.track[s], t)
        turn = rotation_matrix(pose.rotation)
        position = shapes.pivot[s] + turn * (position - shapes.pivot[s]) + pose.position
        rotation = turn * rotation
    place = Placement()
    place.position = to_real3(position)
    for i in range(3):
        for j in range(3):
            place.rotation[i, j] = real(rotation[i, j])
    return place


@wp.kernel
def place_shapes(
    # Model
    shapes: Shapes,
    tracks: Tracks,
    # State in
    world_time: wp.array(dtype=wp.float64),
    dt: wp.float64,
    # Out
    start_out: wp.array(dtype=Placement),
    end_out: wp.array(dtype=Placement),
):
    """Placements of every shape at the beginning and at the end of a step of dt [s]."""
    s = wp.tid()
    t = world_time[shapes.world[s]]
    start_out[s] = placement_at(shapes, tracks, s, t)
    end_out[s] = placement_at(shapes, tracks, s, t + dt)


@wp.kernel
def sample_mesh_points(
    # Model
    sample_times: wp.array(dtype=wp.float64),
    sample_points: wp.array2d(dtype=wp.vec3),
    world: int,
    # State in
    world_time: wp.array(dtype=wp.float64),
    dt: wp.float64,
    # Out
    points_out: wp.array(dtype=wp.vec3),
    velocities_out: wp.array(dtype=wp.vec3),
):
    """Points of a deforming mesh at the end of a step of dt [s], and their mean velocity over it."""
    i = wp.tid()
    t = world_time[world]
    x0 = sampled_point(sample_times, sample_points, i, t)
    x1 = sampled_point(sample_times, sample_points, i, t + dt)
    points_out[i] = x1
    v = wp.vec3()
    if dt > wp.float64(0.0):
        v = (x1 - x0) / wp.float32(dt)
    velocities_out[i] = v


@wp.func
def sampled_point(times: wp.array(dtype=wp.float64), points: wp.array2d(dtype=wp.vec3), i: int, t: wp.float64):
    """Linear interpolation between samples, held at both ends."""
    last = times.shape[0] - 1
    if t <= times[0]:
        return points[0, i]
    if t >= times[last]:
        return points[last, i]
    k = int(0)
    while k + 1 < last and times[k + 1] <= t:
        k += 1
    a = wp.float32((t - times[k]) / (times[k + 1] - times[k]))
    return points[k, i] + a * (points[k + 1, i] - points[k, i])
