"""Particles on their way out of solids, before anything moves; see ``warpcloth/untangle.py``."""

import sys

import warp as wp

from .obstacle_hit import surface_point, to_float3
from .precision import FORWARD_ONLY, real, vec3
from .shapes import MESH, Placement, Shapes, distance, to_local, to_world

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.kernel
def leave_solids(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    particle_inv_mass: wp.array(dtype=real),
    particle_radius: wp.array(dtype=real),
    shapes: Shapes,
    reach: real,
    # State in
    particle_q: wp.array(dtype=vec3),
    place: wp.array(dtype=Placement),
    # Out
    particle_q_out: wp.array(dtype=vec3),
):
    """Moves each free particle that is inside a solid to its thickness over the nearest point of its surface."""
    i = wp.tid()
    q = particle_q[i]
    w = particle_world[i]
    gap = real(2.0) * particle_radius[i]
    end = shapes.world_start[w + 1]
    if particle_inv_mass[i] == real(0.0):
        end = shapes.world_start[w]
    for s in range(shapes.world_start[w], end):
        x = to_local(place[s], q)
        out = vec3()
        depth = real(0.0)
        if shapes.solid[s] == 0:
            continue
        if shapes.kind[s] == MESH:
            near = wp.mesh_query_point_sign_winding_number(shapes.mesh[s], to_float3(x), wp.float32(reach))
            if near.result and near.sign < 0.0:
                out = surface_point(shapes.mesh[s], near.face, near.u, near.v) - x
                depth = wp.length(out)
        else:
            hit = distance(shapes.kind[s], shapes.size[s], x)
            depth = -hit[3]
            out = depth * vec3(hit[0], hit[1], hit[2])
        if depth > real(0.0):
            q = to_world(place[s], x + out * ((depth + gap) / depth))
    particle_q_out[i] = q
