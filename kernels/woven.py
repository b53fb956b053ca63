"""Woven triangles: springs along the yarns inside each triangle, in the directions of warp, weft and ±45°.

The deformation gradient F of a triangle takes a direction e of the sheet at rest to F e = Σ g_k x_k, g_k the slopes of
the linear shape functions along e; Σ g_k = 0. A spring of rest length r along e has d = r F e, a weighted sum of the
three corners: in the longest chord along e one corner against a point on the opposite side. It obeys the law of
``spring_law.py``, its force spread over the corners by the weights r g_k. With k_s r = C A it has a sheet's energy,

    E = ½ C A (|F e| − 1)²,        f_k = −C A (|F e| − 1) g_k n,        n = F e/|F e|,

whatever r is, so it is 1 m here. (|F e| = 1 along warp and weft is the stretch condition of Baraff and Witkin, Large
Steps in Cloth Simulation, 1998.) Springs along ±45° give the sheet its shear modulus and Poisson's ratio, as the
diagonals of grids do. Beyond a strain limit, warp and weft have the second spring of ``strain_limit.py``.
"""

import sys

import warp as wp

from .precision import OPTIONS, mat33, real, vec2, vec3
from .spring_law import spring_energy, spring_force
from .strain_limit import excess_strain, limit_matrix

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.struct
class WovenModel:
    """Triangles by number, see :class:`warpcloth.cloth.woven.WovenTriangles`; what does not change.

    ``along`` and ``across`` hold the slopes [1/m] along warp and weft of the second and the third corner's shape
    functions, ``stiffness`` the C A [J] of warp, weft and each of ±45°, ``law`` (damping time k_d/k_s [s], strain limit
    [-], k_L/k_s of warp and weft [-]).
    """

    corners: wp.array(dtype=wp.vec3i)
    along: wp.array(dtype=vec2)
    across: wp.array(dtype=vec2)
    stiffness: wp.array(dtype=vec3)
    law: wp.array(dtype=vec3)


@wp.struct
class Pair:
    """A vector for the warp and one for the weft: F e of both, or what pulls on both."""

    along: vec3
    across: vec3


@wp.func
def direction_of(yarn: int):
    """(cos, sin) of a direction's angle to the warp: warp, weft, 45°, −45°."""
    e = vec2(real(1.0), real(0.0))
    if yarn == 1:
        e = vec2(real(0.0), real(1.0))
    if yarn == 2:
        e = vec2(real(0.7071067811865476), real(0.7071067811865476))
    if yarn == 3:
        e = vec2(real(0.7071067811865476), real(-0.7071067811865476))
    return e


@wp.func
def stiffness_of(stiffness: vec3, yarn: int):
    """C A [J] of a direction."""
    return stiffness[wp.min(yarn, 2)]


@wp.func
def limit_of(law: vec3, yarn: int):
    """k_L/k_s of a direction: only warp and weft have a limit."""
    share = law[2]
    if yarn > 1:
        share = real(0.0)
    return share


@wp.func
def slopes(woven: WovenModel, t: int, x: wp.array(dtype=vec3)):
    """Σ g_k x_k along warp and weft: F e if x are positions; from differences, which keeps digits."""
    corners = woven.corners[t]
    first = x[corners[1]] - x[corners[0]]
    second = x[corners[2]] - x[corners[0]]
    pair = Pair()
    pair.along = woven.along[t][0] * first + woven.along[t][1] * second
    pair.across = woven.across[t][0] * first + woven.across[t][1] * second
    return pair


@wp.func
def corner_slopes(woven: WovenModel, t: int, corner: int):
    """g along warp and weft [1/m] of a corner's shape function."""
    g = vec2(-woven.along[t][0] - woven.along[t][1], -woven.across[t][0] - woven.across[t][1])
    if corner == 1:
        g = vec2(woven.along[t][0], woven.across[t][0])
    if corner == 2:
        g = vec2(woven.along[t][1], woven.across[t][1])
    return g


@wp.func
def corner_force(g: vec2, pull: Pair):
    """Force [N] on a corner with the slopes g."""
    return -g[0] * pull.along - g[1] * pull.across


