"""What bending needs to know of a material."""

import math
from dataclasses import dataclass

from ..fabric import Fabric


@dataclass(frozen=True)
class BendingSheet:
    """Bending of a sheet, along warp and weft.

    Attributes:
        rigidity: moment per width and curvature [N m].
        hysteresis: width 2HB of the loop in the diagram of moment per width against curvature [N].
    """

    rigidity: tuple[float, float]
    hysteresis: tuple[float, float] = (0.0, 0.0)

    @staticmethod
    def of(fabric: Fabric) -> "BendingSheet":
        """That of a fabric."""
        return BendingSheet(fabric.bending, (fabric.bending_hysteresis, fabric.bending_hysteresis))

    @property
    def bends(self) -> bool:
        """Whether there is any bending stiffness."""
        return min(self.rigidity) > 0.0

    @property
    def twist_rigidity(self) -> float:
        """Of the energy density ½ (B_x κ_x² + B_y κ_y² + 2 B_xy κ_xy²) [N m].

        √(B_x B_y): then a sheet with B_x = B_y is isotropic with Poisson's ratio 0, and one with B_x ≠ B_y is that
        sheet stretched along one axis. Fabric laboratories do not measure it.
        """
        return math.sqrt(self.rigidity[0] * self.rigidity[1])
