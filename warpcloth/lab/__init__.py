"""Laboratory tests of fabrics on simulated specimens: a new one is a file with NAME, TITLE and run, and a line here."""

from types import ModuleType

from . import bias, cantilever, hang, incline, shear, tensile
from .result import Check, Curve, Result
from .setup import Setup

TESTS: dict[str, ModuleType] = {module.NAME: module for module in (cantilever, tensile, shear, bias, hang, incline)}

__all__ = ["TESTS", "Check", "Curve", "Result", "Setup"]
