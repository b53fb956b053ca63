"""Cloth on the host: rest meshes, springs, pins."""

from .bending import BendingElements
from .cloth import Cloth
from .inflation import Inflation
from .pins import Pin, PinSpec, pin, pin_box, pin_nearest
from .springs import BEND, KIND_NAMES, SHEAR, STRUCTURAL, SpringNetwork

__all__ = [
    "BEND",
    "KIND_NAMES",
    "SHEAR",
    "STRUCTURAL",
    "BendingElements",
    "Cloth",
    "Inflation",
    "Pin",
    "PinSpec",
    "SpringNetwork",
    "pin",
    "pin_box",
    "pin_nearest",
]
