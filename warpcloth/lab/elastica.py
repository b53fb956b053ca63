"""The heavy elastica: an inextensible strip clamped level that bends under its own weight.

θ″ = −Γ (1 − s) cos θ with θ(0) = 0 and θ′(1) = 0, s along the strip from the clamp over its length L, Γ = w L³/B. Seen
from the free end and with σ = Γ^(1/3) (1 − s), it has no parameter but the angle at that end: θ_σσ = −σ cos θ.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

STEPS = 400
ROUNDS = 45


@dataclass(frozen=True, eq=False)
class Shape:
    """A bent strip: points (x, y) over L from the clamp to the tip, y downwards, shape [n]."""

    x: np.ndarray
    y: np.ndarray

    @property
    def drop(self) -> float:
        """H/W: how far the tip hangs over how far it reaches."""
        return float(self.y[-1] / self.x[-1])


def heavy_elastica(gammas: Sequence[float] | np.ndarray) -> list[Shape]:
    """The shapes at Γ > 0, by bisection on the angle at the free end; correct to eight digits up to Γ = 200."""
    span = np.cbrt(np.asarray(gammas, float))
    low, high = np.zeros(len(span)), np.full(len(span), 0.5 * np.pi)
    for _ in range(ROUNDS):
        middle = 0.5 * (low + high)
        steep = _from_tip(middle, span)[0, -1] > 0.0
        low, high = np.where(steep, low, middle), np.where(steep, middle, high)
    path = _from_tip(0.5 * (low + high), span)
    x, y = ((path[k, -1] - path[k])[::-1] / span for k in (2, 3))
    return [Shape(x[:, i], y[:, i]) for i in range(len(span))]


def _from_tip(tip_angle: np.ndarray, span: np.ndarray) -> np.ndarray:
    """θ, θ_σ, ∫cos θ and ∫sin θ at STEPS + 1 places from the tip to the clamp, by the classical Runge–Kutta method."""
    h = span / STEPS
    state = np.zeros((4, len(span)))
    state[0] = tip_angle
    path = np.empty((4, STEPS + 1, len(span)))
    path[:, 0] = state
    for k in range(STEPS):
        sigma = k * h
        k1 = _slope(sigma, state)
        k2 = _slope(sigma + 0.5 * h, state + 0.5 * h * k1)
        k3 = _slope(sigma + 0.5 * h, state + 0.5 * h * k2)
        k4 = _slope(sigma + h, state + h * k3)
        state = state + (h / 6.0) * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        path[:, k + 1] = state
    return path


def _slope(sigma: np.ndarray, state: np.ndarray) -> np.ndarray:
    cos = np.cos(state[0])
    return np.stack([state[1], -sigma * cos, cos, np.sin(state[0])])
