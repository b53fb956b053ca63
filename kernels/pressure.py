"""Closed cloths under pressure: given, or that of a gas shut in.

Every corner of a triangle with area vector N = ½ (x₂ − x₁)×(x₃ − x₁) has the force p N/3. Summed over a closed surface
that is p ∇V of its volume V = Σ x₁·(x₂×x₃)/6, so it has neither resultant nor moment. With V₀ the volume at rest:

    given:  p constant                       E = −p (V − V₀)
    gas:    p = (p_a + p₀) V₀/V − p_a        E = −(p_a + p₀) V₀ ln(V/V₀) + p_a (V − V₀)

p₀ the pressure at rest over the ambient p_a: an ideal gas of constant temperature. Volumes are summed in float64.

Schemes whose springs act where a step h ends, but pressure where it began, take N at x + h v. For spun cloth turns by
ω h meanwhile, and between a pull along the new direction and a push along the old one there is a moment that stops it:
−p h/(σ r) of the angular momentum per second for a ball of areal density σ and radius r. At x + h v N has turned as far
as springs have, but for what is of second order; and it still is ∇V, which has no resultant. The pressure remains that
at x, so what a gas's stiffness allows for steps does, too.
"""

import sys

import warp as wp

from .precision import OPTIONS, mat33, real, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.struct
class Bags:
    """Of each closed cloth p₀ [Pa], p_a [Pa], V₀ [m³], whether it holds gas, 1 or −1 as triangles face out or in."""

    pressure: wp.array(dtype=wp.float64)
    ambient: wp.array(dtype=wp.float64)
    volume: wp.array(dtype=wp.float64)
    gas: wp.array(dtype=wp.int32)
    side: wp.array(dtype=wp.float64)


@wp.func
def wide(x: vec3):
    return wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2]))


@wp.func
def area_vector(t: int, tri_indices: wp.array2d(dtype=wp.int32), particle_q: wp.array(dtype=vec3)):
    """N [m²]."""
    a = particle_q[tri_indices[t, 0]]
    return real(0.5) * wp.cross(particle_q[tri_indices[t, 1]] - a, particle_q[tri_indices[t, 2]] - a)


@wp.func
def filled_volume(bags: Bags, bag: int, volume: wp.float64):
    """V of a gas, at least a thousandth of V₀: beyond, a bag that has been turned inside out would suck."""
    return wp.max(bags.side[bag] * volume, wp.float64(1.0e-3) * bags.volume[bag])


@wp.func
def pressure_at(bags: Bags, bag: int, volume: wp.float64):
    """p [Pa] over the ambient, outward along the triangles' N."""
    p = bags.pressure[bag]
    if bags.gas[bag] == 1:
        p = (bags.ambient[bag] + p) * bags.volume[bag] / filled_volume(bags, bag, volume) - bags.ambient[bag]
    return bags.side[bag] * p


@wp.func
def stiffness_at(bags: Bags, bag: int, volume: wp.float64):
    """−∂p/∂V [Pa/m³] of a gas; 0 for a given pressure."""
    if bags.gas[bag] == 0:
        return wp.float64(0.0)
    v = filled_volume(bags, bag, volume)
    return (bags.ambient[bag] + bags.pressure[bag]) * bags.volume[bag] / (v * v)


@wp.kernel
def volumes(
    # Model
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_bag: wp.array(dtype=wp.int32),
    # State in
    particle_q: wp.array(dtype=vec3),
    # Out
    volume_out: wp.array(dtype=wp.float64),
):
    """Adds V [m³] of each triangle's cone from the origin."""
    t = wp.tid()
    if tri_bag[t] >= 0:
        a = wide(particle_q[tri_indices[t, 0]])
        b = wide(particle_q[tri_indices[t, 1]])
        c = wide(particle_q[tri_indices[t, 2]])
        wp.atomic_add(volume_out, tri_bag[t], wp.dot(a, wp.cross(b, c)) / wp.float64(6.0))