@wp.func
def yarn_pull(d: vec3, u: vec3, k: real, law: vec3, limit: real):
    """Derivative [J] of the energy with respect to d = F e, and what damping adds; k = C A, ``limit`` = k_L/k_s."""
    pull = spring_force(d, u, real(1.0), k, law[0] * k)
    if limit > real(0.0):
        excess = excess_strain(d, real(1.0), law[1])
        pull += (limit * k * excess / wp.max(wp.length(d), real(1.0))) * d  # no excess where |d| <= 1
    return pull


@wp.func
def yarn_limit_matrix(d: vec3, k: real, law: vec3, limit: real):
    """Second derivative of what the strain limit adds to the energy."""
    m = mat33()
    if limit > real(0.0):
        m = limit_matrix(d, real(1.0), law[1], limit * k)
    return m


@wp.func
def triangle_pull(woven: WovenModel, t: int, particle_q: wp.array(dtype=vec3), particle_qd: wp.array(dtype=vec3)):
    """What the yarns of a triangle pull with [J], see :func:`corner_force`."""
    f = slopes(woven, t, particle_q)
    rate = slopes(woven, t, particle_qd)
    law = woven.law[t]
    pull = Pair()
    for yarn in range(4):
        e = direction_of(yarn)
        k = stiffness_of(woven.stiffness[t], yarn)
        d = e[0] * f.along + e[1] * f.across
        u = e[0] * rate.along + e[1] * rate.across
        p = yarn_pull(d, u, k, law, limit_of(law, yarn))
        pull.along += e[0] * p
        pull.across += e[1] * p
    return pull


@wp.kernel
def scatter_forces(
    # Model
    woven: WovenModel,
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    particle_f_out: wp.array(dtype=vec3),
):
    """One thread per triangle adds its forces to its corners."""
    t = wp.tid()
    pull = triangle_pull(woven, t, particle_q, particle_qd)
    for corner in range(3):
        wp.atomic_add(particle_f_out, woven.corners[t][corner], corner_force(corner_slopes(woven, t, corner), pull))


@wp.kernel
def pulls(
    # Model
    thread_offset: int,
    woven: WovenModel,
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    # Out
    pulls_out: wp.array(dtype=Pair),
):
    """What all triangles pull with, for :func:`gather`."""
    t = thread_offset + wp.tid()
    pulls_out[t] = triangle_pull(woven, t, particle_q, particle_qd)


@wp.kernel
def gather(
    # Model
    thread_offset: int,
    woven: WovenModel,
    row_start: wp.array(dtype=wp.int32),
    row_corner: wp.array(dtype=wp.int32),
    # State in
    pulls: wp.array(dtype=Pair),
    # Out
    sum_out: wp.array(dtype=vec3),
):
    """Adds the forces of each particle's corners, one thread per particle: bitwise repeatable on any device.

    Corner c of triangle t has the number 3 t + c in the rows.
    """
    i = thread_offset + wp.tid()
    total = sum_out[i]
    for row in range(row_start[i], row_start[i + 1]):
        t = row_corner[row] // 3
        total += corner_force(corner_slopes(woven, t, row_corner[row] - 3 * t), pulls[t])
    sum_out[i] = total


@wp.kernel
def energy(
    # Model
    particle_world: wp.array(dtype=wp.int32),
    woven: WovenModel,
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    energy_out: wp.array(dtype=wp.float64),
):
    """Adds the energy of each triangle's yarns [J] to that of its world."""
    t = wp.tid()
    f = slopes(woven, t, particle_q)
    law = woven.law[t]
    total = real(0.0)
    for yarn in range(4):
        e = direction_of(yarn)
        k = stiffness_of(woven.stiffness[t], yarn)
        d = e[0] * f.along + e[1] * f.across
        excess = excess_strain(d, real(1.0), law[1])
        total += spring_energy(d, real(1.0), k) + real(0.5) * limit_of(law, yarn) * k * excess * excess
    wp.atomic_add(energy_out, particle_world[woven.corners[t][0]], wp.float64(total))


@wp.kernel
def strain(
    # Model
    woven: WovenModel,
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    strain_out: wp.array(dtype=real),
):
    """|F e| − 1 of the four yarns of each triangle [-]."""
    t = wp.tid()
    f = slopes(woven, t, particle_q)
    for yarn in range(4):
        e = direction_of(yarn)
        strain_out[4 * t + yarn] = wp.length(e[0] * f.along + e[1] * f.across) - real(1.0)
