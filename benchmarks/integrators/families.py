"""Kinds of schemes, told apart by their traits: they share a line style in plots."""

from warpcloth.integrators import IntegratorInfo

EXPLICIT, SYMPLECTIC, IMPLICIT, ITERATED = "explicit", "symplectic", "implicit", "position based and descent"
FAMILIES = (EXPLICIT, SYMPLECTIC, IMPLICIT, ITERATED)


def family(info: IntegratorInfo) -> str:
    """One of :data:`FAMILIES`."""
    if "iterations" in info.options:
        return ITERATED
    if info.implicit:
        return IMPLICIT
    return SYMPLECTIC if info.symplectic else EXPLICIT
