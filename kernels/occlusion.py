"""What reaches a point of a surface: how much of the sun, of the sky above and of the ground below it sees.

Rays are traced against one mesh that holds everything which casts shadows. In float32 in every variant, as mesh queries
are.
"""

import sys

import warp as wp

from .precision import FORWARD_ONLY

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

BEHIND = wp.constant(wp.float32(-0.2))  # cosine to the sun below which a point cannot see it, however its surface bends


@wp.func
def is_free(mesh: wp.uint64, origin: wp.vec3, direction: wp.vec3, reach: wp.float32):
    """1 if the ray leaves without a hit within ``reach``, else 0."""
    if wp.mesh_query_ray_anyhit(mesh, origin, direction, reach):
        return wp.float32(0.0)
    return wp.float32(1.0)


@wp.func
def tangent_of(n: wp.vec3):
    """A unit vector at right angles to the unit vector n."""
    if wp.abs(n[2]) < wp.float32(0.9):
        return wp.normalize(wp.cross(n, wp.vec3(0.0, 0.0, 1.0)))
    return wp.normalize(wp.cross(n, wp.vec3(1.0, 0.0, 0.0)))


@wp.kernel
def gather_light(
    # Model
    mesh: wp.uint64,
    sun_directions: wp.array(dtype=wp.vec3),
    sky_directions: wp.array(dtype=wp.vec3),
    reach: wp.float32,
    # State in
    first: wp.int32,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    # Out
    light_out: wp.array(dtype=wp.vec3),
):
    """Visible share of the sun's disc; free shares of the cosine-weighted sky above and ground below.

    The cosine to the sun is left to whoever draws, who has finer normals. ``sun_directions`` are directions to points
    of the sun's disc, in the world; ``sky_directions`` are distributed by the cosine about the z axis, which is turned
    to each normal. Points lie off the surface, on the side that is lit.
    """
    k = first + wp.tid()
    n = normals[k]
    origin = points[k]
    sun = wp.float32(0.0)
    for s in range(sun_directions.shape[0]):
        if wp.dot(n, sun_directions[s]) > BEHIND:
            sun += is_free(mesh, origin, sun_directions[s], reach)
    t = tangent_of(n)
    b = wp.cross(n, t)
    above = wp.float32(0.0)
    below = wp.float32(0.0)
    for s in range(sky_directions.shape[0]):
        d = sky_directions[s]
        direction = d[0] * t + d[1] * b + d[2] * n
        free = is_free(mesh, origin, direction, reach)
        if direction[2] > wp.float32(0.0):
            above += free
        else:
            below += free
    rays = wp.float32(sky_directions.shape[0])
    light_out[k] = wp.vec3(sun / wp.float32(sun_directions.shape[0]), above / rays, below / rays)
