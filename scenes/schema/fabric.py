"""What the cloth of a scene is made of."""

from typing import Annotated

from warpcloth.fabric import Fabric

from .table import Table, field
from .values import Color, Text, at_least_zero, positive

_DEFAULT = Fabric()


class FabricTable(Table):
    """What a cloth is made of: properties of the sheet, which do not depend on the resolution of its mesh."""

    name: Annotated[str, Text(r"\S(.*\S)?", "a name", 200)] = field(_DEFAULT.name, "Name, for reports.")
    areal_density: Annotated[float, positive("kg/m²", 1e3)] = field(_DEFAULT.areal_density, "Mass per area.")
    thickness: Annotated[float, positive("m", 0.1)] = field(
        _DEFAULT.thickness, "Contact thickness: two layers come to rest this far apart."
    )
    stretch_stiffness: Annotated[float, positive("N/m", 1e7)] = field(
        _DEFAULT.stretch_stiffness, "Young's modulus of the sheet, force per width and strain."
    )
    shear_stiffness: Annotated[float, at_least_zero("N/m", 1e7)] = field(
        _DEFAULT.shear_stiffness, "Shear modulus of the sheet. Grids only: on other meshes the edges fix it."
    )
    bend_stiffness: Annotated[float, at_least_zero("N/m", 1e7)] = field(
        _DEFAULT.bend_stiffness, "Stiffness per width of the springs that join every other vertex."
    )
    damping_time: Annotated[float, at_least_zero("s", 10.0)] = field(
        _DEFAULT.damping_time, "Damping of each spring over its stiffness; strain dies out faster the larger it is."
    )
    friction: Annotated[float, at_least_zero("", 10.0)] = field(
        _DEFAULT.friction, "Coulomb coefficient; a pair has the geometric mean of its two."
    )
    color: Color = field(_DEFAULT.color, "Display colour, linear RGB.")

    def build(self) -> Fabric:
        """The simulator's fabric."""
        return Fabric(**dict(self))
