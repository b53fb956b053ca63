"""What bending needs to know of a material."""

from dataclasses import dataclass

from ..fabric import Fabric


@dataclass(frozen=True)
class BendingSheet:
    """Bending of a sheet, along warp and weft.

    Attributes:
        rigidity: moment per width and curvature [N m].
        twist_rigidity: B_t of the energy density ½ (B_x κ_x² + B_y κ_y² + 2 B_t κ_xy²) [N m].
        hysteresis: width 2HB of the loop in the diagram of moment per width against curvature [N].
    """

    rigidity: tuple[float, float]
    twist_rigidity: float
    hysteresis: tuple[float, float] = (0.0, 0.0)

    @staticmethod
    def of(fabric: Fabric) -> "BendingSheet":
        """That of a fabric."""
        hysteresis = fabric.bending_hysteresis
        return BendingSheet(fabric.bending, fabric.twist_rigidity, (hysteresis, hysteresis))

    @property
    def bends(self) -> bool:
        """Whether there is any bending stiffness."""
        return min(self.rigidity) > 0.0