@wp.kernel
def triangle_forces(
    # Model
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_bag: wp.array(dtype=wp.int32),
    bags: Bags,
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    volume: wp.array(dtype=wp.float64),
    ahead: real,
    # Out
    tri_force_out: wp.array(dtype=vec3),
):
    """p N [N] of each triangle, N being that of ``ahead`` [s] later; zero on open cloth."""
    t = wp.tid()
    f = vec3()
    if tri_bag[t] >= 0:
        i = tri_indices[t, 0]
        j = tri_indices[t, 1]
        k = tri_indices[t, 2]
        along = particle_q[j] - particle_q[i] + ahead * (particle_qd[j] - particle_qd[i])
        across = particle_q[k] - particle_q[i] + ahead * (particle_qd[k] - particle_qd[i])
        p = pressure_at(bags, tri_bag[t], volume[tri_bag[t]])
        f = (real(0.5) * real(p)) * wp.cross(along, across)
    tri_force_out[t] = f


@wp.kernel
def volume_rates(
    # Model
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_bag: wp.array(dtype=wp.int32),
    # State in
    particle_q: wp.array(dtype=vec3),
    x: wp.array(dtype=vec3),
    # Out
    rate_out: wp.array(dtype=wp.float64),
):
    """Adds ∇V·x of each triangle."""
    t = wp.tid()
    if tri_bag[t] >= 0:
        total = x[tri_indices[t, 0]] + x[tri_indices[t, 1]] + x[tri_indices[t, 2]]
        part = wp.dot(area_vector(t, tri_indices, particle_q), total) / real(3.0)
        wp.atomic_add(rate_out, tri_bag[t], wp.float64(part))


@wp.kernel
def triangle_products(
    # Model
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_bag: wp.array(dtype=wp.int32),
    bags: Bags,
    # State in
    particle_q: wp.array(dtype=vec3),
    volume: wp.array(dtype=wp.float64),
    rate: wp.array(dtype=wp.float64),
    stiffness: real,
    # Out
    tri_product_out: wp.array(dtype=vec3),
):
    """``stiffness`` (−∂p/∂V) (∇V·x) N of each triangle."""
    t = wp.tid()
    y = vec3()
    if tri_bag[t] >= 0:
        k = stiffness_at(bags, tri_bag[t], volume[tri_bag[t]]) * rate[tri_bag[t]]
        y = (stiffness * real(k)) * area_vector(t, tri_indices, particle_q)
    tri_product_out[t] = y


@wp.kernel
def diagonal(
    # Model
    particle_corner_start: wp.array(dtype=wp.int32),
    particle_corner_ids: wp.array(dtype=wp.int32),
    tri_indices: wp.array2d(dtype=wp.int32),
    tri_bag: wp.array(dtype=wp.int32),
    bags: Bags,
    # State in
    particle_q: wp.array(dtype=vec3),
    volume: wp.array(dtype=wp.float64),
    stiffness: real,
    # Out
    blocks_out: wp.array(dtype=mat33),
):
    """Adds ``stiffness`` (−∂p/∂V) ∇ᵢV ∇ᵢVᵀ of each particle."""
    i = wp.tid()
    gradient = vec3()
    k = wp.float64(0.0)
    for c in range(particle_corner_start[i], particle_corner_start[i + 1]):
        t = particle_corner_ids[c] // 3
        if tri_bag[t] >= 0:
            gradient += area_vector(t, tri_indices, particle_q) / real(3.0)
            k = stiffness_at(bags, tri_bag[t], volume[tri_bag[t]])
    blocks_out[i] = blocks_out[i] + (stiffness * real(k)) * wp.outer(gradient, gradient)


@wp.kernel
def energy(
    # Model
    bags: Bags,
    # State in
    volume: wp.array(dtype=wp.float64),
    # Out
    energy_out: wp.array(dtype=wp.float64),
):
    """E [J] of each closed cloth; see the module."""
    b = wp.tid()
    rest = bags.volume[b]
    e = -bags.pressure[b] * (bags.side[b] * volume[b] - rest)
    if bags.gas[b] == 1:
        v = filled_volume(bags, b, volume[b])
        e = -(bags.ambient[b] + bags.pressure[b]) * rest * wp.log(v / rest) + bags.ambient[b] * (v - rest)
    energy_out[b] = e
