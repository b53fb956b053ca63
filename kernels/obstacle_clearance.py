"""How far each particle may move before it can touch an obstacle: most of a cloth is nowhere near one for a while.

A particle that stays within its clearance of where that was found meets nothing, whatever its way: distances change by
no more than the way gone. Obstacles that move give no clearance.
"""

import sys

import warp as wp

from .obstacle_hit import to_float3
from .precision import FORWARD_ONLY, real, vec3
from .shapes import MESH, Placement, Shapes, distance, to_local

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

SLOP = wp.constant(0.01)  # of the contact distance; more than the response counts as contact, and than rounding


@wp.func
def mesh_distance(mesh: wp.uint64, x: vec3, most: real):
    """Distance of x from a mesh [m], up to ``most``."""
    found = wp.mesh_query_point_no_sign(mesh, to_float3(x), wp.float32(most))
    if not found.result:
        return most
    on = wp.mesh_eval_position(mesh, found.face, found.u, found.v)
    return wp.min(most, real(wp.length(to_float3(x) - on)))


@wp.kernel
def find_clearance(
    # Model
    thread_offset: int,
    particle_world: wp.array(dtype=wp.int32),
    particle_radius: wp.array(dtype=real),
    shapes: Shapes,
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    place: wp.array(dtype=Placement),
    span: real,
    # Out
    clearance_out: wp.array(dtype=real),
):
    """Way [m] that each particle is free to go; no more is looked for than what may be used within ``span`` [s]."""
    i = thread_offset + wp.tid()
    w = particle_world[i]
    clearance = real(4.0) * particle_radius[i] + real(2.0) * span * wp.length(particle_qd[i])
    for s in range(shapes.world_start[w], shapes.world_start[w + 1]):
        if shapes.track[s] >= 0 or shapes.mesh_speed[s] > real(0.0):
            clearance = real(0.0)
        if clearance > real(0.0):
            offset = (real(1.0) + real(SLOP)) * (particle_radius[i] + shapes.thickness[s])
            x = to_local(place[s], particle_q[i])
            if shapes.kind[s] == MESH:
                gap = mesh_distance(shapes.mesh[s], x, clearance + offset) - offset
            else:
                here = distance(shapes.kind[s], shapes.size[s], x)
                gap = here[3] - offset
            clearance = wp.min(clearance, gap)
    clearance_out[i] = clearance
