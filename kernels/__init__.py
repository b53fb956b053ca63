"""Warp device code: functions and kernels only, no allocation, no launches, no input or output.

Every file is written once, in terms of ``real`` and ``vec3`` from :mod:`warpcloth.kernels.precision`, and imported
once per *variant*: a precision (``float32``, ``float64``), with or without the adjoint code that gradients need. A
variant is the same source files under another package name, e.g. ``warpcloth.kernels.float64.springs``; so only the
variants that a program uses are ever compiled, and no kernel is written twice. (Warp's generic kernels would compile
every registered overload in each module, and make every literal a cast.)
"""

import importlib
import sys
import types

VARIANTS = ("float32", "float64", "float32_grad", "float64_grad")


class KernelSet:
    """The kernel modules of one variant, imported when first asked for: ``kernel_set.springs.accumulate``.

    Args:
        variant: One of :data:`VARIANTS`.
    """

    def __init__(self, variant: str):
        if variant not in VARIANTS:
            raise ValueError(f"unknown kernel variant {variant!r}; there are {', '.join(VARIANTS)}")
        self.variant = variant
        self.differentiable = variant.endswith("_grad")
        self._package = f"{__name__}.{variant}"
        if self._package not in sys.modules:
            package = types.ModuleType(self._package, f"The {variant} variant of {__name__}.")
            package.__path__ = list(__path__)
            sys.modules[self._package] = package

    def __getattr__(self, name: str) -> types.ModuleType:
        if name.startswith("_"):
            raise AttributeError(name)
        module = importlib.import_module(f"{self._package}.{name}")
        setattr(self, name, module)
        return module


def variant_name(precision: str, *, differentiable: bool = False) -> str:
    """Name of the kernel variant for a precision (``"float32"`` or ``"float64"``)."""
    return f"{precision}_grad" if differentiable else precision
