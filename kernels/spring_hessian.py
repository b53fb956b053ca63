"""Stiffness and damping matrices of a spring network: products, 3×3 blocks on the diagonal, and all of these.

Both come from the law of ``spring_law.py``. The matrix is a K + b C with K = −∂f/∂x, but for a part of how damping
changes as springs turn, and C = −∂f/∂v.
"""

import sys

import warp as wp

from .block_rows import BlockRows
from .precision import FORWARD_ONLY, mat33, real, vec3
from .spring_law import spring_damping_matrix, spring_tangent_matrix

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.func
def spring_matrix(d: vec3, u: vec3, rest_length: real, k_s: real, k_d: real, project: real, a: real, b: real):
    """a K + b C of one spring."""
    k = spring_tangent_matrix(d, u, rest_length, k_s, k_d, project)
    c = spring_damping_matrix(d, rest_length, k_d)
    return mat33(a * k + b * c)


@wp.kernel
def scatter_products(
    # Model
    springs: wp.array(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    spring_indices: wp.array(dtype=wp.vec2i),
    spring_rest_length: wp.array(dtype=real),
    spring_stiffness: wp.array(dtype=real),
    spring_damping: wp.array(dtype=real),
    # State in
    world_project: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    x: wp.array(dtype=vec3),
    a: real,
    b: real,
    # Out
    product_out: wp.array(dtype=vec3),
):
    """Adds (a K + b C) x of ``springs``, one thread for each; none are named: of all."""
    s = wp.tid()
    if springs.shape[0] > 0:
        s = springs[s]
    ends = spring_indices[s]
    d = particle_q[ends[1]] - particle_q[ends[0]]
    u = particle_qd[ends[1]] - particle_qd[ends[0]]
    project = world_project[particle_world[ends[0]]]
    k = spring_matrix(d, u, spring_rest_length[s], spring_stiffness[s], spring_damping[s], project, a, b)
    y = k * (x[ends[1]] - x[ends[0]])
    wp.atomic_sub(product_out, ends[0], y)
    wp.atomic_add(product_out, ends[1], y)


@wp.kernel
def gather_products(
    # Model
    thread_offset: int,
    particle_spring_start: wp.array(dtype=wp.int32),
    particle_spring_ids: wp.array(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    spring_indices: wp.array(dtype=wp.vec2i),
    spring_rest_length: wp.array(dtype=real),
    spring_stiffness: wp.array(dtype=real),
    spring_damping: wp.array(dtype=real),
    # State in
    world_project: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    x: wp.array(dtype=vec3),
    a: real,
    b: real,
    # Out
    product_out: wp.array(dtype=vec3),
):
    """Adds (a K + b C) x, one thread per particle, springs in the order of their numbers."""
    i = thread_offset + wp.tid()
    project = world_project[particle_world[i]]
    total = vec3()
    for j in range(particle_spring_start[i], particle_spring_start[i + 1]):
        s = particle_spring_ids[j]
        ends = spring_indices[s]
        other = ends[0] + ends[1] - i
        d = particle_q[other] - particle_q[i]
        u = particle_qd[other] - particle_qd[i]
        k = spring_matrix(d, u, spring_rest_length[s], spring_stiffness[s], spring_damping[s], project, a, b)
        total += k * (x[i] - x[other])
    product_out[i] = product_out[i] + total


@wp.kernel
def diagonal(
    # Model
    thread_offset: int,
    particle_spring_start: wp.array(dtype=wp.int32),
    particle_spring_ids: wp.array(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    spring_indices: wp.array(dtype=wp.vec2i),
    spring_rest_length: wp.array(dtype=real),
    spring_stiffness: wp.array(dtype=real),
    spring_damping: wp.array(dtype=real),
    # State in
    world_project: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    a: real,
    b: real,
    # Out
    blocks_out: wp.array(dtype=mat33),
):
    """Adds the 3×3 blocks on the diagonal of a K + b C, one thread per particle."""
    i = thread_offset + wp.tid()
    project = world_project[particle_world[i]]
    total = mat33()
    for j in range(particle_spring_start[i], particle_spring_start[i + 1]):
        s = particle_spring_ids[j]
        ends = spring_indices[s]
        d = particle_q[ends[1]] - particle_q[ends[0]]
        u = particle_qd[ends[1]] - particle_qd[ends[0]]
        total += spring_matrix(d, u, spring_rest_length[s], spring_stiffness[s], spring_damping[s], project, a, b)
    blocks_out[i] = blocks_out[i] + total


@wp.kernel
def add_blocks(
    # Model
    thread_offset: int,
    particle_spring_start: wp.array(dtype=wp.int32),
    particle_spring_ids: wp.array(dtype=wp.int32),
    end_slot: wp.array(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    spring_indices: wp.array(dtype=wp.vec2i),
    spring_rest_length: wp.array(dtype=real),
    spring_stiffness: wp.array(dtype=real),
    spring_damping: wp.array(dtype=real),
    # State in
    world_project: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    a: real,
    b: real,
    # Out
    rows_out: BlockRows,
):
    """Adds a K + b C, one thread per particle; ``end_slot`` has the block of the first end of spring s with the second
    at 2 s, that of the second with the first at 2 s + 1, and −1 for springs left out."""
    i = thread_offset + wp.tid()
    project = world_project[particle_world[i]]
    for j in range(particle_spring_start[i], particle_spring_start[i + 1]):
        s = particle_spring_ids[j]
        ends = spring_indices[s]
        slot = end_slot[2 * s]
        if i == ends[1]:
            slot = end_slot[2 * s + 1]
        if slot < 0:
            continue
        d = particle_q[ends[1]] - particle_q[ends[0]]
        u = particle_qd[ends[1]] - particle_qd[ends[0]]
        m = spring_matrix(d, u, spring_rest_length[s], spring_stiffness[s], spring_damping[s], project, a, b)
        rows_out.block[slot] = rows_out.block[slot] - m
