"""Fabrics: what a cloth is made of, in textile units that do not depend on the resolution of its mesh."""

from dataclasses import dataclass

from . import validate


@dataclass(frozen=True)
class Fabric:
    """A fabric. All values are properties of the sheet, not of a mesh.

    Args:
        name: for people and reports.
        areal_density: mass per area [kg/m²], > 0.
        thickness: contact thickness [m], > 0; two layers come to rest this far apart.
        stretch_stiffness: Young's modulus Y of the sheet along the grid directions [N/m], > 0.
        shear_stiffness: shear modulus G of the sheet [N/m]; 0: no shear springs. Grids only: springs along the edges
            of other triangle meshes already fix G = 3/8 Y.
        bend_stiffness: stiffness per width of the bend springs, which join every other vertex [N/m]; 0: none. Inside a
            grid they add twice this to what ``stretch_stiffness`` asks for.
        damping_time: ratio k_d / k_s of each spring [s]; strain decays faster the larger it is.
        friction: Coulomb coefficient; a pair has the geometric mean of its two.
        color: linear red, green, blue in [0, 1].

    Raises:
        InputError: on a value out of range.
    """

    name: str = "cotton"
    areal_density: float = 0.2
    thickness: float = 0.002
    stretch_stiffness: float = 400.0
    shear_stiffness: float = 80.0
    bend_stiffness: float = 4.0
    damping_time: float = 5e-4
    friction: float = 0.5
    color: tuple[float, float, float] = (0.85, 0.82, 0.74)

    def __post_init__(self):
        label = f"fabric '{validate.text(self.name, 'fabric: name')}'"
        for field in ("areal_density", "thickness", "stretch_stiffness"):
            object.__setattr__(self, field, validate.number(getattr(self, field), f"{label}: {field}", above=0.0))
        for field in ("shear_stiffness", "bend_stiffness", "damping_time", "friction"):
            object.__setattr__(self, field, validate.number(getattr(self, field), f"{label}: {field}", minimum=0.0))
        object.__setattr__(self, "color", validate.color(self.color, f"{label}: color"))
