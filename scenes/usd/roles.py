"""How prims in a cache say what they are, so that a cache can be checked and read back."""

from pxr import Sdf, Usd

CLOTH_ROLE = "cloth"
NETWORK_ROLE = "network"
SPRINGS_ROLE = "springs"  # the curves that show a network
OBSTACLE_ROLE = "obstacle"
SIM_API = "PhysicsSurfaceDeformableSimAPI"  # what other tools call a mesh that is to be simulated as cloth
REST_SHAPE = "physics:restShapePoints"  # attribute of cloth whose points are not where it is unstrained
REST_LENGTHS = "warpcloth:restLengths"  # attribute of such curves, one for each [m]
_ROLE = "warpcloth:role"
_NAME = "warpcloth:name"


def mark(prim: Usd.Prim, role: str, name: str) -> None:
    """Notes on ``prim`` what it is, and its name before it became a prim name."""
    prim.SetCustomDataByKey(_ROLE, role)
    prim.SetCustomDataByKey(_NAME, name)


def role_of(prim: Usd.Prim) -> str | None:
    """What :func:`mark` noted, or None."""
    return prim.GetCustomDataByKey(_ROLE)


def has_schema(prim: Usd.Prim, name: str) -> bool:
    """Whether an API schema is applied to ``prim``, even one that this OpenUSD does not know."""
    return name in prim.GetPrimTypeInfo().GetAppliedAPISchemas()


def name_of(prim: Usd.Prim) -> str:
    """The name given to :func:`mark`, or else the prim's own."""
    return prim.GetCustomDataByKey(_NAME) or prim.GetName()


def set_number(prim: Usd.Prim, name: str, value: float) -> None:
    """Authors the physical property ``name`` as a custom attribute, in SI units and double precision."""
    attribute = prim.CreateAttribute(f"warpcloth:{name}", Sdf.ValueTypeNames.Double, custom=True)
    attribute.Set(float(value))


def numbers(prim: Usd.Prim, *names: str) -> dict[str, float]:
    """Those of the properties ``names`` that ``prim`` has."""
    found = {name: prim.GetAttribute(f"warpcloth:{name}") for name in names}
    return {name: attribute.Get() for name, attribute in found.items() if attribute and attribute.HasAuthoredValue()}
