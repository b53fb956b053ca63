"""Linear stability: what one step does to the damped oscillator x″ + γ x′ + ω² x = 0, and how long it may be.

A one-step scheme multiplies (x, v) by a 2×2 matrix whose entries are polynomials in the step h. It is stable while both
eigenvalues lie in the unit disc, which for a real 2×2 matrix means (Jury's conditions)

    1 − det ≥ 0,    1 + det − tr ≥ 0,    1 + det + tr ≥ 0.

So the largest stable step is a root of one of three polynomials: exact, also for steps far too small to test.
"""

import math

import numpy as np
from numpy.polynomial import Polynomial

GROWTH_RATE = 0.1  # [1/s] growth of undamped motion that is put up with where a scheme has no stable step
MODES = np.geomspace(1e-3, 1.0, 13)  # frequencies at which a whole network is examined, in units of the fastest


def trace_and_determinant(propagator: np.ndarray) -> tuple[Polynomial, Polynomial]:
    """Of a 2×2 array of polynomials in the step."""
    (a, b), (c, d) = propagator
    return a + d, a * d - b * c


def largest_stable_step(propagator: np.ndarray) -> float:
    """Largest h up to which a scheme is stable; 0 if it is at no step, infinite if at all.

    Args:
        propagator: 2×2 array of polynomials in h, with h in units such that ω and γ are about 1.
    """
    trace, det = trace_and_determinant(propagator)
    return min(_first_sign_change(p) for p in (1.0 - det, 1.0 + det - trace, 1.0 + det + trace))


def _first_sign_change(p: Polynomial) -> float:
    """Smallest h > 0 beyond which p is negative. Coefficients that only round-off keeps from 0 are taken as 0."""
    c = np.where(np.abs(p.coef) > 1e-13 * max(1.0, np.abs(p.coef).max()), p.coef, 0.0)
    if not c.any():
        return math.inf
    c = c[np.flatnonzero(c)[0] : np.flatnonzero(c)[-1] + 1]  # powers of h divided out: the sign stays
    if c[0] < 0.0:
        return 0.0
    clean = Polynomial(c)
    roots = clean.roots()
    real = np.sort(roots.real[(np.abs(roots.imag) <= 1e-7 * np.abs(roots)) & (roots.real > 0.0)])
    return next((float(r) for r in real if clean(r * (1.0 + 1e-5)) < 0.0), math.inf)


def largest_step_of_slow_growth(propagator: np.ndarray, rate: float) -> float:
    """Largest h for which |eigenvalue| ≤ exp(rate h), found to 0.1 %; units as for :func:`largest_stable_step`."""
    trace, det = trace_and_determinant(propagator)
    more, larger = trace - 2.0, det - 1.0  # eigenvalues are 1 + μ; by μ itself, as in small steps μ is next to nothing

    def grows(h: np.ndarray) -> np.ndarray:
        half, product = 0.5 * more(h), larger(h)
        inside = half * half - (product - 2.0 * half)
        root = np.sqrt(np.maximum(inside, 0.0))
        most = np.expm1(np.minimum(rate * h, 100.0))
        apart = (half + root > most) | (-2.0 - (half - root) > most)
        return np.where(inside > 0.0, apart, product > np.expm1(np.minimum(2.0 * rate * h, 200.0)))

    h = np.geomspace(1e-7, 1e2, 3000)  # each 0.7 % above the one before
    unstable = grows(h)
    if not unstable.any():
        return math.inf
    first = int(np.argmax(unstable))
    fine = np.linspace(h[first - 1] if first else 0.0, h[first], 9)
    return float(fine[np.argmax(grows(fine)) - 1])


def scaled(omega: float, gamma: float) -> tuple[float, float, float]:
    """ω and γ in units of the larger one, and that unit [1/s]; 0 if both are 0."""
    unit = max(omega, gamma)
    return (omega / unit, gamma / unit, unit) if unit > 0.0 else (0.0, 0.0, 0.0)
