"""Fabrics: what a cloth is made of, in textile units that do not depend on the resolution of its mesh."""

import math
from dataclasses import dataclass

from . import validate
from .errors import InputError

STANDARD_GRAVITY = 9.80665  # [m/s²]

_POSITIVE = ("areal_density", "thickness", "stretch_stiffness", "twist_ratio")
_NOT_NEGATIVE = (
    "shear_stiffness", "bending_rigidity", "bending_hysteresis", "bend_stiffness", "damping_time", "friction",
    "air_drag", "air_friction", "limit_stiffness",
)  # fmt: skip


@dataclass(frozen=True)
class Fabric:
    """A fabric. All values are properties of the sheet, not of a mesh.

    The warp runs along x of a grid or mesh as it is before it is placed, the weft across it. Values for the weft that
    are None are those of the warp.

    Args:
        name: for people and reports.
        areal_density: mass per area [kg/m²], > 0.
        thickness: contact thickness [m], > 0; two layers come to rest this far apart.
        stretch_stiffness: Young's modulus Y of the sheet along the warp, force per width and strain [N/m], > 0.
        stretch_stiffness_weft: the same along the weft.
        shear_stiffness: shear modulus G of the sheet, force per width and angle [N/m], at most Y; 0: no shear springs.
            Networks of springs tie Poisson's ratio to it: ν = G/C with C = (Y + √(Y² + 4 G²))/2. Other meshes
            than grids have either this or Y, or both if woven; see ``springs`` of :meth:`warpcloth.Cloth.from_mesh`.
        bending_rigidity: moment per width and curvature B for bending along the warp [N m]; 0: none.
            :func:`rigidity_of_length` gives it from a bending length.
        bending_rigidity_weft: the same along the weft; 0 where that along the warp is 0, and only there.
        twist_ratio: resistance to twist B_t over √(B B_weft), > 0, in the energy density
            ½ (B κ_x² + B_weft κ_y² + 2 B_t κ_xy²). A sheet that bends alike in all directions has 1. Woven cloth has
            less, as yarns turn more easily than they bend: at 45° to them it bends with (B + B_weft + 2 B_t)/4.
        bending_hysteresis: 2HB of the KES bending test: how far the moment per width [N m/m = N] lies higher when
            curvature grows than when it falls. Cloth without bending rigidity has none.
        bend_stiffness: stiffness per width of springs that join every other vertex [N/m]; 0: none. Such springs have
            no linear bending stiffness: their moment grows with the cube of curvature and with the size of cells.
            Inside a grid they add twice this to what ``stretch_stiffness`` asks for.
        damping_time: ratio k_d / k_s of each spring [s]; strain decays faster the larger it is.
        friction: Coulomb coefficient; a pair has the geometric mean of its two.
        air_drag: normal-force coefficient of a piece of the sheet that air meets at a right angle [-].
        air_friction: coefficient of the air's drag along the sheet [-].
        strain_limit: strain [-] beyond which yarns are straight and the sheet stiffens; None: it never does.
        limit_stiffness: by how much the stretch stiffness along the warp is greater beyond it [N/m].
        color: linear red, green, blue in [0, 1].

    Raises:
        InputError: on a value out of range.
    """

    name: str = "plain"
    areal_density: float = 0.2
    thickness: float = 0.002
    stretch_stiffness: float = 400.0
    stretch_stiffness_weft: float | None = None
    shear_stiffness: float = 80.0
    bending_rigidity: float = 0.0
    bending_rigidity_weft: float | None = None
    twist_ratio: float = 1.0
    bending_hysteresis: float = 0.0
    bend_stiffness: float = 4.0
    damping_time: float = 5e-4
    friction: float = 0.5
    air_drag: float = 1.2
    air_friction: float = 0.02
    strain_limit: float | None = None
    limit_stiffness: float = 0.0
    color: tuple[float, float, float] = (0.85, 0.82, 0.74)

    def __post_init__(self):
        label = f"fabric '{validate.text(self.name, 'fabric: name')}'"
        for field in _POSITIVE:
            self._check(label, field, above=0.0)
        for field in _NOT_NEGATIVE:
            self._check(label, field, minimum=0.0)
        for field, bound in (
            ("stretch_stiffness_weft", {"above": 0.0}),
            ("bending_rigidity_weft", {"minimum": 0.0}),
            ("strain_limit", {"minimum": 0.0}),
        ):
            if getattr(self, field) is not None:
                self._check(label, field, **bound)
        if self.shear_stiffness > min(self.stretch):
            raise InputError(
                f"{validate.sentence(label)}: shear_stiffness must be at most the stretch stiffness, "
                f"{min(self.stretch):g} N/m, got {self.shear_stiffness:g}."
            )
        if min(self.bending) == 0.0 < max(self.bending):
            raise InputError(
                f"{validate.sentence(label)}: bending rigidities along warp and weft must both be 0 or both greater, "
                f"got {self.bending[0]:g} and {self.bending[1]:g} N m."
            )
        object.__setattr__(self, "color", validate.color(self.color, f"{label}: color"))

    @property
    def stretch(self) -> tuple[float, float]:
        """Young's moduli along warp and weft [N/m]."""
        weft = self.stretch_stiffness_weft
        return self.stretch_stiffness, self.stretch_stiffness if weft is None else weft

    @property
    def beyond_limit(self) -> float:
        """What is added to the stretch stiffness along the warp beyond the strain limit [N/m]; 0 without a limit."""
        return 0.0 if self.strain_limit is None else self.limit_stiffness

    @property
    def bending(self) -> tuple[float, float]:
        """Bending rigidities along warp and weft [N m]."""
        weft = self.bending_rigidity_weft
        return self.bending_rigidity, self.bending_rigidity if weft is None else weft

    @property
    def twist_rigidity(self) -> float:
        """Resistance to twist B_t [N m]."""
        return self.twist_ratio * math.sqrt(self.bending[0] * self.bending[1])

    @property
    def bending_length(self) -> tuple[float, float]:
        """Bending lengths c = (B/(σ g))^(1/3) along warp and weft [m] (Peirce 1930; ASTM D1388)."""
        warp, weft = ((b / (self.areal_density * STANDARD_GRAVITY)) ** (1.0 / 3.0) for b in self.bending)
        return warp, weft

    def _check(self, label: str, field: str, *, above: float | None = None, minimum: float | None = None) -> None:
        value = validate.number(getattr(self, field), f"{label}: {field}", above=above, minimum=minimum)
        object.__setattr__(self, field, value)


def rigidity_of_length(bending_length: float, areal_density: float) -> float:
    """Bending rigidity B = σ g c³ [N m] of a fabric with bending length c [m] and areal density σ [kg/m²].

    Raises:
        InputError: a value is negative or not a number.
    """
    length = validate.number(bending_length, "bending_length", minimum=0.0)
    return validate.number(areal_density, "areal_density", above=0.0) * STANDARD_GRAVITY * length**3
