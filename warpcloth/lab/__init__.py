"""Laboratory tests of fabrics on simulated specimens: a new one is a file with NAME, TITLE and run, and a line here."""

from types import ModuleType

from . import cantilever
from .result import Check, Curve, Result
from .setup import Setup

TESTS: dict[str, ModuleType] = {module.NAME: module for module in (cantilever,)}

__all__ = ["TESTS", "Check", "Curve", "Result", "Setup"]
