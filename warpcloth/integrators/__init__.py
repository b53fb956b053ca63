"""Time integrators by name. A new one is one file and one line in :data:`INTEGRATORS`."""

from dataclasses import dataclass

from .. import validate
from ..model import Model
from .base import Integrator
from .symplectic_euler import SymplecticEuler

INTEGRATORS: dict[str, type[Integrator]] = {cls.name: cls for cls in (SymplecticEuler,)}


@dataclass(frozen=True)
class IntegratorInfo:
    """What is known about a scheme without running it."""

    name: str
    order: int
    implicit: bool
    symplectic: bool
    reference: str


def integrators() -> dict[str, IntegratorInfo]:
    """All integrators, by name, with their attributes."""
    return {
        name: IntegratorInfo(name, cls.order, cls.implicit, cls.symplectic, cls.reference)
        for name, cls in INTEGRATORS.items()
    }


def make_integrator(name: str, model: Model) -> Integrator:
    """The integrator of that name, with its scratch memory for this model.

    Raises:
        InputError: unknown name; the sentence lists all and proposes the closest.
    """
    return INTEGRATORS[validate.choice(name, INTEGRATORS, "integrator")](model)


__all__ = ["INTEGRATORS", "Integrator", "IntegratorInfo", "integrators", "make_integrator"]
