"""Stiffness and damping matrices of woven triangles: products, 3×3 blocks on the diagonal, and all of these.

Each yarn has the matrix of ``spring_hessian.py`` between its two ends, here weighted sums of corners, and what its
strain limit adds.
"""

import sys

import warp as wp

from .block_rows import BlockRows
from .precision import FORWARD_ONLY, mat33, real, vec2, vec3
from .spring_hessian import spring_matrix
from .woven import (
    Pair,
    WovenModel,
    corner_force,
    corner_slopes,
    direction_of,
    limit_of,
    slopes,
    stiffness_of,
    yarn_limit_matrix,
)

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])


@wp.func
def yarn_matrix(d: vec3, u: vec3, k: real, law: vec3, limit: real, project: real, a: real, b: real):
    """a K + b C of one yarn, between its ends."""
    m = spring_matrix(d, u, real(1.0), k, law[0] * k, project, a, b)
    return mat33(m + a * yarn_limit_matrix(d, k, law, limit))


@wp.func
def triangle_product(
    woven: WovenModel,
    t: int,
    project: real,
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    x: wp.array(dtype=vec3),
    a: real,
    b: real,
):
    """What the yarns of a triangle pull with for (a K + b C) x; see ``corner_force``."""
    f = slopes(woven, t, particle_q)
    rate = slopes(woven, t, particle_qd)
    change = slopes(woven, t, x)
    law = woven.law[t]
    pull = Pair()
    for yarn in range(4):
        e = direction_of(yarn)
        k = stiffness_of(woven.stiffness[t], yarn)
        d = e[0] * f.along + e[1] * f.across
        u = e[0] * rate.along + e[1] * rate.across
        m = yarn_matrix(d, u, k, law, limit_of(law, yarn), project, a, b)
        y = m * (e[0] * change.along + e[1] * change.across)
        pull.along -= e[0] * y
        pull.across -= e[1] * y
    return pull


@wp.kernel
def scatter_products(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    woven: WovenModel,
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
    """Adds (a K + b C) x, one thread per triangle."""
    t = wp.tid()
    project = world_project[particle_world[woven.corners[t][0]]]
    pull = triangle_product(woven, t, project, particle_q, particle_qd, x, a, b)
    for corner in range(3):
        wp.atomic_add(product_out, woven.corners[t][corner], corner_force(corner_slopes(woven, t, corner), pull))


@wp.kernel
def product_pulls(
    # Model
    thread_offset: int,
    particle_world: wp.array(dtype=wp.int32),
    woven: WovenModel,
    # State in
    world_project: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    x: wp.array(dtype=vec3),
    a: real,
    b: real,
    # Out
    pulls_out: wp.array(dtype=Pair),
):
    """(a K + b C) x of all triangles, for ``gather`` of ``woven.py``."""
    t = thread_offset + wp.tid()
    project = world_project[particle_world[woven.corners[t][0]]]
    pulls_out[t] = triangle_product(woven, t, project, particle_q, particle_qd, x, a, b)


@wp.struct
class PairMatrices:
    """Derivatives of what the yarns of a triangle pull along warp and weft with, by F e along warp and weft."""

    along: mat33
    mixed: mat33
    across: mat33


@wp.func
def triangle_matrices(
    woven: WovenModel,
    t: int,
    project: real,
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    a: real,
    b: real,
):
    """a K + b C of a triangle: Σ e eᵀ ⊗ the matrix of each yarn, e its direction."""
    f = slopes(woven, t, particle_q)
    rate = slopes(woven, t, particle_qd)
    law = woven.law[t]
    result = PairMatrices()
    for yarn in range(4):
        e = direction_of(yarn)
        k = stiffness_of(woven.stiffness[t], yarn)
        d = e[0] * f.along + e[1] * f.across
        u = e[0] * rate.along + e[1] * rate.across
        m = yarn_matrix(d, u, k, law, limit_of(law, yarn), project, a, b)
        result.along = result.along + (e[0] * e[0]) * m
        result.mixed = result.mixed + (e[0] * e[1]) * m
        result.across = result.across + (e[1] * e[1]) * m
    return result


@wp.func
def corner_block(g: vec2, h: vec2, m: PairMatrices):
    """The block between corners with the slopes g and h."""
    mixed = g[0] * h[1] + g[1] * h[0]
    return mat33((g[0] * h[0]) * m.along + mixed * m.mixed + (g[1] * h[1]) * m.across)


@wp.kernel
def diagonal(
    # Model
    thread_offset: int,
    particle_world: wp.array(dtype=wp.int32),
    woven: WovenModel,
    row_start: wp.array(dtype=wp.int32),
    row_corner: wp.array(dtype=wp.int32),
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
    for row in range(row_start[i], row_start[i + 1]):
        t = row_corner[row] // 3
        g = corner_slopes(woven, t, row_corner[row] - 3 * t)
        total += corner_block(g, g, triangle_matrices(woven, t, project, particle_q, particle_qd, a, b))
    blocks_out[i] = blocks_out[i] + total


@wp.kernel
def add_blocks(
    # Model
    thread_offset: int,
    particle_world: wp.array(dtype=wp.int32),
    woven: WovenModel,
    row_start: wp.array(dtype=wp.int32),
    row_corner: wp.array(dtype=wp.int32),
    pair_slot: wp.array(dtype=wp.int32),
    # State in
    world_project: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    a: real,
    b: real,
    # Out
    rows_out: BlockRows,
):
    """Adds a K + b C, one thread per particle: the pair of corners c and d of triangle t is 9 t + 3 c + d."""
    i = thread_offset + wp.tid()
    project = world_project[particle_world[i]]
    for row in range(row_start[i], row_start[i + 1]):
        corner = row_corner[row]
        t = corner // 3
        g = corner_slopes(woven, t, corner - 3 * t)
        m = triangle_matrices(woven, t, project, particle_q, particle_qd, a, b)
        for other in range(3):
            s = pair_slot[3 * corner + other]
            if s >= 0:
                rows_out.block[s] = rows_out.block[s] + corner_block(g, corner_slopes(woven, t, other), m)
