"""The velocity of the air at a point and a time: mean wind, gusts, and turbulence as a sum of waves.

    w(x, t) = W (1 + g sin(2π t/T)) + Σ a_m cos(k_m·x + ω_m t + φ_m),      a_m ⊥ k_m

so the turbulence is free of divergence and known everywhere without a grid (Kraichnan, Physics of Fluids 13, 1970). The
host draws its waves; ω_m contains −k_m·W, as the wind carries them along. Phases are reduced in float64, because a
simulation may run for long.
"""

import warp as wp

from .direct import int_at, real_at, vector_at
from .precision import real, vec3


@wp.struct
class Wind:
    """Of each world density [kg/m³], W [m/s], g [-], 2π/T [1/s] and its waves ``start[w]`` to ``start[w + 1]``; of each
    wave k [1/m], a [m/s], ω [1/s], φ [-]."""

    density: wp.array(dtype=real)
    mean: wp.array(dtype=vec3)
    gust: wp.array(dtype=real)
    gust_rate: wp.array(dtype=wp.float64)
    start: wp.array(dtype=wp.int32)
    wave: wp.array(dtype=vec3)
    amplitude: wp.array(dtype=vec3)
    rate: wp.array(dtype=wp.float64)
    phase: wp.array(dtype=wp.float64)


@wp.func
def wind_velocity(wind: Wind, world: int, x: vec3, t: wp.float64):
    """w(x, t) [m/s] in a world."""
    w = vector_at(wind.mean, world)
    if real_at(wind.gust, world) != real(0.0):  # a sine in float64 takes as long as all the rest
        w = w * (real(1.0) + wind.gust[world] * real(wp.sin(wind.gust_rate[world] * t)))
    turn = wp.float64(6.283185307179586)
    for m in range(int_at(wind.start, world), int_at(wind.start, world + 1)):
        angle = wind.rate[m] * t + wind.phase[m]
        angle -= turn * wp.floor(angle * (wp.float64(1.0) / turn))
        w += wp.cos(wp.dot(wind.wave[m], x) + real(angle)) * wind.amplitude[m]
    return w
