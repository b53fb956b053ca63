"""Which forces act in a simulation, by what its model has."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from . import validate
from .air import Air
from .errors import InputError
from .forces import AirDrag, Bending, ForceTerm, Pressure, Springs, StrainLimit, Woven
from .integrators import Integrator
from .model import Model


def airs_of(model: Model, air: Air | Sequence[Air] | None) -> list[Air]:
    """The air of each world; none, where there is a vacuum.

    Raises:
        InputError: something else, or not one for each world.
    """
    airs = [] if air is None else list(air) if isinstance(air, Sequence) else [air] * model.world_count
    for item in airs:
        if not isinstance(item, Air):
            raise InputError(f"Air must be an Air, one for each world, or None, got {type(item).__name__}.")
    if airs and len(airs) != model.world_count:
        raise InputError(f"Air must be given once or for each of the {model.world_count} worlds, got {len(airs)}.")
    return airs


def force_terms(
    model: Model, integrator: Integrator, assembly: str, airs: Sequence[Air], ranges: int
) -> list[ForceTerm]:  # fmt: skip
    """All forces but gravity that act on a model; ``airs`` as from :func:`airs_of`, other arguments as for
    :class:`warpcloth.Simulation`, and ``ranges``: into how many launches are cut on the CPU."""
    solved = "springs" in integrator.solved_forces  # by the scheme, which has copies of its own
    terms: list[ForceTerm] = [Springs(model, assembly, None if solved else ranges)]
    if model.woven_count > 0:
        terms.append(Woven(model, assembly, ranges))
    if model.bend_count > 0:
        terms.append(Bending(model, assembly, ranges))
    if any(item.density > 0.0 for item in airs) and model.tri_count > 0:
        terms.append(AirDrag(model, airs))
    if model.bag_count > 0:
        terms.append(Pressure(model))
    if model.limits_strain and not integrator.solves_springs_only:
        terms.append(StrainLimit(model))
    return terms


def world_gravity(model: Model, gravity: Any) -> wp.array:
    """Gravity [m/s²] of each world, from one for all, shape [3], or one for each, shape [world_count, 3].

    Raises:
        InputError: another shape, or not finite.
    """
    shape = (model.world_count, 3) if validate.axes(gravity) == 2 else (3,)
    values = validate.array(gravity, "gravity", shape)
    return model.array(np.broadcast_to(values, (model.world_count, 3)), model.vec3)
