"""Named fabrics. Every value stands beside its source; what nobody published for that very fabric is estimated.

Units of the KES tests in SI: bending rigidity B in gf·cm²/cm × 98.07 µN·m, hysteresis 2HB in gf·cm/cm × 9.807 mN, shear
stiffness G in gf/(cm·degree) × 56.19 N/m, and 500 gf/cm, the greatest load of the tensile test, are 490.3 N/m.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from . import validate
from .errors import InputError
from .fabric import Fabric

MATSUDAIRA = "Matsudaira et al., J. Textile Engineering 61(6), 2015"
WANG = "Wang, O'Brien, Ramamoorthi, Data-Driven Elastic Models for Cloth, ACM TOG 30(4), 2011: its material file"
WANG_BENDING = f"{WANG}; the larger of two directions taken for the warp"
WANG_TWIST = f"{WANG}: 2 B_t = 4 B_45 − B_0 − B_90"
YARN_TWIST = (
    "estimated: yarns twist as their fibres do, with 2 G/E of what they bend with; half, as G is some E/4 in cotton, "
    "silk and wool, and less in polyester and flax (Morton and Hearle, Physical Properties of Textile Fibres)"
)
KAWABATA = "Kawabata, The Standardization and Analysis of Hand Evaluation, 1980: mean of men's winter suitings"
FENG = "estimated: a fabric of that weight in Feng et al., ACM TOG 41(6), 2022 (618 fabrics, kinds not named)"
DENIM_RATIO = "estimated: 2HB/B of 0.81 /cm, as denim has in J. of Textiles 2016, 4614168, Table 5"
COTTON_RATIO = "estimated: 2HB/B of 1.05 /cm, that of cotton broadcloth"
SHIRTING_STRETCH = "estimated: 4 % of extension at the KES load of 490 N/m, as plain-woven shirtings have"
SPUN_SHEAR = "estimated: 1 gf/(cm·degree) in the KES shear test, usual for spun fabrics"
THICKNESS = "estimated: from the weight, at 0.4 g/cm³"
FRICTION = "estimated: of fabric on fabric, from 0.25 for filament to 0.6 for rough spun yarn"
COMMON: Mapping[str, tuple[Any, str]] = {
    "bend_stiffness": (0.0, "none: bending rigidity takes the place of such springs"),
    "damping_time": (3e-4, "estimated: strain dies out within a frame"),
    "air_drag": (1.17, "Hoerner, Fluid-Dynamic Drag, 1965: square plate across the flow"),
    "air_friction": (0.02, "estimated: turbulent friction of a rough plate, 0.01 on each side"),
}


@dataclass(frozen=True)
class LibraryFabric:
    """A fabric of the library.

    Attributes:
        fabric: its properties. description: what it is, in words.
        sources: where each property comes from, by the name of the field; "estimated: how" where it was not measured.
    """

    fabric: Fabric
    description: str
    sources: Mapping[str, str]


def fabrics() -> dict[str, LibraryFabric]:
    """All fabrics of the library by name."""
    return {entry.fabric.name: entry for entry in _LIBRARY}


def library_fabric(name: str, **changes: Any) -> Fabric:
    """A fabric of the library, with some properties changed.

    Args:
        name: see :func:`fabrics`.
        changes: fields of :class:`~warpcloth.fabric.Fabric`.

    Raises:
        InputError: there is no such fabric or property, or a value is out of range.
    """
    found = fabrics()[validate.choice(name, fabrics(), "fabric")].fabric
    known = [field.name for field in dataclasses.fields(Fabric)]
    for field in changes:
        if field not in known:
            raise InputError(f"A fabric has no '{field}'{validate.did_you_mean(field, known)}.")
    return dataclasses.replace(found, **changes)


def _entry(
    name: str, description: str, color: tuple[float, float, float], **sourced: tuple[float, str]
) -> LibraryFabric:
    """From a pair (value, source) for each property."""
    both = {**COMMON, **sourced}
    fabric = Fabric(name=name, color=color, **{field: value for field, (value, _) in both.items()})
    return LibraryFabric(fabric, description, {field: source for field, (_, source) in both.items()})


_LIBRARY = (
    _entry(
        "cotton",
        "Broadcloth for shirts: crisp, as its hysteresis holds it up.",
        (0.82, 0.80, 0.74),
        areal_density=(0.1238, MATSUDAIRA),
        thickness=(0.497e-3, MATSUDAIRA),
        stretch_stiffness=(12000.0, SHIRTING_STRETCH),
        shear_stiffness=(56.0, SPUN_SHEAR),
        bending_rigidity=(11.57e-6, MATSUDAIRA),
        twist_ratio=(0.5, YARN_TWIST),
        bending_hysteresis=(1.216e-3, MATSUDAIRA),
        friction=(0.5, FRICTION),
    ),
    _entry(
        "polyester",
        "Tropical suiting: springy and light, falls into many folds.",
        (0.24, 0.33, 0.40),
        areal_density=(0.1165, MATSUDAIRA),
        thickness=(0.340e-3, MATSUDAIRA),
        stretch_stiffness=(12000.0, SHIRTING_STRETCH),
        shear_stiffness=(56.0, SPUN_SHEAR),
        bending_rigidity=(7.55e-6, MATSUDAIRA),
        twist_ratio=(0.5, YARN_TWIST),
        bending_hysteresis=(0.284e-3, MATSUDAIRA),
        friction=(0.35, FRICTION),
    ),
    _entry(
        "silk",
        "Light plain weave of filaments, 16 momme: limp and smooth.",
        (0.55, 0.06, 0.16),
        areal_density=(0.0694, "16 momme of 4.34 g/m², the measure of the trade"),
        thickness=(0.17e-3, THICKNESS),
        stretch_stiffness=(8000.0, "estimated: 6 % of extension at the KES load of 490 N/m"),
        shear_stiffness=(22.0, "estimated: 0.4 gf/(cm·degree) in the KES shear test; filaments slide"),
        bending_rigidity=(3.08e-6, FENG),
        bending_rigidity_weft=(1.78e-6, FENG),
        twist_ratio=(0.5, YARN_TWIST),
        bending_hysteresis=(0.092e-3, "estimated: 2HB/B of 0.38 /cm, that of the filament-smooth polyester"),
        friction=(0.25, FRICTION),
    ),
    _entry(
        "wool",
        "Winter suiting: full and soft, with round folds.",
        (0.20, 0.21, 0.22),
        areal_density=(0.2635, KAWABATA),
        thickness=(0.746e-3, KAWABATA),
        stretch_stiffness=(8100.0, f"{KAWABATA}: load over extension at 490 N/m"),
        shear_stiffness=(54.4, KAWABATA),
        bending_rigidity=(13.3e-6, KAWABATA),
        twist_ratio=(0.5, YARN_TWIST),
        bending_hysteresis=(0.61e-3, KAWABATA),
        friction=(0.55, FRICTION),
    ),
    _entry(
        "denim",
        "Twill for jeans, 11 ounces, 99 % cotton and 1 % spandex: heavy and stiff, gives along the weft.",
        (0.06, 0.10, 0.24),
        areal_density=(0.324, WANG),
        thickness=(0.8e-3, THICKNESS),
        stretch_stiffness=(2028.0, WANG),
        stretch_stiffness_weft=(410.0, WANG),
        shear_stiffness=(53.4, WANG),
        bending_rigidity=(97.0e-6, WANG_BENDING),
        bending_rigidity_weft=(64.2e-6, WANG_BENDING),
        twist_ratio=(0.84, WANG_TWIST),
        bending_hysteresis=(6.5e-3, DENIM_RATIO),
        friction=(0.6, FRICTION),
    ),
    _entry(
        "linen",
        "Plain weave of flax for summer clothes and tables: stiff and dry, keeps its creases.",
        (0.70, 0.64, 0.50),
        areal_density=(0.1834, "estimated: usual for clothes"),
        thickness=(0.46e-3, THICKNESS),
        stretch_stiffness=(16000.0, "estimated: 3 % of extension at the KES load of 490 N/m; flax gives little"),
        shear_stiffness=(56.0, SPUN_SHEAR),
        bending_rigidity=(61.2e-6, FENG),
        bending_rigidity_weft=(24.1e-6, FENG),
        twist_ratio=(0.5, YARN_TWIST),
        bending_hysteresis=(4.5e-3, COTTON_RATIO),
        friction=(0.5, FRICTION),
    ),
    _entry(
        "twill",
        "65 % cotton and 35 % polyester for trousers: firm in every direction.",
        (0.42, 0.36, 0.25),
        areal_density=(0.22, WANG),
        thickness=(0.55e-3, THICKNESS),
        stretch_stiffness=(4070.0, WANG),
        stretch_stiffness_weft=(4033.0, WANG),
        shear_stiffness=(104.8, WANG),
        bending_rigidity=(125.4e-6, WANG),
        twist_ratio=(0.72, WANG_TWIST),
        bending_hysteresis=(10.2e-3, DENIM_RATIO),
        friction=(0.5, FRICTION),
    ),
    _entry(
        "tablecloth",
        "Plain-woven polyester for tables: light and crisp, shears easily.",
        (0.80, 0.76, 0.70),
        areal_density=(0.128, WANG),
        thickness=(0.32e-3, THICKNESS),
        stretch_stiffness=(4055.0, WANG),
        stretch_stiffness_weft=(4004.0, WANG),
        shear_stiffness=(19.2, WANG),
        bending_rigidity=(51.7e-6, WANG_BENDING),
        bending_rigidity_weft=(31.3e-6, WANG_BENDING),
        twist_ratio=(0.99, WANG_TWIST),
        bending_hysteresis=(1.6e-3, "estimated: 2HB/B of 0.38 /cm, that of polyester suiting"),
        friction=(0.3, FRICTION),
    ),
    _entry(
        "ponte",
        "Double knit of polyester and rayon for jackets: gives in every direction.",
        (0.48, 0.32, 0.18),
        areal_density=(0.284, WANG),
        thickness=(0.71e-3, THICKNESS),
        stretch_stiffness=(88.0, WANG),
        stretch_stiffness_weft=(62.3, WANG),
        shear_stiffness=(31.9, WANG),
        bending_rigidity=(37.2e-6, WANG_BENDING),
        bending_rigidity_weft=(36.3e-6, WANG_BENDING),
        twist_ratio=(0.80, WANG_TWIST),
        bending_hysteresis=(1.5e-3, "estimated: 2HB/B of 0.4 /cm; knits bend with little friction"),
        friction=(0.5, FRICTION),
    ),
)
