"""The spring law, the one place where it is written. Force, energy and Hessian kernels all call these functions.

For a spring p–q of rest length r, with d = x_q − x_p, u = v_q − v_p and n = d/|d|:

    f_p = [ k_s (|d|/r − 1) + k_d (u·n)/r ] n        f_q = −f_p        E = ½ k_s r (|d|/r − 1)²

k_s in newtons (force per unit strain), k_d in newton seconds. A spring of zero length has no direction: n = 0 there, so
it exerts no force and everything stays finite.
"""

import warp as wp

from .precision import mat33, real, vec3

TURNED = wp.constant(1.0 - 0.5**0.5)  # 1 − cos 45°


@wp.func
def direction(d: vec3):
    """Unit vector along d, or zero for a zero-length spring."""
    length = wp.length(d)
    n = vec3()
    if length > real(0.0):
        n = d / length
    return n


@wp.func
def spring_pull(d: vec3, u: vec3, law: vec3):
    """Force [N] on particle p; its negative acts on q. ``law`` is (r [m], k_s/r [N/m], k_d/r [N s/m]).

    With |d| − r, which floating point takes exactly where strains are small, and few divisions.
    """
    length = wp.length(d)
    inverse = real(0.0)
    if length > real(0.0):
        inverse = real(1.0) / length
    return ((law[1] * (length - law[0]) + law[2] * wp.dot(u, d) * inverse) * inverse) * d


@wp.func
def spring_force(d: vec3, u: vec3, rest_length: real, k_s: real, k_d: real):
    """The same from stiffness and damping as they are."""
    return spring_pull(d, u, vec3(rest_length, k_s / rest_length, k_d / rest_length))


@wp.func
def spring_energy(d: vec3, rest_length: real, k_s: real):
    """Elastic energy [J]."""
    strain = wp.length(d) / rest_length - real(1.0)
    return real(0.5) * k_s * rest_length * strain * strain


@wp.func
def spring_tangent_matrix(d: vec3, u: vec3, rest_length: real, k_s: real, k_d: real, project: real):
    """Derivative of the force on q with respect to −d [N/m], a symmetric 3×3 matrix; with damping a part is left out.

    With the tension T = k_s (|d|/r − 1) + k_d (u·n)/r it is K = (k_s/r) n nᵀ + (T/|d|) (I − n nᵀ), without damping the
    second derivative of the energy. A compressed spring has negative transverse stiffness; with ``project = 1`` that is
    left out, which makes K positive semi-definite (Choi and Ko 2002), with 0 it stays, in between it is scaled.

    Left out is (k_d/r) n wᵀ, w = (I − n nᵀ) u/|d| the rate at which the spring turns: by moving across it its ends
    change the pull along it. There the spring itself resists, so that one iteration of Newton's method hardly sees the
    mistake, and the next one mends it. The symmetric part, half of it in n wᵀ and half in w nᵀ, has a push across the
    spring that is not there, and where only masses m resist. In a stage γ, with γ³ |w|² k_d/r > 4 m, it even makes the
    matrix indefinite: strongly damped cloth then gained energy by steps that did not converge.
    """
    length = wp.length(d)
    n = direction(d)
    transverse = real(0.0)
    if length > real(0.0):
        transverse = (k_s * (length / rest_length - real(1.0)) + k_d * wp.dot(u, n) / rest_length) / length
    if transverse < real(0.0):
        transverse = (real(1.0) - project) * transverse
    nn = wp.outer(n, n)
    return mat33((k_s / rest_length) * nn + transverse * (wp.identity(n=3, dtype=real) - nn))


@wp.func
def spring_turning_matrix(d: vec3, rest_length: real, k_s: real):
    """The second derivative of the energy by d along the spring [N/m], and across it no less than for a turn of 45°.

    An end of a spring at rest that moves across it, by r tan θ, makes it r/cos θ long; what then pulls the end back is
    (k_s/r)(1 − cos θ) times its way. The second derivative at rest, 0, knows nothing of that.
    """
    n = direction(d)
    nn = wp.outer(n, n)
    transverse = wp.max(real(TURNED), real(1.0) - rest_length / wp.length(d))  # also of a length of 0
    return mat33((k_s / rest_length) * (nn + transverse * (wp.identity(n=3, dtype=real) - nn)))


@wp.func
def spring_damping_matrix(d: vec3, rest_length: real, k_d: real):
    """Derivative of the damping force on q with respect to −u [N s/m]: (k_d/r) n nᵀ, a 3×3 matrix."""
    n = direction(d)
    return mat33((k_d / rest_length) * wp.outer(n, n))
