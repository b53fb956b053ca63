"""Forces: terms over one model, summed by :class:`Forces`. A new term is one kernel file, one class and one line here."""

from .base import Forces, ForceTerm
from .springs import ASSEMBLIES, Springs

__all__ = ["ASSEMBLIES", "ForceTerm", "Forces", "Springs"]
