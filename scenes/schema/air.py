"""The air of a scene."""

from typing import Annotated, Self

from pydantic import model_validator

from warpcloth.air import Air

from .table import Table, field
from .values import Number, Speed, at_least_zero, positive, refuse

_PLAIN = Air()


class AirTable(Table):
    """The air: it brakes whatever cloth moves through it, and its wind carries cloth along."""

    density: Annotated[float, at_least_zero("kg/m³", 1e4)] = field(_PLAIN.density, "Mass per volume; 0 is a vacuum.")
    wind: Speed = field((0.0, 0.0, 0.0), "Mean velocity.")
    gust: Annotated[float, Number("", 0.0, 100.0)] = field(
        _PLAIN.gust, "Share by which the wind grows and falls about its mean, as a sine."
    )
    gust_period: Annotated[float, positive("s", 1e6)] = field(_PLAIN.gust_period, "Time between two gusts.")
    turbulence: Annotated[float, at_least_zero("m/s", 1e3)] = field(
        _PLAIN.turbulence, "Root mean square of what turbulence adds to each component; drawn from the scene's seed."
    )
    turbulence_length: Annotated[float, positive("m")] = field(
        _PLAIN.turbulence_length, "Typical wave length of the turbulence."
    )

    @model_validator(mode="after")
    def _nothing_in_vain(self) -> Self:
        windy = any(self.wind)
        if self.gust > 0.0 and not windy:
            raise refuse("must have a wind for its gust, which is a share of it")
        if self.density == 0.0 and (windy or self.turbulence > 0.0):
            raise refuse("must have a density above 0 for its wind, as a vacuum pushes nothing")
        return self

    def build(self, seed: int) -> Air:
        """The simulator's air."""
        return Air(**dict(self), seed=seed)
