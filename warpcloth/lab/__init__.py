"""Laboratory tests of fabrics on simulated specimens: a new one is a file with NAME, TITLE and run, and a line here."""

from types import ModuleType

from . import bias, cantilever, cusick, hang, incline, lateral_buckling, shear, tensile
from .result import Check, Curve, Result
from .setup import Setup

_MODULES = (cantilever, lateral_buckling, cusick, tensile, shear, bias, hang, incline)
TESTS: dict[str, ModuleType] = {module.NAME: module for module in _MODULES}

__all__ = ["TESTS", "Check", "Curve", "Result", "Setup"]
