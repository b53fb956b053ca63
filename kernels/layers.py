"""Where points lie over a layer of cloth; see ``warpcloth/layers.py``."""

import sys

import warp as wp

from .precision import FORWARD_ONLY, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.kernel
def find_feet(
    # Model
    members: wp.array(dtype=wp.int32),
    reach: wp.float32,
    # State in
    particle_q: wp.array(dtype=vec3),
    layer: wp.uint64,
    # Out
    face_out: wp.array(dtype=wp.int32),
    weight_out: wp.array(dtype=wp.vec3),
):
    """For each member the nearest point of a layer within reach: its triangle, −1 for none, and the weights there."""
    i = wp.tid()
    near = wp.mesh_query_point_no_sign(layer, wp.vec3(particle_q[members[i]]), reach)
    face = int(-1)
    if near.result:
        face = near.face
    face_out[i] = face
    weight_out[i] = wp.vec3(near.u, near.v, 1.0 - near.u - near.v)
