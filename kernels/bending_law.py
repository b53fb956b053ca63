"""The law of a bending element, the one place where it is written.

An element has a curvature vector d = Σ w_i x_i [1/m] and surface tangents t₁ = Σ α_i x_i, t₂ = Σ β_i x_i with normal
c = t₁ × t₂. With stiffness k [N m³], rest curvature κ₀ and damping time τ [s], u = Σ w_i v_i,

    E = ½ k |d − κ₀ c|²         moment M = k (d − κ₀ c) + k τ (u·d) d/(|d|² + δ²)

Without rest curvature E is quadratic in the positions (Bergou et al., A Quadratic Bending Model for Inextensible
Surfaces, 2006); with it the sign of curvature matters, as in the cubic shells of Garg et al. (2007), but E stays a
square and is zero, without any force, in the rest shape and wherever that is moved as a whole. The damping is that of
the length of d, so none of it is left in a rigid motion; δ keeps it smooth where cloth is flat, so that curvatures
below about 1/m are damped less.

Hysteresis is friction in curvature (Grosberg's model of fabric: Textile Research Journal 36, 1966), a spring of
stiffness k_f in series with a slip at the moment m_f. With the slip p [1/m] at the start of a step,

    E_f = Huber(|d − p c|)      M_f = k_f (d − p c), shortened to the length m_f

which is the incremental potential of elastic-plastic bodies: at the end of a step p follows, so that the force is the
same at the start of the next. The moment depends on curvatures and their order, not on rates or steps.

Forces are f_i = −w_i M + α_i t₂ × N + β_i N × t₁ with N = κ₀ k (d − κ₀ c) + p M_f.
"""

import warp as wp

from .precision import mat33, real, vec2, vec3

FLAT_CURVATURE = wp.constant(1.0)  # δ [1/m]


@wp.func
def friction_scale(r: vec3, friction_stiffness: real, slip_moment: real):
    """Friction moment over r = d − p c: k_f, or less where it slips."""
    length = wp.length(r)
    scale = friction_stiffness
    if friction_stiffness * length > slip_moment:
        scale = slip_moment / length
    return scale


@wp.func
def friction_energy(r: vec3, friction_stiffness: real, slip_moment: real):
    """Huber's function of |r| [J]: what it takes to bend by r from the slip so far."""
    length = wp.length(r)
    if friction_stiffness * length <= slip_moment:
        return real(0.5) * friction_stiffness * length * length
    return slip_moment * (length - real(0.5) * slip_moment / friction_stiffness)


@wp.func
def friction_matrix(r: vec3, friction: vec2):
    """Derivative of the friction moment by r; ``friction`` is (stiffness, slip moment)."""
    identity = wp.identity(n=3, dtype=real)
    scale = friction_scale(r, friction[0], friction[1])
    m = mat33(scale * identity)
    if scale < friction[0]:
        n = wp.normalize(r)
        m = scale * (identity - wp.outer(n, n))
    return m


@wp.func
def damping_direction(d: vec3):
    """d over √(|d|² + δ²): the direction in which curvature is damped, fading out where cloth is flat."""
    flat = real(FLAT_CURVATURE)
    return d / wp.sqrt(wp.dot(d, d) + flat * flat)


@wp.func
def slipped(d: vec3, c: vec3, slip: real, friction_stiffness: real, slip_moment: real):
    """Slip p [1/m] at the end of a step: as far as leaves no more than the slip moment."""
    length = wp.length(c)
    result = slip
    if slip_moment > real(0.0) and length > real(0.0):
        reach = slip_moment / friction_stiffness
        curvature = wp.dot(d, c) / (length * length)
        result = wp.clamp(slip, curvature - reach, curvature + reach)
    return result
