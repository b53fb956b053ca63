"""Forces: terms over one model, summed by :class:`Forces`. A new one is a kernel file, a class and one line here."""

from .base import Forces, ForceTerm, Hessian, Linearization
from .springs import ASSEMBLIES, Springs

__all__ = ["ASSEMBLIES", "ForceTerm", "Forces", "Hessian", "Linearization", "Springs"]
