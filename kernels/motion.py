"""Keyframed rigid motion, evaluated on the device so that a captured graph needs no host.

A motion maps a rest position x₀ to x(t) = c + R(t)(x₀ − c) + p(t) about a pivot c. p and the rotation vector θ of
R = exp(θ×) are interpolated component-wise between keys, linearly or with smoothstep easing. All of it in float64: few
particles and shapes use it, and differences of large times must stay exact.
"""

import sys

import warp as wp

from .precision import OPTIONS, real, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.struct
class Tracks:
    """Keys of all motions, one after the other; motion k owns keys ``start[k]`` to ``start[k + 1]``."""

    start: wp.array(dtype=wp.int32)
    smooth: wp.array(dtype=wp.int32)
    loop: wp.array(dtype=wp.int32)
    times: wp.array(dtype=wp.float64)
    positions: wp.array(dtype=wp.vec3d)
    rotations: wp.array(dtype=wp.vec3d)


@wp.struct
class Pose:
    """p [m], θ [rad] and their time derivatives."""

    position: wp.vec3d
    rotation: wp.vec3d
    velocity: wp.vec3d
    rotation_rate: wp.vec3d


@wp.func
def local_time(tracks: Tracks, track: int, t: wp.float64):
    """Time within the keys: a looping motion repeats with the time of its last key."""
    period = tracks.times[tracks.start[track + 1] - 1]
    if tracks.loop[track] == 1:
        return t - period * wp.floor(t / period)
    return t


@wp.func
def pose_at(tracks: Tracks, track: int, t: wp.float64):
    """Pose of motion ``track`` at time t [s]; held before the first and after the last key."""
    first = tracks.start[track]
    last = tracks.start[track + 1] - 1
    s = local_time(tracks, track, t)
    pose = Pose()
    if s < tracks.times[first]:
        pose.position = tracks.positions[first]
        pose.rotation = tracks.rotations[first]
        return pose
    if s >= tracks.times[last]:
        pose.position = tracks.positions[last]
        pose.rotation = tracks.rotations[last]
        return pose
    k = first
    while k + 1 < last and tracks.times[k + 1] <= s:
        k += 1
    span = tracks.times[k + 1] - tracks.times[k]
    a = (s - tracks.times[k]) / span
    rate = wp.float64(1.0) / span
    if tracks.smooth[track] == 1:
        rate = wp.float64(6.0) * a * (wp.float64(1.0) - a) / span
        a = a * a * (wp.float64(3.0) - wp.float64(2.0) * a)
    dp = tracks.positions[k + 1] - tracks.positions[k]
    dr = tracks.rotations[k + 1] - tracks.rotations[k]
    pose.position = tracks.positions[k] + a * dp
    pose.rotation = tracks.rotations[k] + a * dr
    pose.velocity = rate * dp
    pose.rotation_rate = rate * dr
    return pose


@wp.func
def rotation_matrix(theta: wp.vec3d):
    """exp(θ×), Rodrigues' formula; identity for θ = 0 exactly."""
    angle = wp.length(theta)
    q = wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    if angle > wp.float64(0.0):
        q = wp.quat_from_axis_angle(theta / angle, angle)
    return wp.quat_to_matrix(q)


@wp.func
def angular_velocity(theta: wp.vec3d, rate: wp.vec3d):
    """ω of R = exp(θ×) when θ changes at ``rate``: the left Jacobian of SO(3) times the rate."""
    angle = wp.length(theta)
    b = wp.float64(0.5)
    c = wp.float64(1.0) / wp.float64(6.0)
    if angle > wp.float64(1.0e-4):
        b = (wp.float64(1.0) - wp.cos(angle)) / (angle * angle)
        c = (angle - wp.sin(angle)) / (angle * angle * angle)
    cross = wp.cross(theta, rate)
    return rate + b * cross + c * wp.cross(theta, cross)


@wp.kernel
def drive_pins(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    pin_particle: wp.array(dtype=wp.int32),
    pin_track: wp.array(dtype=wp.int32),
    pin_rest: wp.array(dtype=wp.vec3d),
    pin_pivot: wp.array(dtype=wp.vec3d),
    tracks: Tracks,
    # State in
    world_time: wp.array(dtype=wp.float64),
    time_offset: wp.float64,
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """Puts moving pins where their motion is at the world's time + ``time_offset``, with the exact velocity."""
    k = wp.tid()
    i = pin_particle[k]
    pose = pose_at(tracks, pin_track[k], world_time[particle_world[i]] + time_offset)
    arm = rotation_matrix(pose.rotation) * (pin_rest[k] - pin_pivot[k])
    x = pin_pivot[k] + arm + pose.position
    v = pose.velocity + wp.cross(angular_velocity(pose.rotation, pose.rotation_rate), arm)
    particle_q_out[i] = vec3(real(x[0]), real(x[1]), real(x[2]))
    particle_qd_out[i] = vec3(real(v[0]), real(v[1]), real(v[2]))


@wp.kernel
def lead_pins(
    # Model
    particle_inv_mass: wp.array(dtype=real),
    pin_particle: wp.array(dtype=wp.int32),
    # State in
    pin_place: wp.array(dtype=wp.vec3d),
    pin_velocity: wp.array(dtype=vec3),
    time_offset: wp.float64,
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """Puts led pins where they are ``time_offset`` [s] after they were at their places; not what is not held."""
    k = wp.tid()
    i = pin_particle[k]
    if particle_inv_mass[i] > real(0.0):
        return
    v = pin_velocity[k]
    x = pin_place[k] + time_offset * wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))
    particle_q_out[i] = vec3(real(x[0]), real(x[1]), real(x[2]))
    particle_qd_out[i] = v
