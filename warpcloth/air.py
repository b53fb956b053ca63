"""The air that cloth moves through: its density and its wind."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from . import validate
from .validate import Array, ReadOnly

SEA_LEVEL_DENSITY = 1.225  # [kg/m³] of the standard atmosphere at 15 °C
WAVES = 16


@dataclass(frozen=True, eq=False)
class Air(ReadOnly):
    """Air with a steady, gusting or turbulent wind, which cloth does not slow down.

    What the air that moves with light cloth adds to its inertia is left out.

    Args:
        density: ρ [kg/m³], >= 0.
        wind: mean velocity W [m/s], shape [3].
        gust: share g by which the wind's speed swings about its mean: W (1 + g sin(2π t/T)).
        gust_period: T [s], > 0.
        turbulence: root mean square of each component of the velocity that is added to the wind [m/s].
        turbulence_length: typical wave length of the turbulence [m], > 0.
        seed: of the turbulence.

    Raises:
        InputError: on a value out of range.
    """

    density: float = SEA_LEVEL_DENSITY
    wind: Array = (0.0, 0.0, 0.0)
    gust: float = 0.0
    gust_period: float = 3.0
    turbulence: float = 0.0
    turbulence_length: float = 0.5
    seed: int = 0

    def __post_init__(self):
        values: dict[str, Any] = {
            "density": validate.number(self.density, "air: density", minimum=0.0, maximum=1e5),
            "wind": validate.vector(self.wind, "air: wind"),
            "gust": validate.number(self.gust, "air: gust", minimum=0.0, maximum=1e3),
            "gust_period": validate.number(self.gust_period, "air: gust_period", above=0.0),
            "turbulence": validate.number(self.turbulence, "air: turbulence", minimum=0.0, maximum=1e4),
            "turbulence_length": validate.number(self.turbulence_length, "air: turbulence_length", above=0.0),
            "seed": validate.integer(self.seed, "air: seed", minimum=0, maximum=2**32 - 1),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def changes(self) -> bool:
        """Whether the wind is not always the same at one place."""
        return self.turbulence > 0.0 or (self.gust > 0.0 and bool(np.any(self.wind)))

    def waves(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """k [1/m] and a [m/s], shape [waves, 3], ω [1/s] and φ, shape [waves], of the turbulence; none without any.

        Directions are random, wave lengths between a half and twice ``turbulence_length``, evenly in their logarithm. A
        wave changes while it drifts with the wind, at the rate |k| times the turbulence's speed (Kraichnan 1970).
        """
        count = WAVES if self.turbulence > 0.0 else 0
        rng = np.random.default_rng(self.seed)
        direction, other = rng.normal(size=(2, count, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        number = 2.0 * np.pi / (self.turbulence_length * 2.0 ** rng.uniform(-1.0, 1.0, count))
        across = np.cross(direction, other)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        amplitude = self.turbulence * np.sqrt(6.0 / WAVES) * across  # Σ |a|²/2 = 3 turbulence²
        wave = number[:, None] * direction
        rate = number * self.turbulence * rng.normal(size=count) - wave @ self.wind
        return wave, amplitude, rate, rng.uniform(0.0, 2.0 * np.pi, count)
