"""Time integrators by name. A new one is one file and one line in :data:`INTEGRATORS`."""

import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .. import validate
from ..errors import InputError
from ..model import Model
from .base import Integrator
from .bdf2 import Bdf2
from .embedded_pairs import BogackiShampine, DormandPrince
from .implicit import ImplicitEuler
from .linearly_implicit import Imex, LinearImplicitEuler
from .pbd import Pbd
from .projective_dynamics import ProjectiveDynamics
from .runge_kutta import ClassicalRungeKutta, ForwardEuler, Midpoint, Trapezoidal
from .splitting import Pefrl, SymplecticEuler, VelocityVerlet
from .undamped import ImplicitMidpoint, ImplicitTrapezoid
from .vbd import Vbd
from .xpbd import Xpbd

INTEGRATORS: dict[str, type[Integrator]] = {
    cls.name: cls
    for cls in (
        ForwardEuler,
        Midpoint,
        Trapezoidal,
        ClassicalRungeKutta,
        BogackiShampine,
        DormandPrince,
        SymplecticEuler,
        VelocityVerlet,
        Pefrl,
        Imex,
        LinearImplicitEuler,
        ImplicitEuler,
        ImplicitMidpoint,
        ImplicitTrapezoid,
        Bdf2,
        Pbd,
        Xpbd,
        ProjectiveDynamics,
        Vbd,
    )
}  # fmt: skip


@dataclass(frozen=True)
class IntegratorInfo:
    """What is known about a scheme without running it; see :class:`~warpcloth.integrators.base.Integrator`.

    ``stability_limit`` is ω dt of the largest stable step on the undamped oscillator, None where there is none.
    """

    name: str
    order: int
    implicit: bool
    symplectic: bool
    capturable: bool
    adaptive: bool
    stability_limit: float | None
    conserves_linear_momentum: bool
    conserves_angular_momentum: bool
    reference: str
    cost: str
    use: str
    options: tuple[str, ...]


def integrators() -> dict[str, IntegratorInfo]:
    """All integrators, by name, with their attributes."""
    return {
        name: IntegratorInfo(
            name, cls.order, cls.implicit, cls.symplectic, cls.capturable, cls.adaptive,
            _stability_limit(cls), cls.conserves_linear_momentum, cls.conserves_angular_momentum,
            cls.reference, cls.cost, cls.use, option_names(cls),
        )
        for name, cls in INTEGRATORS.items()
    }  # fmt: skip


def _stability_limit(cls: type[Integrator]) -> float | None:
    limit = cls.stable_step(1.0, 0.0)
    return limit if math.isfinite(limit) else None


def option_names(cls: type[Integrator]) -> tuple[str, ...]:
    """Names of the keyword options of an integrator."""
    parameters = inspect.signature(cls.__init__).parameters.values()
    return tuple(p.name for p in parameters if p.kind is p.KEYWORD_ONLY)


def make_integrator(name: str, model: Model, options: Mapping[str, Any] | None = None) -> Integrator:
    """The integrator of that name, with its scratch memory for this model.

    Raises:
        InputError: unknown name or option, where the sentence lists what there is and proposes the closest, or an
            option that is out of range.
    """
    cls = INTEGRATORS[validate.choice(name, INTEGRATORS, "integrator")]
    known = option_names(cls)
    if not isinstance(options, Mapping | None):
        kind = type(options).__name__
        raise InputError(f"Integrator options must be given by name, such as {{'iterations': 10}}, got {kind}.")
    for option in options or {}:
        if not known:
            raise InputError(f"Integrator '{name}' has no options, got '{option}'.")
        validate.choice(option, known, f"option of integrator '{name}'")
    try:
        return cls(model, **(options or {}))
    except InputError as error:
        reason = str(error)
        raise InputError(f"Integrator '{name}': {reason[:1].lower()}{reason[1:]}") from None


__all__ = ["INTEGRATORS", "Integrator", "IntegratorInfo", "integrators", "make_integrator"]
